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
    other::{Other, TOP_MPS},
    road::draw_road,
    stage::Stage,
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
