use covista_control::SafetySettings;
use covista_world::{LANE_COUNT, LaneIndex, Road, STEP_S};

use crate::TrueVehicle;

/// The barriers of one vehicle towards one ahead of it, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Levels {
    /// h of the true bumpers, without any allowance.
    pub h_m: f64,
    /// h_0 in the same way.
    pub h0_m: f64,
    /// h in the set's own definition: with noise, rates and the bodies' reach.
    pub set_h_m: f64,
    /// h_0 in the set's own definition.
    pub set_h0_m: f64,
    /// Distance of the bodies' centres: the bumper gap and half of both lengths.
    pub headway_m: f64,
}

/// A vehicle ahead, as it is or as it may be.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    /// Road s of its rearmost point.
    pub rear_s_m: f64,
    /// Speed along its lane.
    pub speed_mps: f64,
    pub length_m: f64,
}

/// The safe set, computed here once more and step by step.
///
/// ```text
/// D(v, v_k) = sup over n of  sum_{i<n} (c_max (v_i Ts + W_p) - c_min v_k,i Ts)
/// h         = gap - P_bumper - D,   h_0 = gap - 2 m - D
/// ```
///
/// What is invariant is the set in its own definition: with the noise in D, with c_max and c_min of
/// the road, and with the gap between two circles, that round the rear axle which holds the ego
/// vehicle's front at any heading, and that round the centre of the vehicle ahead which holds its
/// body. Each of these only takes from h, so that the plain h, between the true bumpers with c = 1
/// and no noise, never lies below it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SafeSet<'a> {
    pub settings: &'a SafetySettings,
    pub road: &'a Road,
}

impl SafeSet<'_> {
    /// The true barriers of `ego` towards `ahead`, which drives along `lane` at `ahead_mps`, when
    /// the ego vehicle's rear axle stays within `lanes_off` lane widths of that lane's centre.
    pub fn levels(
        &self,
        ego: &TrueVehicle,
        ahead: &TrueVehicle,
        ahead_mps: f64,
        lane: LaneIndex,
        lanes_off: f64,
    ) -> Levels {
        let settings = self.settings;
        let half_lengths_m = (ego.dimensions.length_m + ahead.dimensions.length_m) / 2.0;
        let bumpers_m = self.arc_m(lane, ego.s_range_m[1], ahead.s_range_m[0]);
        let plain = SafetySettings {
            noise_position_m: 0.0,
            noise_speed_mps: 0.0,
            ..*settings
        };
        let room_m = bumpers_m - closed_m(&plain, ego.speed_mps, ahead_mps, 1.0, 1.0);
        let body = Body {
            rear_s_m: self.rearmost_s_m(ahead),
            speed_mps: ahead_mps,
            length_m: ahead.dimensions.length_m,
        };
        let set_room_m = self.room_m(ego, body, lane, lanes_off);
        let keep_m = self.keep_m(ego, body.length_m);
        let margin_m = settings.collision_margin_m;
        Levels {
            h_m: room_m - keep_m,
            h0_m: room_m - margin_m,
            set_h_m: set_room_m - keep_m,
            set_h0_m: set_room_m - margin_m,
            headway_m: bumpers_m + half_lengths_m,
        }
    }

    /// h in the set's own definition towards what `body` may be, less what D may be taken larger by
    /// where the noise of its last step is only bounded.
    pub fn known_h_m(&self, ego: &TrueVehicle, body: Body, lane: LaneIndex, lanes_off: f64) -> f64 {
        let bound_m = self.c_max(lanes_off) * self.settings.noise_position_m;
        self.room_m(ego, body, lane, lanes_off) - self.keep_m(ego, body.length_m) - bound_m
    }

    /// P_bumper, and never less than the margin of the collision level.
    pub fn keep_m(&self, ego: &TrueVehicle, length_m: f64) -> f64 {
        let half_lengths_m = (ego.dimensions.length_m + length_m) / 2.0;
        (self.settings.headway_safe_m - half_lengths_m).max(self.settings.collision_margin_m)
    }

    /// Gap less D in the set's own definition.
    fn room_m(&self, ego: &TrueVehicle, body: Body, lane: LaneIndex, lanes_off: f64) -> f64 {
        let reach_m = (ego.dimensions.length_m - ego.dimensions.rear_overhang_m)
            .hypot(ego.dimensions.width_m / 2.0);
        let (c_max, c_min) = (self.c_max(lanes_off), (1.0 - self.rate_share(1.0)).max(0.0));
        let gap_m = self.arc_m(lane, ego.frenet.s_m, body.rear_s_m) - c_max * reach_m;
        gap_m - self.closed_m(ego.speed_mps, body.speed_mps, c_max, c_min)
    }

    fn c_max(&self, lanes_off: f64) -> f64 {
        1.0 + self.rate_share(lanes_off)
    }

    /// By how much a lane may be longer or shorter than what is driven so many lane widths off it.
    fn rate_share(&self, lanes: f64) -> f64 {
        let curvature = self.road.sharpest_per_m();
        let half_road_m = 0.5 * f64::from(LANE_COUNT) * self.road.lane_width_m();
        curvature * lanes * self.road.lane_width_m() / (1.0 - curvature * half_road_m)
    }

    /// Road s of the rearmost point of the circle that holds the body of `vehicle` at any heading
    /// and any offset: seen from the road's centre of curvature it spans asin(r k), k being the
    /// curvature of the sharpest parallel there.
    pub fn rearmost_s_m(&self, vehicle: &TrueVehicle) -> f64 {
        let radius_m = vehicle.half_diagonal_m();
        let center = self.road.to_frenet_near(vehicle.center, vehicle.frenet.s_m);
        let curvature = (self.road).max_abs_curvature(center.s_m - 1.5 * radius_m, center.s_m);
        if curvature < STRAIGHT_PER_M {
            return center.s_m - radius_m;
        }
        let half_road_m = 0.5 * f64::from(LANE_COUNT) * self.road.lane_width_m();
        let parallel = curvature / (1.0 - curvature * half_road_m);
        center.s_m - (radius_m * parallel).min(1.0).asin() / curvature
    }

    /// Arc length of the centre line of `lane`: shorter than the reference line's by its offset
    /// times the angle turned.
    pub fn arc_m(&self, lane: LaneIndex, from_m: f64, to_m: f64) -> f64 {
        let turn_rad = self.road.turn_rad(from_m, to_m);
        (to_m - from_m) - self.road.lane_center_m(lane) * turn_rad
    }

    /// From the front of a follower in `lane`, at road s `front_m`, to the circle round the rear
    /// axle that holds the rear of `ego`: a bumper swings back when the vehicle turns, the circle
    /// does not.
    pub fn gap_behind_m(&self, ego: &TrueVehicle, lane: LaneIndex, front_m: f64) -> f64 {
        let dimensions = ego.dimensions;
        let reach_m = dimensions.rear_overhang_m.hypot(dimensions.width_m / 2.0);
        self.arc_m(lane, front_m, ego.frenet.s_m) - self.c_max(1.0) * reach_m
    }

    /// The way that a follower stops in: one step's speed less in each step.
    pub fn follower_stop_m(&self, speed_mps: f64) -> f64 {
        let brake_mps2 = self.settings.follower_brake_mps2;
        speed_mps.powi(2) / (2.0 * brake_mps2) + 0.5 * speed_mps * STEP_S
    }

    /// The shortest way that the ego vehicle stops in, with all its noise.
    pub fn shortest_stop_m(&self, speed_mps: f64) -> f64 {
        let settings = self.settings;
        let brake_mps2 = settings.brake_mps2 + settings.noise_speed_mps / STEP_S;
        let steps = speed_mps / (settings.brake_mps2 * STEP_S);
        (speed_mps.powi(2) / (2.0 * brake_mps2) - steps * settings.noise_position_m).max(0.0)
    }

    /// D(v, v_k) under the set's settings.
    pub fn closed_m(&self, v_mps: f64, leader_mps: f64, c_max: f64, c_min: f64) -> f64 {
        closed_m(self.settings, v_mps, leader_mps, c_max, c_min)
    }
}

/// A road less curved than this is straight.
const STRAIGHT_PER_M: f64 = 1e-9;

/// D(v, v_k), summed step by step until the ego vehicle stands.
pub(super) fn closed_m(
    settings: &SafetySettings,
    v_mps: f64,
    leader_mps: f64,
    c_max: f64,
    c_min: f64,
) -> f64 {
    let loss_mps = settings.brake_mps2 * STEP_S - settings.noise_speed_mps;
    let leader_loss_mps = settings.leader_brake_mps2 * STEP_S;
    let (mut sum_m, mut most_m) = (0.0_f64, 0.0_f64);
    let (mut own, mut step) = (v_mps, 0.0);
    // Rounding must not add a step of noise to a speed that is a whole number of losses.
    while own > 1e-9 * loss_mps {
        let leader = (leader_mps - step * leader_loss_mps).max(0.0);
        sum_m += c_max * (own * STEP_S + settings.noise_position_m) - c_min * leader * STEP_S;
        most_m = most_m.max(sum_m);
        step += 1.0;
        own = v_mps - step * loss_mps;
    }
    most_m
}

#[cfg(test)]
mod tests {
    use covista_traffic::{VehicleId, VehicleKind};
    use covista_world::{BicycleState, RoadSegment, Se2Pose, VehicleDimensions};

    use super::*;

    #[test]
    fn on_an_arc_a_lane_is_as_long_as_its_radius_times_the_angle() {
        let segment = RoadSegment::Arc {
            length_m: 400.0,
            curvature_per_m: 1.0 / 60.0,
        };
        let road = Road::new(Se2Pose::new(3.0, 1.0, 2.0), &[segment], 3.5).expect("a road");
        let set = SafeSet {
            settings: &SafetySettings::default(),
            road: &road,
        };
        // More than half a turn: angles must not wrap.
        for (lane, radius_m) in LaneIndex::all().zip([56.5, 60.0, 63.5]) {
            let arc_m = set.arc_m(lane, 20.0, 270.0);
            assert!((arc_m - radius_m * 250.0 / 60.0).abs() < 1e-9, "{arc_m}");
        }
    }

    #[test]
    fn braking_to_a_stop_takes_the_parabola_and_half_a_step() {
        let segment = RoadSegment::Straight { length_m: 9.0 };
        let road = Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road");
        let quiet = SafetySettings {
            noise_position_m: 0.0,
            noise_speed_mps: 0.0,
            ..SafetySettings::default()
        };
        let set = SafeSet {
            settings: &quiet,
            road: &road,
        };
        let stop_m = set.closed_m(16.0, 0.0, 1.0, 1.0);
        assert!((stop_m - 16.08).abs() < 1e-9, "{stop_m}");
        assert!(set.closed_m(10.0, 20.0, 1.0, 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_circle_holds_the_body_at_any_heading() {
        let segment = RoadSegment::Arc {
            length_m: 200.0,
            curvature_per_m: -1.0 / 45.0,
        };
        let road = Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road");
        let set = SafeSet {
            settings: &SafetySettings::default(),
            road: &road,
        };
        let dimensions = VehicleDimensions {
            length_m: 12.0,
            width_m: 2.5,
            height_m: 3.0,
            wheelbase_m: 7.0,
            rear_overhang_m: 2.0,
        };
        for d_m in [-5.0, 0.0, 5.0] {
            let mut rears = Vec::new();
            let mut reaches = Vec::new();
            for step in 0..360 {
                let heading_rad = f64::from(step).to_radians();
                let center = road.pose_from_frenet(100.0, d_m, heading_rad);
                let state = BicycleState {
                    pose: dimensions.axle_pose(center),
                    speed_mps: 0.0,
                };
                let id = VehicleId(1);
                let kind = VehicleKind::Human;
                let vehicle = TrueVehicle::new(id, kind, dimensions, state, 100.0, &road);
                rears.push(vehicle.s_range_m[0]);
                reaches.push(set.rearmost_s_m(&vehicle));
            }
            let rear = rears.iter().copied().fold(f64::INFINITY, f64::min);
            for reach in reaches {
                // On the outside of the curve it is farther than it need be.
                assert!(reach <= rear + 1e-6 && reach > rear - 2.0, "{reach} {rear}");
            }
        }
    }
}
