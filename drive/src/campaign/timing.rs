use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use covista_control::{
    ControlSettings, Controller, EgoState, Neighbour, RoadProfile, SightLine, Situation, Solver,
};
use covista_world::{
    Action, ControlInput, LaneIndex, Road, RoadSegment, STEP_S, Se2Pose, StationId,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{
    CampaignError, Family,
    episode::{Conditions, Episode},
    estimate::{ErrorMode, Estimate, Messages},
    nominal::{NoiseMode, Nominal, NominalPolicy, Nominals},
    other::{Motion, Other},
    plant::PlantModel,
    scenario::{self, ANY_WISH, Cast, EGO, Scenario},
};

/// What is timed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// `Controller::filter` on a nominal input that asks for everything at once.
    Filter,
    /// `Controller::control`: the reference, too.
    Step,
}

impl Stage {
    /// Its name in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Filter => "filter",
            Self::Step => "step",
        }
    }
}

/// How long one vehicle-step takes.
#[derive(Debug, Clone, PartialEq)]
pub struct StepTiming {
    /// Who solves the QP.
    pub solver: Solver,
    /// What is timed.
    pub stage: Stage,
    /// In what situations.
    pub situations: &'static str,
    /// Largest number of neighbours in them.
    pub neighbours: usize,
    /// Calls, each timed alone.
    pub calls: usize,
    /// Median in microseconds, the clock's own cost included.
    pub median_us: f64,
    /// 99th percentile in microseconds.
    pub p99_us: f64,
    /// Median of the clock's own cost in microseconds: of an empty span.
    pub clock_us: f64,
}

/// One situation with the controller that was about to act on it.
struct Recorded {
    profile: RoadProfile,
    ego: EgoState,
    neighbours: Vec<Neighbour>,
    sight: SightLine,
    time_s: f64,
    desired_speed_mps: f64,
    controller: Controller,
}

impl Recorded {
    fn new(situation: &Situation<'_>, controller: &Controller) -> Self {
        Self {
            profile: situation.profile.clone(),
            ego: situation.ego,
            neighbours: situation.neighbours.to_vec(),
            sight: *situation.sight,
            time_s: situation.time_s,
            desired_speed_mps: situation.desired_speed_mps,
            controller: controller.clone(),
        }
    }

    fn situation(&self) -> Situation<'_> {
        Situation {
            profile: &self.profile,
            ego: self.ego,
            neighbours: &self.neighbours,
            sight: &self.sight,
            time_s: self.time_s,
            desired_speed_mps: self.desired_speed_mps,
        }
    }
}

/// Situations kept of each kind: enough to differ, few enough to stay in memory.
const SITUATIONS: usize = 300;
/// Calls of the closed form for one of Clarabel, which is slower by as much.
const CLARABEL_SHARE: usize = 10;

/// Times the filter and the whole step in recorded situations, by the closed form and by Clarabel
/// in turns.
///
/// # Errors
/// When the settings are refused.
pub fn time_control(
    control: &ControlSettings,
    seed: u64,
    calls: usize,
    progress: &dyn Fn(u64),
) -> Result<Vec<StepTiming>, CampaignError> {
    let mut timings = Vec::new();
    for (name, kind) in [
        ("keep-lane", Kind::Keep),
        ("lane-change", Kind::Change),
        ("campaign", Kind::Campaign),
    ] {
        for solver in [Solver::ClosedForm, Solver::Clarabel] {
            let settings = ControlSettings { solver, ..*control };
            let recorded = record(&settings, kind, seed)?;
            for stage in [Stage::Filter, Stage::Step] {
                let calls = match solver {
                    Solver::ClosedForm => calls,
                    Solver::Clarabel => calls.div_ceil(CLARABEL_SHARE),
                };
                let timing = time(&recorded, stage, calls);
                timings.push(StepTiming {
                    solver,
                    situations: name,
                    ..timing
                });
                progress(calls as u64);
            }
        }
    }
    Ok(timings)
}

/// Where situations come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Six neighbours, keeping the lane.
    Keep,
    /// The same six during a lane change.
    Change,
    /// Episodes of the campaign.
    Campaign,
}

fn record(
    settings: &ControlSettings,
    kind: Kind,
    seed: u64,
) -> Result<Vec<Recorded>, CampaignError> {
    let conditions = Conditions {
        control: *settings,
        plant: PlantModel::Kinematic,
        broken: None,
        nominal: Nominals::All,
        noise: settings.safety,
        is_monitored: false,
    };
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let mut recorded = Vec::new();
    for number in 0..200 {
        dice.set_stream(number);
        let scenario = match kind {
            Kind::Campaign => scenario::draw(Family::LaneChange, settings, None, &mut dice)?,
            Kind::Keep | Kind::Change => crowd(settings, kind == Kind::Change)?,
        };
        let others = scenario.cast.len();
        let episode = Episode::new(scenario, &conditions, dice.clone())?;
        episode.run(600, |situation, controller| {
            let changes = controller.manoeuvre().action() != Action::KeepLane;
            let wanted = match kind {
                Kind::Keep => !changes,
                Kind::Change => changes,
                Kind::Campaign => (situation.time_s / STEP_S).round() % 20.0 < 0.5,
            };
            if wanted && recorded.len() < SITUATIONS && situation.neighbours.len() == others {
                recorded.push(Recorded::new(situation, controller));
            }
        });
        if recorded.len() >= SITUATIONS {
            break;
        }
    }
    Ok(recorded)
}

/// Six neighbours on a curve of 300 m radius: two ahead in the middle lane, where the ego vehicle
/// drives, two ahead in the left one and one behind it there, and one on the right.
fn crowd(settings: &ControlSettings, changes_lanes: bool) -> Result<Scenario, CampaignError> {
    let segments = [
        RoadSegment::Straight { length_m: 60.0 },
        RoadSegment::Clothoid {
            length_m: 60.0,
            from_per_m: 0.0,
            to_per_m: 1.0 / 300.0,
        },
        RoadSegment::Arc {
            length_m: 400.0,
            curvature_per_m: 1.0 / 300.0,
        },
    ];
    let road = Arc::new(Road::new(Se2Pose::default(), &segments, 3.5)?);
    let (left, right) = (LaneIndex::LEFTMOST, LaneIndex::RIGHTMOST);
    let middle = left.right().unwrap_or(right);
    let vehicles = [
        (middle, 130.0, 16.0),
        (middle, 190.0, 15.0),
        (left, 125.0, 17.0),
        (left, 180.0, 16.0),
        (left, 20.0, 14.0),
        (right, 95.0, 15.0),
    ];
    let cast: Vec<Cast> = (1..)
        .zip(vehicles)
        .map(|(id, (lane, s_m, speed_mps))| {
            let motion = Motion {
                s_m,
                d_m: road.lane_center_m(lane),
                speed_mps,
                sideways_mps: 0.0,
            };
            let brake_mps2 = settings.safety.leader_brake_mps2;
            let mut other = Other::new(id, EGO, motion, brake_mps2);
            other.station = Some(StationId(id + 10));
            Cast {
                other,
                is_shared: true,
                is_missed: false,
            }
        })
        .collect();
    let state = covista_world::BicycleState {
        pose: road.pose_from_frenet(70.0, road.lane_center_m(middle), 0.0),
        speed_mps: 15.0,
    };
    Ok(Scenario {
        profile: RoadProfile::new(road.clone(), settings),
        state,
        lane: middle,
        estimate: Estimate::new(ErrorMode::None, Messages::Fresh, [0.1, 0.1], cast.len()),
        cast,
        nominal: Nominal::new(NominalPolicy::Reference, 1),
        noise: NoiseMode::None,
        sight_range_m: 200.0,
        sight_error_m: 0.0,
        delay_steps: 0,
        wishes: if changes_lanes {
            ANY_WISH.to_vec()
        } else {
            Vec::new()
        },
        road,
    })
}

fn time(recorded: &[Recorded], stage: Stage, calls: usize) -> StepTiming {
    let everything = ControlInput {
        tan_delta: 0.3,
        accel_mps2: 12.0,
    };
    let mut spans = Vec::with_capacity(calls);
    let mut clock = Vec::with_capacity(calls);
    for call in 0..calls {
        let Some(recorded) = recorded.get(call % recorded.len().max(1)) else {
            break;
        };
        let situation = recorded.situation();
        let mut controller = recorded.controller.clone();
        let start = Instant::now();
        clock.push(start.elapsed());
        let start = Instant::now();
        let output = match stage {
            Stage::Filter => controller.filter(&situation, everything),
            Stage::Step => controller.control(&situation),
        };
        let span = start.elapsed();
        std::hint::black_box(output);
        spans.push(span);
    }
    spans.sort_unstable();
    clock.sort_unstable();
    StepTiming {
        solver: Solver::ClosedForm,
        stage,
        situations: "",
        neighbours: recorded
            .iter()
            .map(|of| of.neighbours.len())
            .max()
            .unwrap_or(0),
        calls: spans.len(),
        median_us: quantile_us(&spans, 0.5),
        p99_us: quantile_us(&spans, 0.99),
        clock_us: quantile_us(&clock, 0.5),
    }
}

/// Quantile of sorted spans, by the nearest rank.
fn quantile_us(sorted: &[Duration], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    let span = sorted.get(rank.saturating_sub(1)).copied();
    span.unwrap_or_default().as_secs_f64() * 1e6
}
