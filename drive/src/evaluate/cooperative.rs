//! What each CAV of a closed loop knows of the vehicles about it, alone and with sharing.
//!
//! The loop is driven once a seed, with ideal sharing. Trackers of their own listen to the same
//! percepts over channels of their own, so that all conditions meet the same scenes.

mod listeners;
mod targets;
mod tracking;

use std::ops::Range;

use covista_perception::metrics::{TrueBox, average_precision};
use covista_sharing::{ChannelSettings, PoseNoise};
use covista_traffic::Scenario;
use covista_world::Detection3d;
use serde::Serialize;

use self::{listeners::Listeners, targets::Target, tracking::TrackingTally};
use super::{EvaluateError, Progress};
use crate::{ControlSettings, RunConfig, Senses, Snapshot, run};

/// OpenCOOD's latency and pose noise: 100 ms, 0.2 m, 0.2 degrees.
const LATENCY_S: f64 = 0.1;
const POSE_NOISE: PoseNoise = PoseNoise {
    position_std_m: 0.2,
    yaw_std_rad: 0.2 * std::f64::consts::PI / 180.0,
};
/// Time between two snapshots of the loop.
const SNAPSHOT_S: f64 = 0.1;

/// How the CAVs share what they see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SharingCondition {
    /// Not at all.
    Alone,
    /// At once, from senders that know where they are.
    Ideal,
    /// 100 ms late.
    Latency,
    /// From senders that are wrong by 0.2 m and 0.2 degrees.
    PoseNoise,
    /// Both.
    LatencyAndPoseNoise,
}

impl SharingCondition {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Alone,
        Self::Ideal,
        Self::Latency,
        Self::PoseNoise,
        Self::LatencyAndPoseNoise,
    ];

    /// The channel, where there is one.
    pub fn channel(self) -> Option<ChannelSettings> {
        let (latency_s, pose_noise) = match self {
            Self::Alone => return None,
            Self::Ideal => (0.0, PoseNoise::default()),
            Self::Latency => (LATENCY_S, PoseNoise::default()),
            Self::PoseNoise => (0.0, POSE_NOISE),
            Self::LatencyAndPoseNoise => (LATENCY_S, POSE_NOISE),
        };
        Some(ChannelSettings {
            latency_s,
            pose_noise,
            ..ChannelSettings::default()
        })
    }
}

/// The closed loops to measure in.
#[derive(Debug, Clone)]
pub struct CooperativeRuns {
    /// The scene.
    pub scenario: Scenario,
    /// One run for each.
    pub seeds: Range<u64>,
    /// Simulated seconds of each.
    pub duration_s: f64,
}

/// What the CAVs know under one condition, each of them the ego in turn, at each perception frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CooperativeEvaluation {
    /// How they share.
    pub sharing: SharingCondition,
    /// Over what.
    pub channel: Option<ChannelSettings>,
    /// Frames, each CAV's counted.
    pub frames: usize,
    /// Of all vehicles within 100 m of the ego.
    pub all: KnownVehicles,
    /// Of those that are no CAVs and so can't tell where they are: what shared perception adds.
    pub not_cavs: KnownVehicles,
    /// Of those that a CAV within communication range of the ego, or the ego, has in line of
    /// sight, as in OpenCOOD.
    pub seen_by_a_cav: KnownVehicles,
    /// Of those that the ego has in line of sight.
    pub seen_by_ego: KnownVehicles,
    /// Of those that it hasn't.
    pub hidden_from_ego: KnownVehicles,
    /// Times a vehicle is shown by another track than before (CLEAR MOT).
    pub identity_switches: usize,
    /// Times a vehicle is shown again after frames in which it was not.
    pub fragmentations: usize,
    /// Tracks within 100 m that show no vehicle, summed over frames.
    pub false_tracks: usize,
}

/// How well a set of vehicles is known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct KnownVehicles {
    /// Vehicles, summed over frames.
    pub vehicles: usize,
    /// Percentage that a track shows: within 2 m.
    pub shown_percent: Option<f64>,
    /// Average precision in percent (40 recalls) at a bird's-eye IoU of 0.5.
    pub ap_bev_50_r40: Option<f64>,
    /// Average precision in percent (40 recalls) at a bird's-eye IoU of 0.7.
    pub ap_bev_70_r40: Option<f64>,
    /// Root mean square distance, in metres, of tracks from the vehicles that they show.
    pub position_rmse_m: Option<f64>,
    /// The same of their velocities, in m/s.
    pub velocity_rmse_mps: Option<f64>,
}

/// Drives the runs and measures what the CAVs know, under each condition.
///
/// # Errors
/// When the scenario can't be run, or its frames fall between the loop's snapshots.
pub fn evaluate_cooperative(
    runs: &CooperativeRuns,
    senses: &mut Senses,
    progress: Progress<'_>,
) -> Result<Vec<CooperativeEvaluation>, EvaluateError> {
    let period_s = runs.scenario.perception_period_s;
    let snapshots = period_s / SNAPSHOT_S;
    if (snapshots - snapshots.round()).abs() > 1e-6 {
        return Err(EvaluateError::PerceptionPeriod(period_s));
    }
    let mut tallies = SharingCondition::ALL.map(|_| Tally::default());
    let frames_a_run = (runs.duration_s / period_s - 1e-6).ceil().max(1.0) as usize;
    let total = frames_a_run * (runs.seeds.end - runs.seeds.start) as usize;
    let mut done = 0;
    for seed in runs.seeds.clone() {
        let config = RunConfig {
            scenario: runs.scenario.clone(),
            seed,
            sharing: true,
            channel: ChannelSettings::default(),
            duration_s: runs.duration_s,
            control: ControlSettings::default(),
        };
        let mut listeners =
            SharingCondition::ALL.map(|condition| Listeners::new(condition.channel(), seed));
        for tally in &mut tallies {
            tally.tracking.next_run();
        }
        run(&config, senses, &mut |snapshot: &Snapshot<'_>| {
            for listeners in &mut listeners {
                listeners.step(snapshot);
            }
            if snapshot.cavs.iter().any(|cav| cav.percepts.is_some()) {
                for (tally, listeners) in tallies.iter_mut().zip(&listeners) {
                    tally.take(snapshot, listeners);
                }
                done += 1;
                progress(done, total);
            }
            Ok(())
        })?;
    }
    let evaluations = SharingCondition::ALL.into_iter().zip(&tallies);
    Ok(evaluations
        .map(|(condition, tally)| tally.evaluation(condition))
        .collect())
}

/// All frames of all egos under one condition.
#[derive(Default)]
struct Tally {
    frames: Vec<(Vec<Detection3d>, Vec<Target>)>,
    tracking: TrackingTally,
}

impl Tally {
    fn take(&mut self, snapshot: &Snapshot<'_>, listeners: &Listeners) {
        for ego in &snapshot.cavs {
            let tracks = listeners.tracks(ego, snapshot.time_s);
            let targets = Target::about(ego, snapshot);
            self.tracking.take(ego, &targets, &tracks);
            let boxes = tracks
                .iter()
                .filter(|track| targets::is_within_range(ego, track.state.center.position()));
            self.frames
                .push((boxes.map(targets::box_of_track).collect(), targets));
        }
    }

    fn evaluation(&self, sharing: SharingCondition) -> CooperativeEvaluation {
        let known = |counts: fn(&Target) -> bool| self.known(counts);
        CooperativeEvaluation {
            sharing,
            channel: sharing.channel(),
            frames: self.frames.len(),
            all: known(|_| true),
            not_cavs: known(|target| !target.is_cav),
            seen_by_a_cav: known(|target| target.seen_by_a_cav),
            seen_by_ego: known(|target| target.seen_by_ego),
            hidden_from_ego: known(|target| !target.seen_by_ego),
            identity_switches: self.tracking.identity_switches,
            fragmentations: self.tracking.fragmentations,
            false_tracks: self.tracking.false_tracks,
        }
    }

    /// How well the vehicles within range are known that `counts` picks.
    fn known(&self, counts: fn(&Target) -> bool) -> KnownVehicles {
        let counts = |target: &Target| target.within_range && counts(target);
        let frames: Vec<(Vec<Detection3d>, Vec<TrueBox>)> = self
            .frames
            .iter()
            .map(|(found, targets)| {
                let truth = targets.iter().map(|target| TrueBox {
                    footprint: target.footprint,
                    ignored: !counts(target),
                });
                (found.clone(), truth.collect())
            })
            .collect();
        let targets = self.frames.iter().flat_map(|(_, targets)| targets);
        let vehicles = targets.filter(|target| counts(target)).count();
        let errors = self.tracking.errors_of(counts);
        let average_precision =
            |min_iou: f64| average_precision(&frames, min_iou).map(|ap| 100.0 * ap);
        KnownVehicles {
            vehicles,
            shown_percent: (vehicles > 0).then(|| 100.0 * errors.count as f64 / vehicles as f64),
            ap_bev_50_r40: average_precision(0.5),
            ap_bev_70_r40: average_precision(0.7),
            position_rmse_m: errors.position_rmse_m(),
            velocity_rmse_mps: errors.velocity_rmse_mps(),
        }
    }
}
