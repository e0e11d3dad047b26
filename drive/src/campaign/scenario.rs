use std::sync::Arc;

use covista_control::{ControlSettings, Controller, EgoState, RoadProfile, SightLine, Situation};
use covista_traffic::{VehicleId, VehicleKind};
use covista_world::{
    Action, BicycleState, LANE_COUNT, LaneIndex, Road, StationId, VehicleDimensions,
};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::{
    CampaignError,
    broken::Broken,
    estimate::{ErrorMode, Estimate, Messages},
    exact::SafeSet,
    nominal::{NoiseMode, Nominal, NominalPolicy},
    other::{Motion, Other, Script, Sideways, TOP_MPS, draw_dimensions, follow},
    road::draw_road,
};
use crate::TrueVehicle;

/// What an episode is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Family {
    /// An empty road: curves, and steering against the edges of the lane.
    Open,
    /// One to three leaders in a row that do their worst.
    Leaders,
    /// A standing vehicle in the lane, known or yet to come into sight.
    Standing,
    /// A vehicle comes into the lane from beside.
    CutIn,
    /// The leader leaves the lane and uncovers a slow or standing vehicle.
    CutOut,
    /// Leaders in two lanes and followers in the next; lane changes whenever the verdict allows.
    LaneChange,
}

impl Family {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Open,
        Self::Leaders,
        Self::Standing,
        Self::CutIn,
        Self::CutOut,
        Self::LaneChange,
    ];

    /// Its name in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Leaders => "leaders",
            Self::Standing => "standing",
            Self::CutIn => "cut-in",
            Self::CutOut => "cut-out",
            Self::LaneChange => "lane-change",
        }
    }
}

/// The ego vehicle: a sedan with the paper's wheelbase.
pub(super) const EGO: VehicleDimensions = VehicleDimensions {
    length_m: 4.6,
    width_m: 1.85,
    height_m: 1.5,
    wheelbase_m: 2.51,
    rear_overhang_m: 0.95,
};
pub(super) const EGO_ID: u32 = 0;
/// Lane changes to either side, and none.
pub(super) const ANY_WISH: [Action; 3] =
    [Action::KeepLane, Action::ChangeLeft, Action::ChangeRight];

/// Another vehicle and what the ego vehicle can know of it.
#[derive(Debug, Clone)]
pub(super) struct Cast {
    pub other: Other,
    /// Others tell of it wherever it is.
    pub is_shared: bool,
    /// Neither the detector nor the line of sight ever notices it.
    pub is_missed: bool,
}

/// One episode as drawn.
pub(super) struct Scenario {
    pub road: Arc<Road>,
    pub profile: RoadProfile,
    pub state: BicycleState,
    pub lane: LaneIndex,
    pub cast: Vec<Cast>,
    pub estimate: Estimate,
    pub nominal: Nominal,
    pub noise: NoiseMode,
    /// From the rear axle to the end of free sight, where nothing blocks it.
    pub sight_range_m: f64,
    /// How far beyond the truth the free sight is said to reach.
    pub sight_error_m: f64,
    /// Steps from the first line of sight to a track.
    pub delay_steps: usize,
    /// What the ego vehicle asks for, one or the other in turns: no lane change where empty.
    pub wishes: Vec<Action>,
}

/// Draws an episode: road, ego vehicle, and others near the edge of the safe set.
pub(super) fn draw(
    family: Family,
    control: &ControlSettings,
    broken: Option<Broken>,
    dice: &mut ChaCha8Rng,
) -> Result<Scenario, CampaignError> {
    let safety = &control.safety;
    let road = Arc::new(draw_road(dice)?);
    let profile = RoadProfile::new(road.clone(), control);
    let lanes: Vec<LaneIndex> = LaneIndex::all().collect();
    let lane = lanes[dice.random_range(0..lanes.len())];
    let sight_range_m = dice.random_range(safety.sight_range_m..220.0);
    let s_m = dice.random_range(2.0..120.0);
    let speed_mps = ego_speed(&road, &profile, s_m, sight_range_m, control, dice);
    let room_m = 0.5 * (road.lane_width_m() - EGO.width_m);
    let off_m = room_m * dice.random_range(-1.0..1.0);
    let psi_rad = dice.random_range(-0.15..0.15);
    let at = [s_m, off_m, psi_rad];
    let state = within_lane(&profile, lane, at, speed_mps, control)?;
    let mut stage = Stage {
        set: SafeSet {
            settings: safety,
            road: &road,
        },
        ego: TrueVehicle::new(VehicleId(EGO_ID), VehicleKind::Cav, EGO, state, s_m, &road),
        lane,
        broken,
        cast: Vec::new(),
        side: None,
    };
    match family {
        Family::Open => {}
        Family::Leaders => stage.leaders(dice),
        Family::Standing => stage.standing(sight_range_m, dice),
        Family::CutIn => stage.cut_in(dice),
        Family::CutOut => stage.cut_out(dice),
        Family::LaneChange => stage.lane_change(dice),
    }
    let Stage { cast, side, .. } = stage;
    let policy = match dice.random_range(0..10) {
        0..4 => NominalPolicy::FlatOut,
        4 | 5 => NominalPolicy::FlatOutSwerving,
        6 => NominalPolicy::Random,
        7 => NominalPolicy::BangBang,
        _ => NominalPolicy::Reference,
    };
    let noise = match dice.random_range(0..6) {
        0 => NoiseMode::None,
        1 | 2 => NoiseMode::Worst,
        3 => NoiseMode::RandomSign,
        4 => NoiseMode::Weaving,
        _ => NoiseMode::Uniform,
    };
    let max_delay = (safety.perception_delay_s / covista_world::STEP_S).round() as usize;
    Ok(Scenario {
        profile,
        state,
        lane,
        estimate: estimate(cast.len(), control, broken, dice),
        cast,
        nominal: Nominal::new(policy, dice.random_range(1..60)),
        noise: if broken == Some(Broken::ProcessNoise) {
            NoiseMode::Worst
        } else {
            noise
        },
        sight_range_m,
        sight_error_m: safety.sight_error_m * f64::from(dice.random_range(0..=2_u8)) / 2.0,
        delay_steps: dice.random_range(0..=max_delay),
        wishes: match side {
            Some(side) => vec![side],
            None if family == Family::LaneChange || dice.random_bool(0.2) => ANY_WISH.to_vec(),
            None => Vec::new(),
        },
        road,
    })
}

/// As far off the lane's centre and as turned as asked, or less: inside the lateral set as the
/// controller has it.
fn within_lane(
    profile: &RoadProfile,
    lane: LaneIndex,
    [s_m, off_m, psi_rad]: [f64; 3],
    speed_mps: f64,
    control: &ControlSettings,
) -> Result<BicycleState, CampaignError> {
    let road = profile.road();
    let nobody = SightLine::new([f64::INFINITY; LANE_COUNT as usize], 0.0);
    let mut controller = Controller::new(*control, lane)?;
    let state = |share: f64| {
        let d_m = road.lane_center_m(lane) + share * off_m;
        BicycleState {
            pose: road.pose_from_frenet(s_m, d_m, share * psi_rad),
            speed_mps,
        }
    };
    let mut is_inside = |state: BicycleState| {
        let situation = Situation {
            profile,
            ego: EgoState::new(StationId(EGO_ID), state, EGO, road),
            neighbours: &[],
            sight: &nobody,
            time_s: 0.0,
            desired_speed_mps: speed_mps,
        };
        controller.control(&situation).h_lateral_m >= 0.0
    };
    let shares = (0..10).map(|i| 1.0 - f64::from(i) / 10.0);
    let fits = shares.map(state).find(|state| is_inside(*state));
    Ok(fits.unwrap_or_else(|| state(0.0)))
}

/// As fast as the curves ahead and, most of the time, the sight allow.
fn ego_speed(
    road: &Road,
    profile: &RoadProfile,
    s_m: f64,
    sight_range_m: f64,
    control: &ControlSettings,
    dice: &mut ChaCha8Rng,
) -> f64 {
    let set = SafeSet {
        settings: &control.safety,
        road,
    };
    let fastest = TOP_MPS.min(0.99 * profile.speed_limit_mps(s_m));
    let mut speed_mps = if dice.random_bool(0.4) {
        fastest
    } else {
        dice.random_range(0.0..=fastest)
    };
    if dice.random_bool(0.9) {
        let sure_m = sight_range_m - control.safety.sight_error_m - 22.0;
        while set.closed_m(speed_mps, 0.0, 1.3, 1.0) > sure_m {
            speed_mps *= 0.97;
        }
    }
    speed_mps
}

fn estimate(
    others: usize,
    control: &ControlSettings,
    broken: Option<Broken>,
    dice: &mut ChaCha8Rng,
) -> Estimate {
    let oldest = (control.safety.knowledge_age_max_s / covista_world::STEP_S).round() as usize;
    let error = match dice.random_range(0..8) {
        0 => ErrorMode::None,
        1..4 => ErrorMode::Far,
        4 => ErrorMode::Near,
        5 => ErrorMode::Jumping,
        _ => ErrorMode::Random,
    };
    let messages = match dice.random_range(0..6) {
        0 | 1 => Messages::Fresh,
        2 => Messages::Late(oldest),
        3 => Messages::Every {
            period: oldest + 1,
            late: 0,
        },
        4 => Messages::Every {
            period: 50,
            late: oldest - 49,
        },
        _ => Messages::Every {
            period: 10,
            late: dice.random_range(0..50),
        },
    };
    let stds = [0.0, 0.1, 0.3].map(|std| std * dice.random_range(0.5..=1.0));
    let std_m = stds[dice.random_range(0..3)];
    let std_mps = 1.5 * stds[dice.random_range(0..3)];
    let mut estimate = Estimate::new(error, messages, [std_m, std_mps], others);
    match broken {
        Some(Broken::PerceptionError) => {
            estimate.excess = 3.0;
            estimate.error = ErrorMode::Far;
            (estimate.position_std_m, estimate.velocity_std_mps) = (0.3, 0.4);
        }
        Some(Broken::MessageAge) => {
            estimate.messages = Messages::Late(3 * oldest);
            estimate.conceals_age = true;
        }
        // The ego vehicle knows its follower as it is, but for what it does next.
        Some(Broken::FollowerAcceleration | Broken::FollowerBraking) => {
            estimate.error = ErrorMode::None;
            estimate.messages = Messages::Fresh;
        }
        _ => {}
    }
    estimate
}

/// Where the others are put.
struct Stage<'a> {
    set: SafeSet<'a>,
    ego: TrueVehicle,
    lane: LaneIndex,
    broken: Option<Broken>,
    cast: Vec<Cast>,
    /// The only lane change that is to be asked for.
    side: Option<Action>,
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

    fn leaders(&mut self, dice: &mut ChaCha8Rng) {
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

    fn standing(&mut self, sight_range_m: f64, dice: &mut ChaCha8Rng) {
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
    fn cut_in(&mut self, dice: &mut ChaCha8Rng) {
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
    fn cut_out(&mut self, dice: &mut ChaCha8Rng) {
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

    fn lane_change(&mut self, dice: &mut ChaCha8Rng) {
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
