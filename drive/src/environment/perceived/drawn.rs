use std::sync::Arc;

use covista_sensors::{DrawnBox, ErrorModel, Observer, SeenVehicle};
use covista_traffic::{Ring, RingVehicle, VehicleId};
use covista_world::{Calibration, Detection3d, Percept, Se2Pose, wrap_angle};
use nalgebra::Vector3;

use super::super::{perception::Frame, sights::Seen, view::is_open};
use crate::senses::percept;

/// What the networks would have found of the vehicles in line of sight, by their error model.
#[derive(Clone)]
pub(crate) struct Drawn {
    errors: Arc<ErrorModel>,
    // Storage of one frame, used again in the next.
    /// The middles of all bodies where they have driven to.
    centers: Vec<Se2Pose>,
    seen: Vec<SeenVehicle>,
}

impl Drawn {
    /// By these errors.
    pub fn new(errors: ErrorModel) -> Self {
        Self {
            errors: Arc::new(errors),
            centers: Vec::new(),
            seen: Vec::new(),
        }
    }

    /// Every CAV looks: `percepts` are those of each.
    pub fn look(
        &mut self,
        frame: &Frame<'_>,
        calibration: &Calibration,
        percepts: &mut [Vec<Percept>],
    ) {
        let road = frame.ring.road().road();
        let center = |vehicle: &RingVehicle| {
            let pose = vehicle.state(road).pose;
            vehicle.dimensions().center_pose(pose)
        };
        self.centers.clear();
        self.centers
            .extend(frame.ring.vehicles().iter().map(center));
        for (index, percepts) in percepts.iter_mut().enumerate() {
            self.look_from(index, frame, calibration, percepts);
        }
    }

    /// CAV `index` looks.
    fn look_from(
        &mut self,
        index: usize,
        frame: &Frame<'_>,
        calibration: &Calibration,
        percepts: &mut Vec<Percept>,
    ) {
        let (ring, own) = (frame.ring, &frame.cavs[index]);
        let (road, time_s) = (ring.road().road(), ring.time_s());
        let mount = calibration.vehicle_from_lidar.translation.vector;
        let lidar = own.state.pose.compose(Se2Pose::new(mount.x, mount.y, 0.0));
        let [least_x, least_y, most_x, most_y] = self.errors.range_m;
        let seen = frame.sights.seen(index).map(|seen| {
            let center = self.centers[seen.vehicle];
            let lap_m = seen.laps * ring.road().lap_m();
            let center = Se2Pose::new(center.x_m + lap_m.x, center.y_m + lap_m.y, center.yaw_rad);
            as_seen(&seen, ring, center, lidar, mount.z)
        });
        self.seen.clear();
        self.seen.extend(seen.filter(|seen| {
            let place = seen.truth.center_m;
            (least_x..=most_x).contains(&place.x) && (least_y..=most_y).contains(&place.y)
        }));
        let observer = Observer {
            seed: ring.settings().seed,
            ego: VehicleId(own.station.0),
            time_s,
            lidar,
            road: Some(road),
        };
        let (eye, bodies) = frame.sights.about(index);
        let is_in_sight = |drawn: &DrawnBox| {
            let place = lidar.transform(drawn.detection.center_m.xy());
            let point = road.to_frenet_near(place, eye[0]);
            drawn.of.is_some() || is_open(eye, bodies, [point.s_m, point.d_m])
        };
        let drawn = self.errors.draw(&self.seen, &observer).into_iter();
        let found = drawn
            .filter(is_in_sight)
            .map(|drawn| percept(calibration, drawn.detection, drawn.lane));
        percepts.clear();
        percepts.extend(found);
    }
}

/// A vehicle with its body's centre at `center` in the world, as the error model takes it.
fn as_seen(
    seen: &Seen<'_>,
    ring: &Ring,
    center: Se2Pose,
    lidar: Se2Pose,
    lidar_height_m: f64,
) -> SeenVehicle {
    let vehicle = &ring.vehicles()[seen.vehicle];
    let size = vehicle.dimensions();
    let place = lidar.inverse_transform(center.position());
    SeenVehicle {
        id: vehicle.id,
        truth: Detection3d {
            center_m: place.push(size.height_m / 2.0 - lidar_height_m),
            size_m: Vector3::new(size.length_m, size.width_m, size.height_m),
            yaw_rad: wrap_angle(center.yaw_rad - lidar.yaw_rad),
            class: vehicle.model.class(),
            score: 1.0,
        },
        lane: ring.road().road().lane_at(seen.body.middle()[1]),
        visibility: seen.visibility,
    }
}
