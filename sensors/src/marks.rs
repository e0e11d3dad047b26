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
        // Zero where the row sees the point; linear along a chord of the curve.
        let miss = |p: Vector2<f64>| {
            let seen = self.in_camera(p);
            seen.y - slope * seen.z
        };
        let [a, b] = curve.windows(2).find_map(|pair| {
            let &[a, b] = pair else { return None };
            let crosses = miss(a) * miss(b) <= 0.0 && self.in_camera(b).z > 0.0;
            crosses.then_some([a, b])
        })?;
        let (from, to) = (miss(a), miss(b));
        let share = if from == to { 0.0 } else { from / (from - to) };
        let point = a.lerp(&b, share);
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
        let world_from_vehicle = self.ego.state.pose.to_isometry();
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
