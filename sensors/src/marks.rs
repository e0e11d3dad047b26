use covista_traffic::MarkStyle;
use covista_world::{FrenetPoint, MARK_COUNT, ROW_ANCHORS};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use crate::{ObjectRef, Viewpoint};

/// Marks are labelled up to this distance ahead of the rear axle.
const RANGE_M: f64 = 100.0;
const STEP_M: f64 = 0.5;
/// A ray to a mark ends a little before the ground.
const CLEARANCE_M: f64 = 0.3;
/// A mark of which vehicles leave less than this part of its rows in view is not labelled.
const LEAST_IN_VIEW: f64 = 0.1;

/// Ground truth of the road's four lane marks in one camera image, from the left edge line to the
/// right one. A mark behind a vehicle counts as seen, one behind scenery or a crest does not; a
/// mark that is not painted, or that vehicles hide from end to end, is not labelled.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkTruth {
    /// For each mark its u in pixels at each of the [`ROW_ANCHORS`], where it is seen: of several
    /// points in one row that nearest to the camera.
    pub pixels: [[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT],
    /// For each mark the points, every half metre along the road, that the image shows: x forward
    /// and y to the left in the vehicle frame, in metres. Where the ground is no plane they are
    /// projected along the vehicle's z.
    pub points_m: [Vec<Vector2<f64>>; MARK_COUNT],
}

/// The lane marks as the camera of `view` should find them.
pub fn true_marks(view: &Viewpoint) -> MarkTruth {
    let sight = MarkSight::new(view);
    let curves: [Vec<Point3<f64>>; MARK_COUNT] =
        std::array::from_fn(|mark| match view.scene.markings.styles[mark] {
            MarkStyle::None => Vec::new(),
            MarkStyle::Solid | MarkStyle::Dashed | MarkStyle::Double => Some(sight.curve(mark))
                .filter(|curve| sight.is_in_view(curve))
                .unwrap_or_default(),
        });
    MarkTruth {
        pixels: std::array::from_fn(|mark| {
            ROW_ANCHORS.map(|anchor| sight.column(&curves[mark], f64::from(anchor.0)))
        }),
        points_m: curves.map(|curve| {
            let shown = curve.iter().filter(|point| sight.shows(point));
            shown.map(|point| point.xy().coords).collect()
        }),
    }
}

/// A camera that looks for points of the ground, which are given in the vehicle frame.
struct MarkSight<'a> {
    view: &'a Viewpoint<'a>,
    world_from_vehicle: Isometry3<f64>,
    eye: Point3<f64>,
}

impl<'a> MarkSight<'a> {
    fn new(view: &'a Viewpoint<'a>) -> Self {
        Self {
            view,
            world_from_vehicle: view.scene.placed(view.ego),
            eye: Point3::from(view.world_from_camera().translation.vector),
        }
    }

    /// The mark ahead, on the ground.
    fn curve(&self, mark: usize) -> Vec<Point3<f64>> {
        let scene = self.view.scene;
        let start_m = scene
            .road
            .to_frenet(self.view.ego.state.pose.position())
            .s_m;
        let d_m = scene.road.mark_offset_m(mark);
        let steps = (RANGE_M * 1.5 / STEP_M) as usize;
        (0..=steps)
            .map(|step| {
                let s_m = start_m + step as f64 * STEP_M;
                let at = scene.road.from_frenet(FrenetPoint { s_m, d_m });
                let point = Point3::new(at.x, at.y, scene.terrain.height_m(at));
                self.world_from_vehicle.inverse_transform_point(&point)
            })
            .take_while(|point| point.xy().coords.norm() <= RANGE_M)
            .collect()
    }

    fn in_camera(&self, point: &Point3<f64>) -> Point3<f64> {
        let calibration = self.view.calibration;
        calibration
            .vehicle_from_camera
            .inverse_transform_point(point)
    }

    /// Whether vehicles leave enough of the curve's rows in view to know of it.
    fn is_in_view(&self, curve: &[Point3<f64>]) -> bool {
        let rows: Vec<_> = ROW_ANCHORS
            .iter()
            .filter_map(|anchor| self.crossing(curve, f64::from(anchor.0)))
            .collect();
        let free = rows.iter().filter(|point| !self.is_behind_vehicle(point));
        free.count() as f64 >= LEAST_IN_VIEW * rows.len() as f64
    }

    /// The u at which the row at `v` first shows the curve.
    fn column(&self, curve: &[Point3<f64>], v: f64) -> Option<f32> {
        let [u, _] = self.pixel(&self.crossing(curve, v)?)?;
        Some(u as f32)
    }

    /// The point of the curve that the row at `v` first shows.
    fn crossing(&self, curve: &[Point3<f64>], v: f64) -> Option<Point3<f64>> {
        let camera = &self.view.calibration.intrinsics;
        let slope = (v - camera.cy_px) / camera.fy_px;
        // Changes its sign where the curve crosses the row; linear along a chord of the curve.
        let miss = |point: &Point3<f64>| {
            let seen = self.in_camera(point);
            seen.y - slope * seen.z
        };
        curve.windows(2).find_map(|pair| {
            let (from, to) = (miss(&pair[0]), miss(&pair[1]));
            if (from > 0.0) == (to > 0.0) {
                return None;
            }
            let point = pair[0].lerp(&pair[1], from / (from - to));
            self.shows(&point).then_some(point)
        })
    }

    fn shows(&self, point: &Point3<f64>) -> bool {
        self.pixel(point).is_some() && !self.is_hidden(point)
    }

    /// Where the image holds the point.
    fn pixel(&self, point: &Point3<f64>) -> Option<[f64; 2]> {
        let camera = &self.view.calibration.intrinsics;
        let inside = |x: f64, size: u32| x >= 0.0 && x <= f64::from(size) - 1.0;
        camera
            .project(&self.in_camera(point))
            .filter(|[u, v]| inside(*u, camera.width_px) && inside(*v, camera.height_px))
    }

    /// Whether scenery or higher ground hides the point.
    fn is_hidden(&self, point: &Point3<f64>) -> bool {
        let (direction, reach_m) = self.ray_to(point);
        let terrain = &self.view.scene.terrain;
        terrain.meet(&self.eye, &direction, reach_m).is_some()
            || self.is_behind(point, |object| matches!(object, ObjectRef::Scenery(_)))
    }

    fn is_behind_vehicle(&self, point: &Point3<f64>) -> bool {
        let ego = self.view.ego.id;
        self.is_behind(
            point,
            |object| matches!(object, ObjectRef::Vehicle(id) if id != ego),
        )
    }

    fn is_behind(&self, point: &Point3<f64>, hides: impl Fn(ObjectRef) -> bool) -> bool {
        let (direction, reach_m) = self.ray_to(point);
        let rays = self.view.rays;
        rays.blocked(&self.eye.cast(), &direction.cast(), reach_m as f32, hides)
    }

    /// Direction of the ray from the camera and how far it is followed.
    fn ray_to(&self, point: &Point3<f64>) -> (Vector3<f64>, f64) {
        let sight = self.world_from_vehicle * point - self.eye;
        let length_m = sight.norm();
        (sight / length_m, length_m - CLEARANCE_M)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use covista_traffic::{Scene, Terrain, VehicleId, VehicleModel};
    use covista_world::{Calibration, CameraIntrinsics, Road, RoadSegment, Se2Pose};

    use super::*;
    use crate::RayScene;
    use crate::testing::{EGO, block, empty_road, vehicle};

    fn marks(scene: &Scene) -> MarkTruth {
        let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
        true_marks(&Viewpoint::new(scene, &rays, EGO, &calibration).expect("the ego"))
    }

    fn arc(curvature_per_m: f64) -> Scene {
        let bend = RoadSegment::Arc {
            length_m: 150.0,
            curvature_per_m,
        };
        let mut scene = empty_road();
        scene.road = Arc::new(Road::new(Se2Pose::default(), &[bend], 3.5).expect("a road"));
        scene
    }

    #[test]
    fn on_a_straight_road_marks_run_to_the_vanishing_point() {
        let truth = marks(&empty_road());
        let camera = CameraIntrinsics::KITTI;
        for (mark, d_m) in [5.25, 1.75, -1.75, -5.25].into_iter().enumerate() {
            for (anchor, u) in ROW_ANCHORS.iter().zip(truth.pixels[mark]) {
                // The camera is 1.65 m above the ground and 1.17 m ahead of the rear axle.
                let below_px = f64::from(anchor.0) - camera.cy_px;
                let ahead_m = 1.17 + 1.65 * camera.fy_px / below_px;
                let column = camera.cx_px - d_m * below_px / 1.65;
                let far = Vector2::new(ahead_m, d_m).norm() > RANGE_M;
                let seen = below_px > 0.0 && !far && (0.0..=1241.0).contains(&column);
                assert_eq!(u.is_some(), seen, "{mark} {anchor:?}");
                assert!(u.is_none_or(|u| (f64::from(u) - column).abs() < 1e-3));
            }
            assert!(
                truth.points_m[mark]
                    .iter()
                    .all(|p| (p.y - d_m).abs() < 1e-9)
            );
            assert!(truth.points_m[mark].len() > 100);
        }
    }

    #[test]
    fn a_mark_without_paint_is_not_labelled() {
        let mut scene = empty_road();
        let all = marks(&scene);
        scene.markings.styles[1] = MarkStyle::None;
        let three = marks(&scene);
        assert!(three.pixels[1].iter().all(Option::is_none) && three.points_m[1].is_empty());
        assert_eq!(three.pixels[2], all.pixels[2]);
    }

    #[test]
    fn a_crest_hides_the_marks_behind_it() {
        let mut scene = empty_road();
        // A ridge across the road, 40 m ahead and 2 m high, and level ground behind it.
        let ridge = |p: Vector2<f64>| 2.0 * (-(p.x - 40.0).powi(2) / 50.0).exp();
        scene.terrain = Arc::new(Terrain::sampled(Vector2::zeros(), 150.0, 1.0, ridge));
        let truth = marks(&scene);
        let shown = |from_m: f64, to_m: f64| {
            let points = truth.points_m[1].iter();
            points.filter(|p| (from_m..to_m).contains(&p.x)).count()
        };
        assert!(shown(10.0, 35.0) > 45);
        assert_eq!(shown(45.0, 95.0), 0);
        // The highest labelled row is that of the ridge as it is seen.
        let horizon = ROW_ANCHORS
            .iter()
            .zip(truth.pixels[1])
            .find(|(_, u)| u.is_some());
        let (row, _) = horizon.expect("a mark");
        let ridge_row = 172.854 + 721.54 * (1.65 - 2.0) / (40.0 - 1.17);
        assert!((f64::from(row.0) - ridge_row - 5.0).abs() < 6.0, "{row:?}");
    }

    #[test]
    fn a_mirrored_bend_has_mirrored_marks() {
        let (left, right) = (marks(&arc(1.0 / 80.0)), marks(&arc(-1.0 / 80.0)));
        let mut pairs = 0;
        for mark in 0..MARK_COUNT {
            let mirrored = &right.pixels[MARK_COUNT - 1 - mark];
            for (a, b) in left.pixels[mark].iter().zip(mirrored) {
                let (Some(a), Some(b)) = (a, b) else { continue };
                let axis = f64::from(a + b) / 2.0;
                assert!((axis - CameraIntrinsics::KITTI.cx_px).abs() < 1e-3);
                pairs += 1;
            }
        }
        assert!(pairs > 40, "{pairs}");
    }

    #[test]
    fn in_a_bend_marks_lie_on_concentric_circles() {
        let truth = marks(&arc(1.0 / 80.0));
        for (points, d_m) in truth.points_m.iter().zip([5.25, 1.75, -1.75, -5.25]) {
            assert!(points.len() > 40);
            let radius = |p: &Vector2<f64>| (p - Vector2::new(0.0, 80.0)).norm();
            assert!(
                points
                    .iter()
                    .all(|p| (radius(p) - (80.0 - d_m)).abs() < 1e-6)
            );
        }
    }

    #[test]
    fn walls_hide_marks_and_vehicles_do_not() {
        let free = marks(&empty_road());
        let mut scene = empty_road();
        let pose = Se2Pose::new(12.0, 0.0, 0.0);
        scene
            .vehicles
            .push(vehicle(VehicleId(1), VehicleModel::Truck, pose));
        assert_eq!(marks(&scene), free);
        scene.scenery = vec![block([40.0, -30.0, 0.0], [41.0, 30.0, 5.0])].into();
        let hidden = marks(&scene);
        // Row 200 sees the ground 45 m ahead, row 210 at 33 m.
        assert!(free.pixels[1][10].is_some() && hidden.pixels[1][10].is_none());
        assert_eq!(free.pixels[1][11..], hidden.pixels[1][11..]);
        assert!(hidden.points_m[2].iter().all(|p| p.x < 40.1));
    }

    #[test]
    fn a_mark_behind_vehicles_from_end_to_end_is_not_labelled() {
        let mut scene = empty_road();
        let free = marks(&scene);
        // Trucks bumper to bumper between the camera and the leftmost mark.
        let mut park = |count: u32| {
            let row = (0..count).map(|place| {
                let pose = Se2Pose::new(2.0 + 6.0 * f64::from(place), 3.5, 0.0);
                vehicle(VehicleId(1 + place), VehicleModel::Truck, pose)
            });
            scene.vehicles.truncate(1);
            scene.vehicles.extend(row);
            marks(&scene)
        };
        assert_eq!(park(1), free);
        let hidden = park(18);
        assert!(hidden.pixels[0].iter().all(Option::is_none) && hidden.points_m[0].is_empty());
        assert_eq!(hidden.pixels[2..], free.pixels[2..]);
    }
}
