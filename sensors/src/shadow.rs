use covista_traffic::{SceneVehicle, Terrain};
use covista_world::Se2Pose;
use nalgebra::{Point3, Vector2, Vector3};

use crate::silhouette::Silhouette;

/// The lowest sun whose shadows are drawn at full length.
const LOWEST_SUN: f64 = 0.1;
/// A shadow's end is found by following the sun's ray to the height of the ground below its last
/// end, so many times.
const GROUND_STEPS: usize = 4;
/// How far from a vehicle the ground is visibly darker.
const CONTACT_REACH_M: f64 = 1.0;
/// Image rows between the rows of a pixel at which the edges of shadows are sampled.
const SUB_ROWS: [f64; 3] = [-0.33, 0.0, 0.33];

/// The shadow of a convex part on the ground: its vertices, moved away from the sun.
pub(crate) fn on_ground(
    terrain: &Terrain,
    vertices: &[Point3<f32>],
    sun: &Vector3<f64>,
) -> Vec<Point3<f64>> {
    let slant = sun / sun.z.max(LOWEST_SUN);
    let cast = |vertex: &Point3<f32>| {
        let vertex = vertex.cast::<f64>();
        (0..GROUND_STEPS).fold(vertex, |foot, _| {
            let above_m = vertex.z - terrain.height_m(foot.xy().coords);
            vertex - slant * above_m.max(0.0)
        })
    };
    vertices.iter().map(cast).collect()
}

/// The shadows that one image row crosses.
pub(crate) struct ShadowRow {
    spans: Vec<ShadowSpan>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct ShadowSpan {
    sub_row: usize,
    from: f32,
    to: f32,
    depths_m: [f32; 2],
}

impl ShadowRow {
    pub(crate) fn new(shadows: &[&Silhouette], v: f64) -> Self {
        let sub_rows = SUB_ROWS.iter().enumerate();
        let spans = sub_rows.flat_map(|(sub_row, offset)| {
            shadows.iter().filter_map(move |shadow| {
                let (from, to) = shadow.span(v + offset)?;
                let [near_m, far_m] = shadow.depths_m;
                // The ground between the corners of a shadow is no plane.
                let slack_m = 0.5 + 0.05 * far_m;
                Some(ShadowSpan {
                    sub_row,
                    from: from as f32,
                    to: to as f32,
                    depths_m: [near_m - slack_m, far_m + slack_m].map(|depth_m| depth_m as f32),
                })
            })
        });
        Self {
            spans: spans.collect(),
        }
    }

    /// Those that pixels from `first` up to `end` may lie in.
    pub(crate) fn among(&self, first: usize, end: usize, found: &mut Vec<ShadowSpan>) {
        let (low, high) = (first as f32 - 0.5, end as f32 - 0.5);
        found.clear();
        let spans = self.spans.iter();
        found.extend(spans.filter(|span| span.to > low && span.from < high));
    }
}

/// Share of the ground behind the pixel at `u` that lies in one of the shadows.
pub(crate) fn shaded_share(spans: &[ShadowSpan], u: f32, depth_m: f32) -> f32 {
    let mut shares = [0.0_f32; SUB_ROWS.len()];
    for span in spans {
        if (span.depths_m[0]..=span.depths_m[1]).contains(&depth_m) {
            let overlap = span.to.min(u + 0.5) - span.from.max(u - 0.5);
            shares[span.sub_row] += overlap.clamp(0.0, 1.0);
        }
    }
    shares.iter().map(|share| share.min(1.0)).sum::<f32>() / SUB_ROWS.len() as f32
}

/// A vehicle's outline on the ground, about which less of the sky is seen.
pub(crate) struct Contact {
    center: Se2Pose,
    half_size_m: Vector2<f64>,
}

impl Contact {
    pub(crate) fn new(vehicle: &SceneVehicle) -> Self {
        let dimensions = vehicle.dimensions();
        Self {
            center: dimensions.center_pose(vehicle.state.pose),
            half_size_m: Vector2::new(dimensions.length_m, dimensions.width_m) / 2.0,
        }
    }

    /// Corners of the darker ground in the world.
    pub(crate) fn corners(&self, terrain: &Terrain) -> [Point3<f64>; 4] {
        let reach = self.half_size_m.add_scalar(CONTACT_REACH_M);
        [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| {
            let corner = self
                .center
                .transform(Vector2::new(x * reach.x, y * reach.y));
            Point3::new(corner.x, corner.y, terrain.height_m(corner))
        })
    }

    /// Share of the sky that the ground at `position` sees.
    pub(crate) fn openness(&self, position: Vector2<f64>) -> f32 {
        let local = self.center.inverse_transform(position);
        let outside = (local.abs() - self.half_size_m)
            .sup(&Vector2::zeros())
            .norm();
        let inside = (self.half_size_m - local.abs()).min().clamp(0.0, 0.5);
        let fade = (1.0 - outside / CONTACT_REACH_M).max(0.0);
        (1.0 - 0.6 * fade * fade - 0.7 * inside) as f32
    }
}

#[cfg(test)]
mod tests {
    use covista_traffic::{VehicleId, VehicleModel};
    use covista_world::CameraIntrinsics;

    use super::*;
    use crate::testing::vehicle;

    #[test]
    fn a_shadow_is_as_long_as_the_sun_is_low() {
        let sun = Vector3::new(-1.0, 0.0, 1.0).normalize();
        let shadow = on_ground(&Terrain::FLAT, &[Point3::new(5.0, 2.0, 3.0)], &sun);
        assert!((shadow[0] - Point3::new(8.0, 2.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn uphill_a_shadow_ends_where_the_suns_ray_meets_the_slope() {
        let sun = Vector3::new(-1.0, 0.0, 1.0).normalize();
        let slope = Terrain::sampled(Vector2::zeros(), 50.0, 2.0, |p| 0.1 * p.x);
        let shadow = on_ground(&slope, &[Point3::new(5.0, 2.0, 3.5)], &sun);
        // 3.5 - t = 0.1 (5 + t).
        let along_m = 3.0 / 1.1;
        let end = Point3::new(5.0 + along_m, 2.0, 3.5 - along_m);
        assert!((shadow[0] - end).norm() < 2e-3, "{shadow:?}");
    }

    #[test]
    fn a_shadow_falls_on_the_ground_at_its_own_depth_only() {
        let camera = CameraIntrinsics::KITTI;
        let corners = [(-1.0, 9.0), (1.0, 9.0), (1.0, 11.0), (-1.0, 11.0)]
            .map(|(x, z)| Point3::new(x, 1.65, z));
        let outline = Silhouette::new(&camera, &corners).expect("in the image");
        let row = ShadowRow::new(&[&outline], camera.cy_px + camera.fy_px * 0.165);
        let mut spans = Vec::new();
        row.among(600, 616, &mut spans);
        assert!((shaded_share(&spans, 609.0, 10.0) - 1.0).abs() < 1e-6);
        assert!(shaded_share(&spans, 609.0, 25.0).abs() < 1e-6);
        row.among(0, 16, &mut spans);
        assert!(spans.is_empty());
    }

    #[test]
    fn the_ground_is_darkest_below_a_vehicle_and_open_a_metre_away() {
        let pose = Se2Pose::new(10.0, -2.0, 0.4);
        let contact = Contact::new(&vehicle(VehicleId(1), VehicleModel::Suv, pose));
        let at = |x: f64, y: f64| contact.openness(pose.transform(Vector2::new(x, y)));
        assert!(at(1.3, 0.0) < 0.3);
        assert!(at(1.3, 1.2) > at(1.3, 0.0) && at(1.3, 1.2) < 0.9);
        assert!((at(1.3, 0.95 + CONTACT_REACH_M) - 1.0).abs() < 1e-6);
    }
}
