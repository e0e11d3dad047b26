use covista_world::LaneIndex;
use serde::{Deserialize, Serialize};

use crate::{ActionValues, Manoeuvre, Neighbour, Observation, Policy};

/// How [`FreeLane`] weighs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FreeLaneSettings {
    /// How far it looks ahead in time, in seconds.
    pub horizon_s: f64,
    /// What a lane change costs in seconds: its time and comfort, and the gain below which
    /// nobody bothers.
    pub lane_change_cost_s: f64,
    /// How long a lane change takes, in seconds.
    pub lane_change_s: f64,
    /// What giving up a lane change costs, in seconds.
    pub abort_cost_s: f64,
    /// Gap that is left to a vehicle ahead at the end of the horizon, in metres.
    pub standstill_gap_m: f64,
    /// What a lane occupied right ahead is worth less than a lane free over the horizon, in
    /// seconds: it decides between lanes of equal delay.
    pub free_distance_weight_s: f64,
    /// A vehicle whose speed is known less well than this is taken to move with the traffic.
    pub known_speed_std_mps: f64,
}

impl Default for FreeLaneSettings {
    fn default() -> Self {
        Self {
            horizon_s: 12.0,
            lane_change_cost_s: 2.5,
            lane_change_s: 5.0,
            abort_cost_s: 4.0,
            standstill_gap_m: 4.0,
            free_distance_weight_s: 0.3,
            known_speed_std_mps: 4.0,
        }
    }
}

/// Prefers the lane with the least delay over the horizon and, of equals, the longest free
/// distance.
///
/// A vehicle k ahead in a lane, whose rear bumper is at gap g_k and which moves at v_k, lets us
/// come no further than g_k + v_k t - `standstill_gap_m` in the time t. The smallest of these
/// bounds is how far the lane lets us come; what is missing to v_desired t, as time at v_desired,
/// is the lane's delay. A vehicle that moves towards a standing one is bound by the standing one's
/// row: it inherits its stop. The value of an action is minus the delay of the lane it leads to
/// and minus its cost; a lane two over is worth what it allows or what the passage through the
/// next lane allows, whichever is less.
///
/// While a lane change runs, its action stands for going on and [`covista_world::Action::KeepLane`] for going
/// back to the old lane; going back is preferred when the new lane became slower than the old one
/// by more than `abort_cost_s`. Whether a running change can be taken back is the controller's
/// business.
///
/// Who comes from behind is the verdict's business, not the policy's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FreeLane {
    /// Its weights.
    pub settings: FreeLaneSettings,
}

impl Policy for FreeLane {
    fn values(&mut self, observation: &Observation) -> ActionValues {
        match observation.manoeuvre {
            Manoeuvre::KeepingLane => {
                let value = |next: Option<LaneIndex>, beyond| {
                    next.map_or(f64::NEG_INFINITY, |next| {
                        self.change_value(observation, next, beyond)
                    })
                };
                let lane = observation.lane;
                let (left, right) = (lane.left(), lane.right());
                ActionValues {
                    keep_lane: -self.cost_s(observation, lane),
                    change_left: value(left, left.and_then(LaneIndex::left)),
                    change_right: value(right, right.and_then(LaneIndex::right)),
                }
            }
            Manoeuvre::ChangingLane { from, to, .. } => {
                let go_on = -self.cost_s(observation, to);
                let go_back = -self.cost_s(observation, from) - self.settings.abort_cost_s;
                let to_the_left = to < from;
                let value = |goes_on: bool| if goes_on { go_on } else { f64::NEG_INFINITY };
                ActionValues {
                    keep_lane: go_back,
                    change_left: value(to_the_left),
                    change_right: value(!to_the_left),
                }
            }
        }
    }
}

impl FreeLane {
    /// Minus the cost of changing to `next`, or through it to the lane `beyond`.
    fn change_value(
        &self,
        observation: &Observation,
        next: LaneIndex,
        beyond: Option<LaneIndex>,
    ) -> f64 {
        let change_s = self.settings.lane_change_cost_s;
        let stay_s = change_s + self.cost_s(observation, next);
        let pass_s = beyond.map_or(f64::INFINITY, |beyond| {
            let passage_s = self.delay_s(observation, next, self.settings.lane_change_s);
            2.0 * change_s + self.cost_s(observation, beyond).max(passage_s)
        });
        -stay_s.min(pass_s)
    }

    /// The delay over the horizon, and a little for what is not free.
    fn cost_s(&self, observation: &Observation, lane: LaneIndex) -> f64 {
        let horizon_s = self.settings.horizon_s;
        let horizon_m = wanted_mps(observation) * horizon_s;
        let free_m = ahead(observation, lane)
            .map(|neighbour| gap_m(observation, neighbour))
            .fold(horizon_m, f64::min)
            .max(0.0);
        self.delay_s(observation, lane, horizon_s)
            + self.settings.free_distance_weight_s * (1.0 - free_m / horizon_m)
    }

    /// Delay after `time_s` in `lane` against driving at the desired speed, in seconds.
    fn delay_s(&self, observation: &Observation, lane: LaneIndex, time_s: f64) -> f64 {
        let wanted_mps = wanted_mps(observation);
        let wanted_m = wanted_mps * time_s;
        let allowed_m = ahead(observation, lane)
            .filter(|neighbour| neighbour.speed_std_mps < self.settings.known_speed_std_mps)
            .map(|neighbour| {
                gap_m(observation, neighbour) + neighbour.speed_mps.max(0.0) * time_s
                    - self.settings.standstill_gap_m
            })
            .fold(wanted_m, f64::min)
            .max(0.0);
        (wanted_m - allowed_m) / wanted_mps
    }
}

/// The desired speed, above zero so that it can divide.
fn wanted_mps(observation: &Observation) -> f64 {
    observation.desired_speed_mps.max(1.0)
}

/// The vehicles ahead that are in `lane` or announced to enter it.
fn ahead(observation: &Observation, lane: LaneIndex) -> impl Iterator<Item = &Neighbour> {
    observation.neighbours.iter().filter(move |neighbour| {
        (neighbour.lane == Some(lane) || neighbour.entering == Some(lane))
            && neighbour.s_m > observation.s_m
    })
}

/// From own front bumper to the other's rear bumper.
fn gap_m(observation: &Observation, neighbour: &Neighbour) -> f64 {
    neighbour.s_m - observation.s_m - (neighbour.length_m + observation.length_m) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::Action;
    use proptest::prelude::*;

    const DESIRED_MPS: f64 = 14.0;

    fn lane(index: u8) -> LaneIndex {
        LaneIndex::new(index).expect("a lane")
    }

    fn vehicle(lane_index: u8, ahead_m: f64, speed_mps: f64) -> Neighbour {
        Neighbour {
            id: 0,
            station: None,
            lane: Some(lane(lane_index)),
            entering: None,
            s_m: 100.0 + ahead_m,
            d_m: 3.5 * (1.0 - f64::from(lane_index)),
            speed_mps,
            speed_std_mps: 0.5,
            length_m: 4.6,
            width_m: 1.9,
            age_s: 0.0,
            action: None,
        }
    }

    fn seen_from(own_lane: u8, neighbours: &[Neighbour]) -> Observation {
        Observation {
            lane: lane(own_lane),
            s_m: 100.0,
            d_m: 3.5 * (1.0 - f64::from(own_lane)),
            psi_rad: 0.0,
            speed_mps: 14.0,
            length_m: 4.6,
            desired_speed_mps: DESIRED_MPS,
            manoeuvre: Manoeuvre::KeepingLane,
            curvature_per_m: 0.0,
            neighbours: neighbours.to_vec(),
        }
    }

    fn best(observation: &Observation) -> Action {
        FreeLane::default().values(observation).in_order()[0]
    }

    #[test]
    fn an_empty_road_is_no_reason_to_change() {
        for own in 0..3 {
            assert_eq!(best(&seen_from(own, &[])), Action::KeepLane);
        }
    }

    #[test]
    fn the_delay_is_the_time_that_is_missing() {
        let policy = FreeLane::default();
        // 60.6 m between centres: 56 m between bumpers, 52 m to where we would stop.
        let observation = seen_from(0, &[vehicle(0, 60.6, 0.0)]);
        let delay_s = policy.delay_s(&observation, lane(0), 12.0);
        assert!((delay_s - (12.0 - 52.0 / 14.0)).abs() < 1e-12);
        let slower = seen_from(0, &[vehicle(0, 8.6, 10.5)]);
        let delay_s = policy.delay_s(&slower, lane(0), 12.0);
        assert!((delay_s - 0.25 * 12.0).abs() < 1e-12);
    }

    #[test]
    fn a_standing_vehicle_is_left_for_the_next_lane_well_before_it() {
        assert_eq!(
            best(&seen_from(0, &[vehicle(0, 110.0, 0.0)])),
            Action::ChangeRight
        );
        assert_eq!(
            best(&seen_from(2, &[vehicle(2, 110.0, 0.0)])),
            Action::ChangeLeft
        );
        assert_eq!(
            best(&seen_from(1, &[vehicle(0, 110.0, 0.0)])),
            Action::KeepLane
        );
    }

    #[test]
    fn who_follows_a_moving_vehicle_towards_a_standing_one_leaves_too() {
        let observation = seen_from(0, &[vehicle(0, 30.0, 14.0), vehicle(0, 100.0, 0.0)]);
        assert_eq!(best(&observation), Action::ChangeRight);
    }

    #[test]
    fn nobody_changes_for_a_vehicle_a_fifth_slower() {
        for ahead_m in [10.0, 20.0, 30.0, 60.0] {
            let observation = seen_from(1, &[vehicle(1, ahead_m, 0.81 * DESIRED_MPS)]);
            assert_eq!(best(&observation), Action::KeepLane);
        }
        let crawling = seen_from(1, &[vehicle(1, 20.0, 0.5 * DESIRED_MPS)]);
        assert_ne!(best(&crawling), Action::KeepLane);
    }

    #[test]
    fn the_lane_two_over_is_reached_through_the_next() {
        let blocked = vehicle(0, 90.0, 0.0);
        let passable = seen_from(0, &[blocked, vehicle(1, 120.0, 0.0)]);
        assert_eq!(best(&passable), Action::ChangeRight);
        let closed = seen_from(0, &[blocked, vehicle(1, 12.0, 0.0)]);
        let (near, far) = (
            FreeLane::default().values(&closed).change_right,
            FreeLane::default().values(&passable).change_right,
        );
        assert!(near < far - 1.0, "{near} {far}");
    }

    #[test]
    fn who_announced_a_lane_counts_in_it() {
        let mut entering = vehicle(0, 20.0, 5.0);
        entering.entering = Some(lane(1));
        let value = |neighbour| {
            FreeLane::default()
                .values(&seen_from(1, &[neighbour]))
                .keep_lane
        };
        assert!(value(entering) < value(vehicle(0, 20.0, 5.0)) - 3.0);
    }

    #[test]
    fn a_vehicle_of_unknown_speed_is_no_reason_yet() {
        let mut new = vehicle(1, 40.0, 0.0);
        new.speed_std_mps = 10.0;
        assert_eq!(best(&seen_from(1, &[new])), Action::KeepLane);
    }

    #[test]
    fn a_lane_change_goes_on_unless_its_lane_became_much_worse() {
        let changing = |neighbours: &[Neighbour]| Observation {
            manoeuvre: Manoeuvre::ChangingLane {
                from: lane(0),
                to: lane(1),
                progress: 0.3,
            },
            ..seen_from(0, neighbours)
        };
        assert_eq!(best(&changing(&[])), Action::ChangeRight);
        assert_eq!(
            best(&changing(&[vehicle(1, 20.0, 11.0)])),
            Action::ChangeRight
        );
        assert_eq!(best(&changing(&[vehicle(1, 40.0, 0.0)])), Action::KeepLane);
        let both = [vehicle(0, 35.0, 0.0), vehicle(1, 40.0, 0.0)];
        assert_eq!(best(&changing(&both)), Action::ChangeRight);
    }

    fn mirrored(observation: &Observation) -> Observation {
        let mirror = |lane: LaneIndex| self::lane(2 - lane.get());
        let mut mirrored = observation.clone();
        mirrored.lane = mirror(observation.lane);
        mirrored.d_m = -observation.d_m;
        mirrored.psi_rad = -observation.psi_rad;
        mirrored.curvature_per_m = -observation.curvature_per_m;
        if let Manoeuvre::ChangingLane { from, to, progress } = observation.manoeuvre {
            mirrored.manoeuvre = Manoeuvre::ChangingLane {
                from: mirror(from),
                to: mirror(to),
                progress,
            };
        }
        for neighbour in &mut mirrored.neighbours {
            neighbour.lane = neighbour.lane.map(mirror);
            neighbour.entering = neighbour.entering.map(mirror);
            neighbour.d_m = -neighbour.d_m;
        }
        mirrored
    }

    fn any_vehicle() -> impl Strategy<Value = Neighbour> {
        (0..3_u8, -80.0..200.0_f64, 0.0..20.0_f64, 0..4_u8).prop_map(
            |(lane_index, ahead_m, speed_mps, entering)| Neighbour {
                entering: LaneIndex::new(entering),
                ..vehicle(lane_index, ahead_m, speed_mps)
            },
        )
    }

    proptest! {
        #[test]
        fn left_and_right_are_alike(
            own in 0..3_u8,
            changes in any::<bool>(),
            neighbours in prop::collection::vec(any_vehicle(), 0..8),
        ) {
            let mut observation = seen_from(own, &neighbours);
            if let (true, Some(to)) = (changes, lane(own).right()) {
                observation.manoeuvre = Manoeuvre::ChangingLane { from: lane(own), to, progress: 0.5 };
            }
            let values = FreeLane::default().values(&observation);
            let mirror = FreeLane::default().values(&mirrored(&observation));
            let swapped = ActionValues {
                change_left: mirror.change_right,
                change_right: mirror.change_left,
                ..mirror
            };
            prop_assert_eq!(values, swapped);
        }

        #[test]
        fn a_vehicle_more_never_makes_a_lane_better(
            neighbours in prop::collection::vec(any_vehicle(), 0..8),
            extra in any_vehicle(),
        ) {
            let policy = FreeLane::default();
            let before = seen_from(1, &neighbours);
            let mut after = before.clone();
            after.neighbours.push(extra);
            for lane in LaneIndex::all() {
                prop_assert!(policy.cost_s(&after, lane) >= policy.cost_s(&before, lane));
            }
        }
    }
}
