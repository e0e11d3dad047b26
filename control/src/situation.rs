use covista_world::{BicycleState, FrenetPose, Road, StationId, VehicleDimensions};
use nalgebra::Vector2;

use crate::{Neighbour, RoadProfile, SightLine};

/// All that the controller knows at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Situation<'a> {
    /// The road, with what its curves allow.
    pub profile: &'a RoadProfile,
    /// The ego vehicle.
    pub ego: EgoState,
    /// Every other vehicle that it knows of.
    pub neighbours: &'a [Neighbour],
    /// How far each lane ahead is confirmed free.
    pub sight: &'a SightLine,
    /// Time in seconds.
    pub time_s: f64,
    /// Speed that the reference strives for, in m/s.
    pub desired_speed_mps: f64,
}

impl<'a> Situation<'a> {
    /// The road.
    pub fn road(&self) -> &'a Road {
        self.profile.road()
    }
}

/// The ego vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoState {
    /// Its station id, which breaks ties between announcements.
    pub station: StationId,
    /// Rear axle in the world, and speed.
    pub state: BicycleState,
    /// Its dimensions.
    pub dimensions: VehicleDimensions,
    /// Rear axle on the road.
    pub frenet: FrenetPose,
}

impl EgoState {
    /// Places the vehicle on the road.
    pub fn new(
        station: StationId,
        state: BicycleState,
        dimensions: VehicleDimensions,
        road: &Road,
    ) -> Self {
        Self {
            station,
            state,
            dimensions,
            frenet: road.to_frenet_pose(state.pose),
        }
    }

    /// Rear axle to front bumper.
    pub(crate) fn front_m(&self) -> f64 {
        self.dimensions.length_m - self.dimensions.rear_overhang_m
    }

    /// Distance from the rear axle within which the body's front lies at any heading.
    pub(crate) fn front_reach_m(&self) -> f64 {
        self.front_m().hypot(self.dimensions.width_m / 2.0)
    }

    /// Distance from the rear axle within which the body's rear lies at any heading.
    pub(crate) fn rear_reach_m(&self) -> f64 {
        self.dimensions
            .rear_overhang_m
            .hypot(self.dimensions.width_m / 2.0)
    }

    /// Offsets d (right, left) between which the body lies.
    #[cfg(test)]
    pub(crate) fn lateral_extent_m(&self, road: &Road) -> (f64, f64) {
        lateral_extent_m(
            self.dimensions
                .corners_from_axle()
                .map(|corner| self.state.pose.transform(corner)),
            road,
            self.frenet.s_m,
        )
    }

    pub(crate) fn is_finite(&self) -> bool {
        let BicycleState { pose, speed_mps } = self.state;
        [
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
            speed_mps,
            self.frenet.s_m,
            self.frenet.d_m,
            self.frenet.psi_rad,
            self.frenet.curvature_per_m,
            self.dimensions.length_m,
            self.dimensions.width_m,
            self.dimensions.wheelbase_m,
            self.dimensions.rear_overhang_m,
        ]
        .iter()
        .all(|x| x.is_finite())
    }
}

pub(crate) fn lateral_extent_m(
    corners: [Vector2<f64>; 4],
    road: &Road,
    s_hint_m: f64,
) -> (f64, f64) {
    corners
        .iter()
        .map(|&corner| road.to_frenet_near(corner, s_hint_m).d_m)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), d| {
            (low.min(d), high.max(d))
        })
}
