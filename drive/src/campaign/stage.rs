use covista_world::{Action, LaneIndex, StationId, VehicleDimensions};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::{
    broken::Broken,
    exact::SafeSet,
    other::{Motion, Other, Script, Sideways, TOP_MPS, draw_dimensions, follow},
    scenario::{Cast, EGO},
};
use crate::TrueVehicle;

/// Where the others are put.
pub(super) struct Stage<'a> {
    pub set: SafeSet<'a>,
    pub ego: TrueVehicle,
    pub lane: LaneIndex,
    pub broken: Option<Broken>,
    pub cast: Vec<Cast>,
    /// The only lane change that is to be asked for.
    pub side: Option<Action>,
}

impl Stage<'_> {
    fn brake_mps2(&self) -> f64 {
        match self.broken {
            Some(Broken::LeaderBraking) => 12.0,
            _ => self.set.settings.leader_brake_mps2,
        }
    }

    /// A vehicle in `lane` towards which the ego vehicle's h is `h_m`, as if it were in that lane.
    fn ahead(
        &self,
        lane: LaneIndex,
        speed_mps: f64,
        h_m: f64,
        dimensions: VehicleDimensions,
        dice: &mut ChaCha8Rng,
    ) -> Other {
        let road = self.set.road;
        let room_m = 0.5 * (road.lane_width_m() - dimensions.width_m) - 0.1;
        let d_m = road.lane_center_m(lane) + dice.random_range(-1.0..1.0) * room_m.min(0.5);
        let s_m = self.ego.s_range_m[1] + 20.0 + h_m.max(0.0);
        let motion = Motion {
            s_m,
            d_m,
            speed_mps,
            sideways_mps: 0.0,
        };
        let id = self.cast.len() as u32 + 1;
        let mut other = Other::new(id, dimensions, motion, self.brake_mps2());
        for _ in 0..8 {
            let truth = other.truth(road);
            let levels = self.set.levels(&self.ego, &truth, speed_mps, lane, 0.5);
            let stretch = 1.0 - road.curvature(other.now.s_m) * road.lane_center_m(lane);
            other.now.s_m += (h_m - levels.set_h_m) / stretch;
        }
        // From rounding to the safe side.
        other.now.s_m += 1e-7;
        other
    }

    fn push(&mut self, other: Other, is_shared: bool) {
        let is_missed = self.broken == Some(Broken::MissedObject);
        self.cast.push(Cast {
            other,
            is_shared: is_shared && !is_missed,
            is_missed,
        });
    }

    /// What is missed is missed from afar: for longer than finding it may take.
    fn unnoticed_m(&self) -> f64 {
        match self.broken {
            Some(Broken::MissedObject) => 60.0,
            _ => 0.0,
        }
    }

    fn leader_speed(&self, dice: &mut ChaCha8Rng) -> f64 {
        let v = self.ego.speed_mps;
        match dice.random_range(0..4) {
            0 => dice.random_range(0.0..TOP_MPS),
            1 => (v + dice.random_range(-3.0..3.0)).clamp(0.0, TOP_MPS),
            2 => v,
            _ => dice.random_range(0.0..=v.max(1.0)),
        }
    }

    pub fn leaders(&mut self, dice: &mut ChaCha8Rng) {
        let count = dice.random_range(1..=3);
        for index in 0..count {
            let speed_mps = self.leader_speed(dice);
            let h_m = self.unnoticed_m() + margin_m(dice) + 3.0 * f64::from(index);
            let dimensions = draw_dimensions(dice);
            let mut other = self.ahead(self.lane, speed_mps, h_m, dimensions, dice);
            other.script = leader_script(dice);
            self.push(other, true);
        }
    }

    pub fn standing(&mut self, sight_range_m: f64, dice: &mut ChaCha8Rng) {
        let dimensions = draw_dimensions(dice);
        let far = dice.random_bool(0.5);
        let h_m = if far {
            sight_range_m + dice.random_range(-30.0..30.0)
        } else {
            self.unnoticed_m() + margin_m(dice)
        };
        let other = self.ahead(self.lane, 0.0, h_m, dimensions, dice);
        let is_shared = dice.random_bool(0.3) || !far;
        self.push(other, is_shared);
    }

    /// A vehicle beside or ahead in the next lane, which comes over after a while.
    pub fn cut_in(&mut self, dice: &mut ChaCha8Rng) {
        if dice.random_bool(0.5) {
            let speed_mps = self.leader_speed(dice);
            let h_m = margin_m(dice) + 10.0;
            let dimensions = draw_dimensions(dice);
            let mut leader = self.ahead(self.lane, speed_mps, h_m, dimensions, dice);
            leader.script = leader_script(dice);
            self.push(leader, true);
        }
        let Some(beside) = self.next_lane(dice) else {
            return;
        };
        let inside = self.broken == Some(Broken::CutIn);
        let v = self.ego.speed_mps;
        let speed_mps = (v + dice.random_range(-4.0..6.0)).clamp(2.0, TOP_MPS);
        let h_m = if inside {
            dice.random_range(-12.0..-4.0)
        } else {
            dice.random_range(-15.0..30.0)
        };
        let dimensions = draw_dimensions(dice);
        let mut other = self.ahead(beside, speed_mps, h_m, dimensions, dice);
        other.script = if dice.random() {
            Script::Hold
        } else {
            leader_script(dice)
        };
        other.sideways = Some(Sideways {
            start: dice.random_range(1..400),
            steps: dice.random_range(200..500),
            to_m: self.set.road.lane_center_m(self.lane),
        });
        self.push(other, true);
    }

    /// A leader that leaves the lane, and what it hid.
    pub fn cut_out(&mut self, dice: &mut ChaCha8Rng) {
        let Some(beside) = self.next_lane(dice) else {
            return;
        };
        let inside = self.broken == Some(Broken::Revealed);
        let v = self.ego.speed_mps;
        let speed_mps = (v + dice.random_range(-2.0..4.0)).clamp(5.0, TOP_MPS);
        let dimensions = draw_dimensions(dice);
        let h_m = margin_m(dice);
        let mut leader = self.ahead(self.lane, speed_mps, h_m, dimensions, dice);
        leader.script = if dice.random() {
            Script::Hold
        } else {
            Script::Random { period: 80 }
        };
        leader.sideways = Some(Sideways {
            start: dice.random_range(1..300),
            steps: dice.random_range(150..400),
            to_m: self.set.road.lane_center_m(beside),
        });
        self.push(leader, true);
        let hidden_mps = if dice.random_bool(0.7) {
            0.0
        } else {
            dice.random_range(0.0..=v.max(1.0))
        };
        let dimensions = draw_dimensions(dice);
        // The leader moves on before it leaves: so far ahead that the reveal is at about the edge.
        let h_m = dice.random_range(0.0..60.0);
        let hidden = self.ahead(self.lane, hidden_mps, h_m, dimensions, dice);
        let is_shared = !inside && dice.random_bool(0.3);
        self.push(hidden, is_shared);
    }

    pub fn lane_change(&mut self, dice: &mut ChaCha8Rng) {
        let Some(target) = self.next_lane(dice) else {
            return;
        };
        let follower_only = self.broken.is_some_and(Broken::is_about_followers);
        if follower_only {
            let is_left = self.lane.left() == Some(target);
            self.side = Some(if is_left {
                Action::ChangeLeft
            } else {
                Action::ChangeRight
            });
        }
        let mut lanes = vec![self.lane, target];
        if !follower_only && dice.random() {
            lanes.extend(LaneIndex::all().find(|lane| *lane != self.lane && *lane != target));
        }
        for lane in lanes {
            let mut speed_mps = self.leader_speed(dice);
            let mut h_m = margin_m(dice);
            if follower_only {
                (speed_mps, h_m) = (self.ego.speed_mps, dice.random_range(5.0..15.0));
            }
            let dimensions = draw_dimensions(dice);
            let mut other = self.ahead(lane, speed_mps, h_m, dimensions, dice);
            other.script = if follower_only {
                Script::BrakeFrom(dice.random_range(50..200))
            } else {
                leader_script(dice)
            };
            if dice.random() {
                other.station = Some(StationId(other.id + 10));
                other.is_heard = dice.random_bool(0.7);
            }
            // A CAV beyond the target lane may want that, too.
            let is_beyond = lane != self.lane && lane != target;
            if is_beyond && other.station.is_some() && dice.random() {
                other.sideways = Some(Sideways {
                    start: dice.random_range(31..500),
                    steps: dice.random_range(250..500),
                    to_m: self.set.road.lane_center_m(target),
                });
            }
            self.push(other, true);
        }
        if follower_only || dice.random_bool(0.7) {
            self.follower(target, dice);
        }
    }

    fn follower(&mut self, lane: LaneIndex, dice: &mut ChaCha8Rng) {
        let safety = self.set.settings;
        let v = self.ego.speed_mps;
        let slowest = if self.broken.is_some() { 0.0 } else { -5.0 };
        let speed_mps = (v + dice.random_range(slowest..8.0)).clamp(0.0, TOP_MPS);
        let is_cav = self.broken.is_none() && dice.random_bool(0.4);
        let rho = if is_cav {
            safety.reaction_cav_s
        } else {
            safety.reaction_human_s
        };
        let dimensions = draw_dimensions(dice);
        let top = speed_mps + rho * safety.follower_accel_mps2;
        let stop_m = speed_mps * rho + top * top / (2.0 * safety.follower_brake_mps2);
        let closed_m = (stop_m - v * v / (2.0 * safety.brake_mps2)).max(0.0);
        let keep_m = safety.headway_safe_m - 0.5 * (dimensions.length_m + EGO.length_m);
        let spare_m = if self.side.is_some() {
            dice.random_range(2.0..20.0)
        } else {
            dice.random_range(-1.0..12.0)
        };
        let room_m = closed_m + keep_m + spare_m;
        let road = self.set.road;
        let motion = Motion {
            s_m: self.ego.s_range_m[0] - room_m - dimensions.length_m / 2.0,
            d_m: road.lane_center_m(lane),
            speed_mps,
            sideways_mps: 0.0,
        };
        let id = self.cast.len() as u32 + 1;
        let mut other = Other::new(id, dimensions, motion, safety.follower_brake_mps2);
        other.accel_max_mps2 = safety.follower_accel_mps2;
        other.script = match self.broken {
            Some(Broken::FollowerAcceleration) => {
                other.accel_max_mps2 = 3.0;
                Script::Follow {
                    reaction_s: 2.5,
                    accel_mps2: 3.0,
                    brake_mps2: safety.follower_brake_mps2,
                    promised_mps2: safety.follower_brake_mps2,
                }
            }
            Some(Broken::FollowerBraking) => Script::Follow {
                reaction_s: rho,
                accel_mps2: safety.follower_accel_mps2,
                brake_mps2: 0.4 * safety.follower_brake_mps2,
                promised_mps2: safety.follower_brake_mps2,
            },
            _ => follow(safety, rho),
        };
        if is_cav {
            other.station = Some(StationId(id + 10));
            other.is_heard = dice.random_bool(0.7);
        }
        self.push(other, true);
    }

    fn next_lane(&self, dice: &mut ChaCha8Rng) -> Option<LaneIndex> {
        match (self.lane.left(), self.lane.right()) {
            (Some(left), Some(right)) => Some(if dice.random() { left } else { right }),
            (left, right) => left.or(right),
        }
    }
}

/// h at the start: most often within two metres of the edge of the set.
fn margin_m(dice: &mut ChaCha8Rng) -> f64 {
    match dice.random_range(0..10) {
        0 => 0.0,
        1..7 => dice.random_range(0.0..2.0),
        _ => dice.random_range(0.0..60.0),
    }
}

fn leader_script(dice: &mut ChaCha8Rng) -> Script {
    let period = dice.random_range(10..150);
    match dice.random_range(0..5) {
        0 => Script::BrakeFrom(dice.random_range(0..300)),
        1 => Script::BangBang { period },
        2 => Script::StopAndGo { wait: 2 * period },
        3 => Script::Hold,
        _ => Script::Random { period },
    }
}
