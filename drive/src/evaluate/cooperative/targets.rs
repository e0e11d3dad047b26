use covista_traffic::VehicleId;
use covista_world::{Detection3d, Track};
use nalgebra::{Vector2, Vector3};

use crate::{CavSnapshot, Snapshot};

/// Vehicles count whose centre is this near to the ego's reference point, in metres.
const RANGE_M: f64 = 100.0;

/// A vehicle about an ego, as it truly is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Target {
    pub id: VehicleId,
    /// In the world; height above ground and score have no meaning.
    pub footprint: Detection3d,
    /// Of the rear axle in the world, in m/s.
    pub velocity_mps: Vector2<f64>,
    pub within_range: bool,
    /// Such a vehicle tells its own place, where messages arrive.
    pub is_cav: bool,
    pub seen_by_ego: bool,
    /// By the ego or another CAV that it has a link to.
    pub seen_by_a_cav: bool,
}

impl Target {
    /// All vehicles but the ego.
    pub fn about(ego: &CavSnapshot<'_>, snapshot: &Snapshot<'_>) -> Vec<Self> {
        let linked = |cav: VehicleId| {
            let has = |a: VehicleId, b: VehicleId| {
                (snapshot.links.iter()).any(|(one, other)| (one.0, other.0) == (a.0, b.0))
            };
            cav == ego.id || has(cav, ego.id) || has(ego.id, cav)
        };
        let group: Vec<VehicleId> = (snapshot.cavs.iter().map(|cav| cav.id))
            .filter(|&cav| linked(cav))
            .collect();
        let others = (snapshot.traffic.vehicles().iter()).filter(|vehicle| vehicle.id != ego.id);
        others
            .map(|vehicle| {
                let dimensions = vehicle.dimensions();
                let center = dimensions.center_pose(vehicle.state.pose);
                let seen_by = |cav: VehicleId| snapshot.in_sight.contains(&(cav, vehicle.id));
                Self {
                    id: vehicle.id,
                    footprint: Detection3d {
                        center_m: center.position().push(0.0),
                        size_m: Vector3::new(
                            dimensions.length_m,
                            dimensions.width_m,
                            dimensions.height_m,
                        ),
                        yaw_rad: center.yaw_rad,
                        class: vehicle.model.class(),
                        score: 1.0,
                    },
                    velocity_mps: vehicle.state.pose.forward() * vehicle.state.speed_mps,
                    within_range: is_within_range(ego, center.position()),
                    is_cav: snapshot.cavs.iter().any(|cav| cav.id == vehicle.id),
                    seen_by_ego: seen_by(ego.id),
                    seen_by_a_cav: group.iter().any(|&cav| seen_by(cav)),
                }
            })
            .collect()
    }
}

/// Whether a centre is near enough to count.
pub(super) fn is_within_range(ego: &CavSnapshot<'_>, center: Vector2<f64>) -> bool {
    (center - ego.own.pose.position()).norm() <= RANGE_M
}

/// What a track says, as a detection in the world.
pub(super) fn box_of_track(track: &Track) -> Detection3d {
    let state = &track.state;
    Detection3d {
        center_m: state.center.position().push(0.0),
        size_m: Vector3::new(state.length_m, state.width_m, state.height_m),
        yaw_rad: state.center.yaw_rad,
        class: state.class,
        score: track.confidence,
    }
}
