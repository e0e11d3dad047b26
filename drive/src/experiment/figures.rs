use covista_traffic::Ring;
use serde::{Deserialize, Serialize};

use crate::{RingMotion, RingSafety, RingTally, networked::TruncationErrors};

/// What driving a case gave.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Figures {
    /// Of a [`super::LoopCase`].
    Loop(Box<LoopFigures>),
    /// Of a [`super::SceneCase`].
    Scene(SceneFigures),
    /// Of a [`super::TrainingCase`].
    Training(LearningCurve),
    /// Of a [`super::TruncationCase`].
    Truncation(TruncationFigures),
}

/// What an episode on the loop came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopFigures {
    /// Its length in seconds.
    pub time_s: f64,
    /// Mean speed of all vehicles over all steps.
    pub mean_velocity_mps: f64,
    /// The same in miles per hour.
    pub mean_velocity_mph: f64,
    /// The paper's flow: density times mean speed in m/s.
    pub flow: f64,
    /// Vehicles that pass a line across a lane in an hour.
    pub flow_per_h_lane: f64,
    /// The paper's comfort, mean over all vehicles and behaviour steps.
    pub mean_comfort: f64,
    /// The paper's comfort of the CAVs; `None` without CAVs.
    pub cav_mean_comfort: Option<f64>,
    /// Mean speed of the CAVs at the ends of behaviour steps in m/s; `None` without CAVs.
    pub cav_mean_velocity_mps: Option<f64>,
    /// Rewards of a CAV, summed over the episode, mean over the CAVs; `None` without CAVs.
    pub reward: Option<f64>,
    /// What was counted over the episode.
    pub tally: RingTally,
    /// What the monitor found; `None` without CAVs.
    pub safety: Option<RingSafety>,
    /// Times that two bodies came to overlap.
    pub collisions: u64,
    /// Lane changes that human drivers began.
    pub human_lane_changes: u64,
    /// Least distance to the vehicle ahead, between centres, of all vehicles in all steps.
    pub min_headway_m: Option<f64>,
    /// The same at the ends of behaviour steps, over time, where it is kept.
    pub headways: Option<Headways>,
    /// How smoothly the CAVs drove, where it is measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<RingMotion>,
}

/// Least distances to the vehicle ahead, between the bodies' centres along the road, at the ends of
/// the behaviour steps of 0.5 s; `None` while nobody follows anybody.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Headways {
    /// Of all vehicles.
    pub all_m: Vec<Option<f64>>,
    /// Of CAVs, whomever they follow.
    pub cavs_m: Vec<Option<f64>>,
}

impl Headways {
    pub(super) fn note(&mut self, ring: &Ring) {
        let least = |vehicles: usize| {
            let headways = (0..vehicles).filter_map(|index| ring.headway_m(index));
            headways.min_by(f64::total_cmp)
        };
        self.all_m.push(least(ring.vehicles().len()));
        self.cavs_m.push(least(ring.settings().cavs));
    }
}

impl LoopFigures {
    pub(super) fn new(
        ring: &Ring,
        tally: RingTally,
        safety: Option<RingSafety>,
        headways: Option<Headways>,
    ) -> Self {
        let report = ring.report();
        let settings = ring.settings();
        let per_cav = |sum: f64, times: u64| (times > 0).then(|| sum / times as f64);
        Self {
            time_s: report.time_s,
            mean_velocity_mps: report.mean_velocity_mps,
            mean_velocity_mph: report.mean_velocity_mph,
            flow: settings.density * report.mean_velocity_mps,
            flow_per_h_lane: report.flow_per_h_lane,
            mean_comfort: tally.comfort / tally.behaviour_steps.max(1) as f64,
            cav_mean_comfort: per_cav(tally.cav_comfort, tally.decisions),
            cav_mean_velocity_mps: per_cav(tally.cav_speed_mps, tally.decisions),
            reward: per_cav(tally.reward, settings.cavs as u64),
            tally,
            safety,
            collisions: report.collisions,
            human_lane_changes: report.human_lane_changes,
            min_headway_m: report.min_headway_m,
            headways,
            motion: None,
        }
    }
}

/// What a run of a scenario with obstacles came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFigures {
    /// CAVs and humans that were slower than 0.5 m/s for 5 s on end.
    pub vehicles_stuck: usize,
    /// Mean speed of all moving vehicles in m/s.
    pub mean_velocity_mps: f64,
    /// Time lost in seconds: that of the run less what the way took at the desired speed; mean over
    /// all moving vehicles.
    pub delay_s: f64,
    /// The same of the CAVs that began in an obstacle's lane; `None` where there is none.
    pub blocked_delay_s: Option<f64>,
    /// CAVs that began in an obstacle's lane.
    pub blocked_cavs: usize,
    /// Those of them that ever began a lane change.
    pub blocked_cavs_changed: usize,
    /// Those that began it before they saw an obstacle themselves.
    pub changed_before_sight: usize,
    /// How far before the nearest obstacle of their lane they began it, in metres along the road,
    /// mean over those who did.
    pub change_before_obstacle_m: Option<f64>,
    /// The paper's comfort of the CAVs, mean over their behaviour steps.
    pub mean_comfort: f64,
    /// Hardest braking of a CAV in m/s^2.
    pub hardest_braking_mps2: f64,
    /// Pairs of bodies that overlapped.
    pub collisions: usize,
    /// Lane changes that began inside the collision set of the truth.
    pub unsafe_actions: usize,
    /// Violations that no broken assumption explains.
    pub violations_unattributed: usize,
}

/// How a training went, round by round.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LearningCurve {
    /// The total reward of an episode, mean over CAVs and environments.
    pub reward: Vec<f64>,
    /// Unsafe actions of all CAVs.
    pub unsafe_actions: Vec<u64>,
    /// Violations that no broken assumption explains, where the monitor looked on.
    pub unattributed: Vec<Option<usize>>,
}

/// What truncating a game's global Q costs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TruncationFigures {
    /// The least reward of a step.
    pub least_reward: f64,
    /// The largest reward of a step.
    pub largest_reward: f64,
    /// How far the global Q is from the true one at the most, by what it leaves of Bellman's
    /// equation.
    pub q_error: f64,
    /// The errors at kappa = 0, 1, ..., of all vehicles.
    pub by_kappa: Vec<TruncationErrors>,
}

impl TruncationFigures {
    /// The paper's Theorem 2: `rbar / (1 - gamma) * gamma^(kappa / 2)`.
    pub fn paper_bound(&self, discount: f64, kappa: usize) -> f64 {
        self.largest_reward / (1.0 - discount) * discount.powf(kappa as f64 / 2.0)
    }

    /// What its proof comes to: own state and action are the same for the first
    /// `floor(kappa / 2)` steps, and later rewards differ by their span at the most.
    pub fn proof_bound(&self, discount: f64, kappa: usize) -> f64 {
        let span = self.largest_reward - self.least_reward;
        span / (1.0 - discount) * discount.powf((kappa / 2 + 1) as f64)
    }
}
