//! What is truly there, in the LIDAR frame, and how much of it can be seen.

use covista_traffic::{Scene, SceneVehicle, VehicleId, VehicleModel};
use covista_world::{Detection3d, LaneIndex, VehicleDimensions};
use nalgebra::{Point3, Vector3};

use crate::caster::{ObjectRef, RayScene};
use crate::{LabelledCloud, SeenVehicle, Viewpoint};

/// A vehicle's true box, in the LIDAR frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthBox {
    /// The vehicle.
    pub id: VehicleId,
    /// Its model.
    pub model: VehicleModel,
    /// Centre of the box in metres.
    pub center_m: Vector3<f64>,
    /// Length, width, height in metres.
    pub size_m: Vector3<f64>,
    /// Heading about z, counter-clockwise from x, in (-pi, pi].
    pub yaw_rad: f64,
    /// The lane that its centre is in, unless it is beyond the road's three.
    pub lane: Option<LaneIndex>,
    /// LIDAR points on the body.
    pub lidar_points: usize,
    /// Share of the body in line of sight of the LIDAR, in [0, 1].
    pub visibility: f64,
    /// Share of the body in line of sight of the camera, in or out of its picture, in [0, 1].
    pub camera_visibility: f64,
    /// Corners of the body's convex parts in the LIDAR frame, in metres.
    pub parts_m: Vec<Vec<Point3<f64>>>,
}

/// Half-extents of the detector's range in the LIDAR frame, in metres.
const DETECTOR_RANGE_M: [f64; 2] = [69.12, 12.8];

/// The boxes of all other vehicles, with the points of the sweep on each.
pub fn truth_boxes(view: &Viewpoint, swept: &LabelledCloud) -> Vec<TruthBox> {
    let [lidar, camera] = [view.lidar_position(), view.camera_position()];
    let counts = swept.vehicle_points();
    let boxes = view.others().map(|vehicle| {
        let mut found = true_box(view, vehicle);
        let seen_from = |eye| visible_share(view.scene, view.rays, vehicle, eye, view.ego.id);
        found.visibility = seen_from(lidar);
        found.camera_visibility = seen_from(camera);
        found.lidar_points = counts.get(&vehicle.id).copied().unwrap_or(0);
        found.parts_m = parts_in_lidar(view, vehicle.id);
        found
    });
    boxes.collect()
}

/// Exact detections of the vehicles in line of sight and in the detector's range: perception
/// without a perception error.
pub fn truth_detections(view: &Viewpoint) -> Vec<Detection3d> {
    let [range_x_m, range_y_m] = DETECTOR_RANGE_M;
    let seen = seen_vehicles(view, [-range_x_m, -range_y_m, range_x_m, range_y_m]);
    seen.iter().map(|vehicle| vehicle.truth).collect()
}

/// The vehicles in line of sight whose centre is in a range of the LIDAR frame in metres: least x
/// and y, greatest x and y.
pub fn seen_vehicles(view: &Viewpoint, range_m: [f64; 4]) -> Vec<SeenVehicle> {
    let eye = view.lidar_position();
    let [least_x, least_y, most_x, most_y] = range_m;
    let seen = view.others().filter_map(|vehicle| {
        let truth = true_box(view, vehicle);
        let is_in_range = (least_x..=most_x).contains(&truth.center_m.x)
            && (least_y..=most_y).contains(&truth.center_m.y);
        let visibility = if is_in_range {
            visible_share(view.scene, view.rays, vehicle, eye, view.ego.id)
        } else {
            0.0
        };
        (visibility > 0.0).then(|| SeenVehicle {
            id: vehicle.id,
            truth: Detection3d {
                center_m: truth.center_m,
                size_m: truth.size_m,
                yaw_rad: truth.yaw_rad,
                class: vehicle.model.class(),
                score: 1.0,
            },
            lane: truth.lane,
            visibility,
        })
    });
    seen.collect()
}

/// Share of vehicle `target` that the point `from` (world frame, on vehicle `viewer`) has in line
/// of sight, in [0, 1]; zero where the scene has no such vehicle.
pub fn in_line_of_sight(
    scene: &Scene,
    rays: &RayScene,
    from: Point3<f64>,
    viewer: VehicleId,
    target: VehicleId,
) -> f64 {
    let target = scene.vehicles.iter().find(|vehicle| vehicle.id == target);
    target.map_or(0.0, |target| {
        visible_share(scene, rays, target, from, viewer)
    })
}

/// Share of points on the body's outline, at two heights, that neither the ground nor anything but
/// the two vehicles themselves hides from `from`.
fn visible_share(
    scene: &Scene,
    rays: &RayScene,
    target: &SceneVehicle,
    from: Point3<f64>,
    viewer: VehicleId,
) -> f64 {
    let own = [ObjectRef::Vehicle(viewer), ObjectRef::Vehicle(target.id)];
    let eye = from.cast::<f32>();
    let pose = scene.placed(target);
    let samples = outline(target.dimensions());
    let seen = samples.iter().filter(|sample| {
        let gap = (pose * **sample - from).cast::<f32>();
        let (direction, distance_m) = (gap / gap.norm(), gap.norm());
        distance_m < 1e-3
            || rays.ground_hit(&eye, &direction, distance_m).is_none()
                && !rays.blocked(&eye, &direction, distance_m, |object| {
                    !own.contains(&object)
                })
    });
    seen.count() as f64 / samples.len() as f64
}

/// Corners and middles of the sides at a third and at nine tenths of the height, a little inside
/// the box, in the vehicle frame.
fn outline(size: VehicleDimensions) -> [Point3<f64>; 16] {
    const AROUND: [[f64; 2]; 8] = [
        [1.0, 1.0],
        [0.0, 1.0],
        [-1.0, 1.0],
        [-1.0, 0.0],
        [-1.0, -1.0],
        [0.0, -1.0],
        [1.0, -1.0],
        [1.0, 0.0],
    ];
    std::array::from_fn(|index| {
        let [x, y] = AROUND[index % 8];
        let height = if index < 8 { 1.0 / 3.0 } else { 0.9 };
        Point3::new(
            size.center_ahead_of_axle_m() + 0.45 * size.length_m * x,
            0.45 * size.width_m * y,
            height * size.height_m,
        )
    })
}

/// The box of `vehicle` in the LIDAR frame, with nothing measured yet.
fn true_box(view: &Viewpoint, vehicle: &SceneVehicle) -> TruthBox {
    let size = vehicle.dimensions();
    let center = Point3::new(size.center_ahead_of_axle_m(), 0.0, size.height_m / 2.0);
    let lidar_from_vehicle = view.world_from_lidar().inverse() * view.scene.placed(vehicle);
    let forward = lidar_from_vehicle * Vector3::x();
    let middle = size.center_pose(vehicle.state.pose).position();
    let road = &view.scene.road;
    TruthBox {
        id: vehicle.id,
        model: vehicle.model,
        center_m: (lidar_from_vehicle * center).coords,
        size_m: Vector3::new(size.length_m, size.width_m, size.height_m),
        yaw_rad: forward.y.atan2(forward.x),
        lane: road.lane_at(road.to_frenet(middle).d_m),
        lidar_points: 0,
        visibility: 0.0,
        camera_visibility: 0.0,
        parts_m: Vec::new(),
    }
}

fn parts_in_lidar(view: &Viewpoint, id: VehicleId) -> Vec<Vec<Point3<f64>>> {
    let lidar_from_world = view.world_from_lidar().inverse();
    let solids = view.rays.solids();
    let own = solids.filter(|solid| solid.part.object == ObjectRef::Vehicle(id));
    let corners = own.map(|solid| {
        let vertices = solid.vertices.iter();
        vertices
            .map(|vertex| lidar_from_world * vertex.cast::<f64>())
            .collect()
    });
    corners.collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use covista_traffic::Terrain;
    use covista_world::{Calibration, Se2Pose};
    use nalgebra::Vector2;

    use super::*;
    use crate::Lidar;
    use crate::testing::{EGO, block, empty_road, vehicle};

    const OTHER: VehicleId = VehicleId(4);

    /// An SUV whose rear axle is 15 m ahead on the left lane, turned by 0.1 rad.
    fn scene_ahead() -> Scene {
        let mut scene = empty_road();
        let pose = Se2Pose::new(15.0, 3.5, 0.1);
        scene.vehicles.push(vehicle(OTHER, VehicleModel::Suv, pose));
        scene
    }

    fn with_view<T>(scene: &Scene, check: impl FnOnce(&Viewpoint) -> T) -> T {
        let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
        check(&Viewpoint::new(scene, &rays, EGO, &calibration).expect("the ego"))
    }

    #[test]
    fn a_box_is_the_body_in_the_lidar_frame() {
        let boxes = with_view(&scene_ahead(), |view| {
            truth_boxes(view, &Lidar::hdl64e().sweep_labelled(view, 1))
        });
        let [truth] = boxes.as_slice() else {
            panic!("one box: {boxes:?}")
        };
        // The body's centre is 4.6 / 2 - 1.0 m ahead of the rear axle.
        let expected = Vector3::new(
            15.0 + 1.3 * 0.1_f64.cos() - 0.9,
            3.5 + 1.3 * 0.1_f64.sin(),
            0.85 - 1.73,
        );
        assert!((truth.center_m - expected).norm() < 1e-9);
        assert!((truth.yaw_rad - 0.1).abs() < 1e-12);
        assert_eq!(truth.lane, Some(LaneIndex::LEFTMOST));
        assert!((truth.visibility - 1.0).abs() < 1e-12);
        assert!(truth.lidar_points > 300, "{}", truth.lidar_points);
    }

    #[test]
    fn a_wall_hides_and_half_a_wall_hides_half() {
        let mut scene = scene_ahead();
        let detections = |scene: &Scene| with_view(scene, |view| truth_detections(view).len());
        let share = |scene: &Scene| {
            with_view(scene, |view| {
                in_line_of_sight(scene, view.rays, view.lidar_position(), EGO, OTHER)
            })
        };
        assert_eq!(detections(&scene), 1);
        scene.scenery = vec![block([10.0, -2.0, 0.0], [10.5, 8.0, 4.0])].into();
        assert!(share(&scene).abs() < 1e-12);
        assert_eq!(detections(&scene), 0);
        scene.scenery = vec![block([10.0, -2.0, 0.0], [10.5, 2.4, 4.0])].into();
        let half = share(&scene);
        assert!((0.2..0.8).contains(&half), "{half}");
        assert_eq!(detections(&scene), 1);
    }

    #[test]
    fn a_low_wall_hides_from_the_camera_what_the_lidar_sees_above_it() {
        let mut scene = scene_ahead();
        scene.scenery = vec![block([3.0, -10.0, 0.0], [3.2, 10.0, 1.68])].into();
        let boxes = with_view(&scene, |view| {
            truth_boxes(view, &Lidar::hdl64e().sweep_labelled(view, 1))
        });
        let seen = [boxes[0].visibility, boxes[0].camera_visibility];
        assert!(seen[0] > 0.4 && seen[1].abs() < 1e-12, "{seen:?}");
    }

    #[test]
    fn a_crest_hides_what_is_behind_it() {
        let mut scene = scene_ahead();
        let ridge = |p: Vector2<f64>| 3.0 * (-(p.x - 8.0).powi(2) / 8.0).exp();
        let ridge = Terrain::sampled(Vector2::zeros(), 40.0, 0.5, ridge);
        assert_eq!(with_view(&scene, |view| truth_detections(view).len()), 1);
        scene.terrain = Arc::new(ridge);
        assert_eq!(with_view(&scene, |view| truth_detections(view).len()), 0);
    }
}
