//! The adversarial campaign: one CAV's controller in closed loop with the worst that the promise
//! allows, judged on the truth alone.
//!
//! An episode draws everything from its own seed: the road, the ego vehicle near the edge of its
//! safe set, others that do their worst within their bounds, noise and estimation error at their
//! bounds, messages as old as they may be. Episodes run in parallel; the result does not depend on
//! the number of threads.
//!
//! What is claimed is recomputed here on the truth (module `exact`), never read off the
//! controller: h in the set's own definition, whose noise is part of D, and the headway that the
//! promise is about. h < 0 is a violation unless it was so at once when a vehicle came into the
//! lane or into sight; such excuses are counted apart and end when h is back.

mod broken;
mod cases;
mod cover;
mod episode;
mod estimate;
mod exact;
mod follower;
mod lag;
mod nominal;
mod other;
mod pair;
mod plant;
mod road;
mod scenario;
mod sedan;
mod stage;
mod tally;
mod timing;
mod watch;

pub use broken::Broken;
pub use cases::{COVERS, CoverCase};
pub use cover::{PlantCover, cover_plants};
pub use nominal::Nominals;
pub use plant::PlantModel;
pub use scenario::Family;
pub use tally::{EpisodeId, Tally};
pub use timing::{Stage, StepTiming, time_control};

use std::sync::atomic::{AtomicU64, Ordering};

use covista_control::{ControlSettings, SafetySettings, SettingsError};
use covista_world::RoadError;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use episode::{Conditions, Episode};

/// Steps of one episode.
const EPISODE_STEPS: u64 = 1500;
/// The same where everything happens after one lane change at the start.
const SHORT_STEPS: u64 = 500;

/// A campaign: what is drawn and how much of it.
#[derive(Debug, Clone, PartialEq)]
pub struct CampaignSpec {
    /// Seed of everything random.
    pub seed: u64,
    /// Controlled steps, shared out evenly among the families.
    pub steps: u64,
    /// The controller's settings.
    pub control: ControlSettings,
    /// What is broken on purpose.
    pub broken: Option<Broken>,
    /// What is asked of the filter.
    pub nominal: Nominals,
    /// What moves.
    pub plant: PlantModel,
}

/// Why a campaign cannot run.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CampaignError {
    /// The controller refuses its settings.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A road that was drawn cannot be built.
    #[error("a road of the campaign cannot be built: {0}")]
    Road(#[from] RoadError),
}

/// Runs a campaign and tells what each family of episodes found, in the order of
/// [`Family::ALL`]. `progress` is told the steps done so far, from any thread.
///
/// # Errors
/// When the settings are refused.
pub fn run_campaign(
    spec: &CampaignSpec,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Vec<(Family, Tally)>, CampaignError> {
    let families = spec.broken.map_or(&Family::ALL[..], Broken::families);
    run_families(spec, families, progress)
}

/// The campaign with these families only.
fn run_families(
    spec: &CampaignSpec,
    families: &[Family],
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Vec<(Family, Tally)>, CampaignError> {
    let conditions = conditions(spec);
    let done = AtomicU64::new(0);
    let share = spec.steps.div_ceil(families.len() as u64);
    let each = episode_steps(spec.broken);
    let count = share.div_ceil(each);
    let episodes: Vec<(usize, u64)> = (0..count)
        .flat_map(|number| (0..families.len()).map(move |family| (family, number)))
        .collect();
    let tallies = episodes
        .par_iter()
        .map(|&(family, number)| {
            let steps = each.min(share - number * each);
            let tally = run_episode(spec.seed, families[family], number, steps, &conditions)?;
            let before = done.fetch_add(steps, Ordering::Relaxed);
            progress(before + steps);
            Ok((family, tally))
        })
        .collect::<Result<Vec<_>, CampaignError>>()?;
    let mut found: Vec<_> = families
        .iter()
        .map(|family| (*family, Tally::default()))
        .collect();
    for (family, tally) in &tallies {
        found[*family].1.add(tally);
    }
    Ok(found)
}

fn episode_steps(broken: Option<Broken>) -> u64 {
    if broken.is_some_and(Broken::is_about_followers) {
        SHORT_STEPS
    } else {
        EPISODE_STEPS
    }
}

fn conditions(spec: &CampaignSpec) -> Conditions {
    let mut noise = spec.control.safety;
    let times = match (spec.broken, spec.plant) {
        (Some(Broken::ProcessNoise), _) => 5.0,
        (_, PlantModel::Kinematic) => 1.0,
        // The plant itself is what the noise has to cover.
        _ => 0.0,
    };
    let scaled = SafetySettings {
        noise_position_m: times * noise.noise_position_m,
        noise_position_share: times * noise.noise_position_share,
        noise_speed_mps: times * noise.noise_speed_mps,
        noise_slip_rad: times * noise.noise_slip_rad,
        noise_curvature_per_m: times * noise.noise_curvature_per_m,
        ..noise
    };
    noise = scaled;
    Conditions {
        control: spec.control,
        plant: spec.plant,
        broken: spec.broken,
        nominal: spec.nominal,
        noise,
        is_monitored: spec.plant == PlantModel::Kinematic,
    }
}

/// One episode, from its own seed: the campaign's, its family and its number.
fn run_episode(
    seed: u64,
    family: Family,
    number: u64,
    steps: u64,
    conditions: &Conditions,
) -> Result<Tally, CampaignError> {
    let episode = episode(seed, EpisodeId { family, number }, conditions)?;
    let mut tally = episode.run(steps as usize, |_, _| {});
    if tally.is_bad() {
        tally.first_bad_episode = Some(EpisodeId { family, number });
    }
    Ok(tally)
}

fn episode(
    seed: u64,
    EpisodeId { family, number }: EpisodeId,
    conditions: &Conditions,
) -> Result<Episode<'_>, CampaignError> {
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    dice.set_stream(number * Family::ALL.len() as u64 + family as u64);
    let scenario = scenario::draw(family, &conditions.control, conditions.broken, &mut dice)?;
    Episode::new(scenario, conditions, dice)
}

/// Runs one episode of a campaign again: what it found, and a line of text for each thing that the
/// promise excludes, when and where. The campaign's number of steps does not matter.
///
/// # Errors
/// When the settings are refused.
pub fn look_at_episode(
    spec: &CampaignSpec,
    id: EpisodeId,
) -> Result<(Tally, Vec<String>), CampaignError> {
    let conditions = conditions(spec);
    let episode = episode(spec.seed, id, &conditions)?;
    let mut lines = episode.described();
    let empty = Tally {
        lines: Some(Vec::new()),
        ..Tally::default()
    };
    let steps = episode_steps(spec.broken) as usize;
    let mut tally = episode.run_into(empty, steps, |_, _| {});
    lines.extend(tally.lines.take().into_iter().flatten());
    Ok((tally, lines))
}

#[cfg(test)]
mod tests;
