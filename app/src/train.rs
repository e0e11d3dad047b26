//! `covista train`: the safe actor-critic and its baselines on the three-lane loop.

use std::{fmt::Write as _, path::Path};

use anyhow::Context;
use covista_drive::{RingEnvironment, RoundReport, Trainer, TrainingConfig};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::{
    cli::TrainArgs,
    output::{prepare_folder, say, write_json, write_whole},
};

/// Rounds between two checkpoints.
const CHECKPOINT_ROUNDS: u64 = 5;
const CURVE_HEADER: &str =
    "round,reward,unsafe_actions,emergency_stops,lane_changes,updates,critic_loss,value\n";

/// `covista train`.
pub fn run(args: &TrainArgs) -> anyhow::Result<()> {
    let config = match &args.config {
        Some(path) => TrainingConfig::load(path)?,
        None => TrainingConfig::default(),
    };
    prepare_folder(&args.out)?;
    let checkpoint = args.out.join("checkpoint.safetensors");
    let curve_file = args.out.join("curve.csv");
    let goes_on = args.resume && checkpoint.exists();
    let mut trainer = if goes_on {
        config.resume(&checkpoint)?
    } else {
        config.start()?
    };
    let mut curve = if goes_on {
        first_rounds(&curve_file, trainer.rounds())?
    } else {
        CURVE_HEADER.to_owned()
    };
    let episodes = args.episodes.get();
    let bar = ProgressBar::new(episodes).with_position(trainer.rounds());
    if let Ok(style) = ProgressStyle::with_template("[{bar:30}] {pos}/{len} {msg}, {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.tick();
    while trainer.rounds() < episodes {
        let report = match trainer.train_round() {
            Ok(report) => report,
            Err(error) => {
                let failed = args.out.join("failed.safetensors");
                trainer.save(&failed)?;
                let place = failed.display().to_string();
                return Err(error).with_context(|| format!("stopped; the state is in {place}"));
            }
        };
        let reward = mean_reward(&report);
        let row = CurveRow::new(trainer.rounds(), &report);
        row.write(&mut curve)?;
        bar.set_message(format!(
            "reward {reward:.1}, {} unsafe actions, {} updates",
            row.unsafe_actions, row.updates
        ));
        bar.set_position(trainer.rounds());
        if trainer.rounds() % CHECKPOINT_ROUNDS == 0 || trainer.rounds() == episodes {
            keep(&trainer, &config, &args.out, &curve)?;
        }
    }
    bar.finish_and_clear();
    let report = trainer.evaluate(config.training.seed ^ 0xE7A1)?;
    say(&format!(
        "trained {} rounds; without exploration, on another episode: reward {:.2} a CAV, {} unsafe actions, {} emergency stops\nwritten to {}",
        trainer.rounds(),
        mean_reward(&report),
        report.episodes.iter().map(|episode| episode.unsafe_actions).sum::<u64>(),
        report.episodes.iter().map(|episode| episode.emergency_stops).sum::<u64>(),
        args.out.display()
    ))
}

/// One line of the learning curve.
struct CurveRow {
    round: u64,
    reward: f64,
    unsafe_actions: u64,
    emergency_stops: u64,
    lane_changes: u64,
    updates: u64,
    critic_loss: f64,
    value: f64,
}

impl CurveRow {
    fn new(round: u64, report: &RoundReport) -> Self {
        let sum = |of: fn(&covista_drive::EpisodeReport) -> u64| report.episodes.iter().map(of).sum();
        Self {
            round,
            reward: mean_reward(report),
            unsafe_actions: sum(|episode| episode.unsafe_actions),
            emergency_stops: sum(|episode| episode.emergency_stops),
            lane_changes: sum(|episode| episode.lane_changes),
            updates: report.updates.updates,
            critic_loss: report.updates.critic_loss,
            value: report.updates.value,
        }
    }

    fn write(&self, curve: &mut String) -> std::fmt::Result {
        writeln!(
            curve,
            "{},{:.4},{},{},{},{},{:.6},{:.4}",
            self.round,
            self.reward,
            self.unsafe_actions,
            self.emergency_stops,
            self.lane_changes,
            self.updates,
            self.critic_loss,
            self.value
        )
    }
}

fn mean_reward(report: &RoundReport) -> f64 {
    let sum: f64 = report.episodes.iter().map(|episode| episode.reward).sum();
    sum / report.episodes.len().max(1) as f64
}

fn keep(
    trainer: &Trainer<RingEnvironment>,
    config: &TrainingConfig,
    out: &Path,
    curve: &str,
) -> anyhow::Result<()> {
    trainer.save(&out.join("checkpoint.safetensors"))?;
    trainer.save_policy(&out.join("policy.safetensors"))?;
    write_whole(&out.join("curve.csv"), curve.as_bytes())?;
    let settings = json!({
        "command": "train",
        "version": env!("CARGO_PKG_VERSION"),
        "rounds": trainer.rounds(),
        "environments": config.environments,
        "environment": config.environment,
        "training": trainer.settings(),
    });
    write_json(&out.join("settings.json"), &settings)
}

/// The learning curve up to the round of the checkpoint.
fn first_rounds(file: &Path, rounds: u64) -> anyhow::Result<String> {
    let text = std::fs::read_to_string(file)
        .with_context(|| format!("cannot read {}; leave out --resume to begin anew", file.display()))?;
    Ok(text
        .lines()
        .take(1 + rounds as usize)
        .map(|line| format!("{line}\n"))
        .collect())
}
