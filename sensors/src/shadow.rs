use covista_traffic::SceneVehicle;
use covista_world::Se2Pose;
use nalgebra::{Point3, Vector2, Vector3};

use crate::silhouette::Silhouette;

/// The lowest sun whose shadows are drawn at full length.
const LOWEST_SUN: f64 = 0.1;
/// How far from a vehicle the ground is visibly darker.
const CONTACT_REACH_M: f64 = 1.0;
/// Image rows between the rows of a pixel at which the edges of shadows are sampled.
const SUB_ROWS: [f64; 3] = [-0.33, 0.0, 0.33];

/// The shadow of a convex part on level ground: its vertices, moved away from the sun.
pub(crate) fn on_ground(part: &[Point3<f64>], sun: &Vector3<f64>) -> Vec<Point3<f64>> {
    part.iter()
        .map(|p| p - sun * (p.z.max(0.0) / sun.z.max(LOWEST_SUN)))
        .collect()
}

/// Share of each pixel of row `v` that lies in shadow, were it ground.
pub(crate) fn shadow_line(shadows: &[Silhouette], v: f64, width: usize) -> Vec<f32> {
    let mut line = vec![0.0; width];
    let mut sub_row = vec![0.0_f32; width];
    for offset in SUB_ROWS {
        sub_row.fill(0.0);
        for (from, to) in shadows.iter().filter_map(|shadow| shadow.span(v + offset)) {
            let first = (from - 0.5).max(0.0) as usize;
            let end = ((to + 1.5).max(0.0) as usize).min(width);
            for (column, share) in sub_row.iter_mut().enumerate().take(end).skip(first) {
                let u = column as f64;
                let overlap = to.min(u + 0.5) - from.max(u - 0.5);
                *share += overlap.clamp(0.0, 1.0) as f32;
            }
        }
        for (sum, share) in line.iter_mut().zip(&sub_row) {
            *sum += share.min(1.0) / SUB_ROWS.len() as f32;
        }
    }
    line
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
    pub(crate) fn corners(&self) -> [Point3<f64>; 4] {
        let reach = self.half_size_m.add_scalar(CONTACT_REACH_M);
        [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| {
            let corner = self
                .center
                .transform(Vector2::new(x * reach.x, y * reach.y));
            Point3::new(corner.x, corner.y, 0.0)
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

    use super::*;
    use crate::testing::vehicle;

    #[test]
    fn a_shadow_is_as_long_as_the_sun_is_low() {
        let sun = Vector3::new(-1.0, 0.0, 1.0).normalize();
        let shadow = on_ground(&[Point3::new(5.0, 2.0, 3.0)], &sun);
        assert!((shadow[0] - Point3::new(8.0, 2.0, 0.0)).norm() < 1e-9);
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
