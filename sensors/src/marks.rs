use covista_world::{FrenetPoint, MARK_COUNT, ROW_ANCHORS};
use nalgebra::{Point3, Vector2};

use crate::{ObjectRef, Viewpoint};

/// Marks are labelled up to this distance ahead of the rear axle.
const RANGE_M: f64 = 100.0;
const STEP_M: f64 = 0.5;
/// A ray to a mark ends a little before and above the ground.
const CLEARANCE_M: f32 = 0.05;

/// Ground truth of the road's four lane marks in one camera image, from the left edge line to the
/// right one. A mark behind a vehicle counts as seen, one behind scenery does not.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkTruth {
    /// For each mark its u in pixels at each of the [`ROW_ANCHORS`], where it is seen.
    pub pixels: [[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT],
    /// For each mark the points, every half metre along the road, that the image shows: x forward
    /// and y to the left in the vehicle frame, in metres.
    pub points_m: [Vec<Vector2<f64>>; MARK_COUNT],
}

/// The lane marks as the camera of `view` should find them.
pub fn true_marks(view: &Viewpoint) -> MarkTruth {
    let (road, pose) = (&view.scene.road, view.ego.state.pose);
    let start_m = road.to_frenet(pose.position()).s_m;
    let steps = (RANGE_M * 1.5 / STEP_M) as usize;
    let curves: [Vec<Vector2<f64>>; MARK_COUNT] = std::array::from_fn(|mark| {
        let d_m = road.mark_offset_m(mark);
        (0..=steps)
            .map(|i| start_m + i as f64 * STEP_M)
            .map(|s_m| pose.inverse_transform(road.from_frenet(FrenetPoint { s_m, d_m })))
            .take_while(|point| point.norm() <= RANGE_M)
            .collect()
    });
    MarkTruth {
        pixels: std::array::from_fn(|mark| {
            ROW_ANCHORS.map(|anchor| view.column(&curves[mark], f64::from(anchor.0)))
        }),
        points_m: curves.map(|curve| curve.into_iter().filter(|p| view.shows(*p)).collect()),
    }
}

impl Viewpoint<'_> {
    fn in_camera(&self, point: Vector2<f64>) -> Point3<f64> {
        self.calibration
            .vehicle_from_camera
            .inverse_transform_point(&Point3::new(point.x, point.y, 0.0))
    }

    /// The u at which the row at `v` first meets the curve, where the image shows that point.
    fn column(&self, curve: &[Vector2<f64>], v: f64) -> Option<f32> {
        let camera = &self.calibration.intrinsics;
        let slope = (v - camera.cy_px) / camera.fy_px;
        // Positive where the row sees the ground farther away; linear along a chord of the curve.
        let miss = |p: Vector2<f64>| {
            let seen = self.in_camera(p);
            seen.y - slope * seen.z
        };
        let [a, b] = curve.windows(2).find_map(|pair| match *pair {
            [a, b] if miss(a) > 0.0 && miss(b) <= 0.0 => Some([a, b]),
            _ => None,
        })?;
        let point = a.lerp(&b, miss(a) / (miss(a) - miss(b)));
        self.shows(point)
            .then(|| camera.project(&self.in_camera(point)))
            .flatten()
            .map(|[u, _]| u as f32)
    }

    /// Whether the image holds the point and no scenery hides it.
    fn shows(&self, point: Vector2<f64>) -> bool {
        let camera = &self.calibration.intrinsics;
        let Some([u, v]) = camera.project(&self.in_camera(point)) else {
            return false;
        };
        let inside = |x: f64, size: u32| x >= 0.0 && x <= f64::from(size) - 1.0;
        inside(u, camera.width_px) && inside(v, camera.height_px) && !self.behind_scenery(point)
    }

    fn behind_scenery(&self, point: Vector2<f64>) -> bool {
        let world_from_vehicle = self.scene.placed(self.ego);
        let eye = self.calibration.vehicle_from_camera.translation.vector;
        let from = (world_from_vehicle * Point3::from(eye)).cast::<f32>();
        let to = (world_from_vehicle * Point3::new(point.x, point.y, 0.0)).cast::<f32>();
        let sight = to - from;
        let distance_m = sight.norm();
        self.rays.blocked(
            &from,
            &(sight / distance_m),
            distance_m - CLEARANCE_M,
            |object| matches!(object, ObjectRef::Scenery(_)),
        )
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use covista_traffic::{Scene, VehicleId, VehicleModel};
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
}
