use covista_control::SafetySettings;
use covista_world::{LANE_COUNT, LaneIndex, Road, STEP_S};

use crate::TrueVehicle;

/// The true barriers of one vehicle towards one ahead of it, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Levels {
    /// h of the true bumpers, without any allowance.
    pub h_m: f64,
    /// h_0 in the same way.
    pub h0_m: f64,
    /// h in the set's own definition: with noise, rates and the body's reach.
    pub set_h_m: f64,
    /// Distance of the bodies' centres: the bumper gap and half of both lengths.
    pub headway_m: f64,
}

/// The safe set on the truth, computed here once more and step by step.
///
/// ```text
/// D(v, v_k) = sup over n of  sum_{i<n} ((c_max v_i - c_min v_k,i) Ts + W_p)
/// h         = gap - P_bumper - D,   h_0 = gap - 2 m - D
/// ```
///
/// What is invariant is the set in its own definition: with the noise in D, with c_max and c_min of
/// the road, and with the gap measured from the circle round the rear axle that holds the body's
/// front at any heading. Each of these only takes from h, so that the plain h, between the true
/// bumpers with c = 1 and no noise, never lies below it. Episodes begin inside the set's own
/// definition, and both are watched.
#[derive(Debug, Clone, Copy)]
pub(super) struct SafeSet<'a> {
    pub settings: &'a SafetySettings,
    pub road: &'a Road,
}

impl SafeSet<'_> {
    /// The barriers of `ego` towards `ahead`, which drives along `lane` at `ahead_mps`, when the ego vehicle's rear axle stays
    /// within `lanes_off` lane widths of that lane's centre.
    pub fn levels(
        &self,
        ego: &TrueVehicle,
        ahead: &TrueVehicle,
        ahead_mps: f64,
        lane: LaneIndex,
        lanes_off: f64,
    ) -> Levels {
        let share = |lanes: f64| {
            let curvature = self.road.sharpest_per_m();
            let half_road_m = 0.5 * f64::from(LANE_COUNT) * self.road.lane_width_m();
            curvature * lanes * self.road.lane_width_m() / (1.0 - curvature * half_road_m)
        };
        let (c_max, c_min) = (1.0 + share(lanes_off), (1.0 - share(0.5)).max(0.0));
        let reach_m = (ego.dimensions.length_m - ego.dimensions.rear_overhang_m)
            .hypot(ego.dimensions.width_m / 2.0);
        let rear_m = ahead.s_range_m[0];
        let half_lengths_m = (ego.dimensions.length_m + ahead.dimensions.length_m) / 2.0;
        let keep_m = self.settings.headway_safe_m - half_lengths_m;
        let bumpers_m = self.arc_m(lane, ego.s_range_m[1], rear_m);
        let plain = SafetySettings {
            noise_position_m: 0.0,
            noise_speed_mps: 0.0,
            ..*self.settings
        };
        let v = ego.speed_mps;
        let room_m = bumpers_m - closed_m(&plain, v, ahead_mps, 1.0, 1.0);
        let set_gap_m = self.arc_m(lane, ego.frenet.s_m, rear_m) - c_max * reach_m;
        Levels {
            h_m: room_m - keep_m,
            h0_m: room_m - self.settings.collision_margin_m,
            set_h_m: set_gap_m - keep_m - self.closed_m(v, ahead_mps, c_max, c_min),
            headway_m: bumpers_m + half_lengths_m,
        }
    }

    /// Arc length of the centre line of `lane`: shorter than the reference line's by its offset
    /// times the angle turned.
    pub fn arc_m(&self, lane: LaneIndex, from_m: f64, to_m: f64) -> f64 {
        let turn_rad = self.road.turn_rad(from_m, to_m);
        (to_m - from_m) - self.road.lane_center_m(lane) * turn_rad
    }

    /// D(v, v_k) under the set's settings.
    pub fn closed_m(&self, v_mps: f64, leader_mps: f64, c_max: f64, c_min: f64) -> f64 {
        closed_m(self.settings, v_mps, leader_mps, c_max, c_min)
    }
}

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
        sum_m += (c_max * own - c_min * leader) * STEP_S + settings.noise_position_m;
        most_m = most_m.max(sum_m);
        step += 1.0;
        own = v_mps - step * loss_mps;
    }
    most_m
}

#[cfg(test)]
mod tests {
    use covista_world::{RoadSegment, Se2Pose};

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
}
