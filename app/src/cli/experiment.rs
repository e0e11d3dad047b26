//! Options of `covista experiment`, `report` and `train`.

use std::{
    num::{NonZeroU32, NonZeroU64},
    path::PathBuf,
    str::FromStr,
};

use clap::Args;
use covista_drive::{Experiment, Seeds};

use super::PerceptionArg;

/// Which part of the cases to drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 1 to `of`.
    index: usize,
    of: usize,
}

impl Shard {
    /// Its share of `cases`, which go round.
    pub fn of<T>(self, cases: Vec<T>) -> impl Iterator<Item = T> {
        cases.into_iter().skip(self.index - 1).step_by(self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let parts = parts.and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match parts {
            Some((index, of)) if (1..=of).contains(&index) => Ok(Self { index, of }),
            _ => Err("give I/N with I from 1 to N, such as 1/3, 2/3 and 3/3".to_owned()),
        }
    }
}

#[derive(Debug, Args)]
pub struct ExperimentArgs {
    /// cav-ratio, density, safety, headway, episode-reward, action-design, obstacle-at-corner or
    /// truncation
    #[arg(value_name = "NAME")]
    pub name: Experiment,
    /// Folder of the cases, a file each, and of the results; what is there is not driven again
    #[arg(long, value_name = "DIR", default_value = "out/experiments")]
    pub out: PathBuf,
    /// Seeds: so many from 9000 on, or from A to B [default: 5]
    #[arg(long, value_name = "N|A-B")]
    pub seeds: Option<Seeds>,
    /// Drive every Nth case only, beginning with the Ith
    #[arg(long, value_name = "I/N", default_value = "1/1")]
    pub shard: Shard,
    /// Behaviour steps of an episode, 0.5 s each [default: 800; headway 500,
    /// obstacle-at-corner the scenario's length]
    #[arg(long, value_name = "STEPS")]
    pub episode: Option<NonZeroU32>,
    /// Where the CAVs' percepts come from; not for episode-reward
    #[arg(long, value_enum, default_value = "truth")]
    pub perception: PerceptionArg,
    /// Folder of the networks and their cards, for --perception network [default: models, where the
    /// command runs or beside the sources]
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// Folder of the trained policies [default: models, where the command runs or beside the
    /// sources]
    #[arg(long, value_name = "DIR")]
    pub policies: Option<PathBuf>,
    /// Train the policies anew first, into --policies or DIR/policies
    #[arg(long)]
    pub retrain: bool,
    /// Decisions of each learner of a training, for --retrain and episode-reward [default: 12000]
    #[arg(long, value_name = "N")]
    pub decisions: Option<NonZeroU64>,
    /// Folder that `covista train` wrote, for episode-reward instead of a training of its own; may
    /// be repeated
    #[arg(long, value_name = "DIR")]
    pub trained: Vec<PathBuf>,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder that experiments were written to (their --out)
    #[arg(value_name = "DIR")]
    pub dir: PathBuf,
}

#[derive(Debug, Args)]
pub struct TrainArgs {
    /// Traffic, learners and their settings as TOML; without it, the defaults of docs/learning.md
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Decisions of each learner, one at every behaviour step, those of a checkpoint included; the
    /// episode in which they are reached is driven to its end
    #[arg(long, value_name = "N", default_value = "12000")]
    pub decisions: NonZeroU64,
    /// Go on from DIR/checkpoint.safetensors, where there is one
    #[arg(long)]
    pub resume: bool,
    /// Where checkpoint, policy and learning curve go
    #[arg(long, value_name = "DIR", default_value = "out/train")]
    pub out: PathBuf,
    /// Folder of the networks and their cards, where the configuration's perception is network
    /// [default: models, where the command runs or beside the sources]
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
}
