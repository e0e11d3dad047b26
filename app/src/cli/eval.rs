//! Options of `covista eval`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use covista_perception::{Provider, ProviderChoice};

use super::PerceptionArg;

#[derive(Debug, Args)]
pub struct EvalArgs {
    /// What to measure
    #[command(subcommand)]
    pub what: EvalWhat,
}

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum EvalWhat {
    /// TuSimple accuracy of a lane network
    Lanes(NetworkArgs),
    /// Average precision of a detector, as KITTI counts it and all around
    Detector(NetworkArgs),
    /// Lane indices of vehicles, by distance, on curves and straights
    Fusion(FusionArgs),
    /// What each CAV of a scenario knows of the vehicles within 100 m, alone and with sharing
    Cooperative(CooperativeArgs),
    /// What both networks and their fusion do to vehicles that are there: fits or checks the model
    /// of `--perception statistical`
    Errors(ErrorsArgs),
}

/// What computes the networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Args)]
pub struct ProviderArg {
    /// What computes the networks: cpu, openvino (fetched if need be), cuda, or auto, the fastest
    /// of these that is on this machine
    #[arg(long, value_name = "NAME", default_value_t = ProviderArg::default().provider)]
    pub provider: ProviderChoice,
}

impl Default for ProviderArg {
    fn default() -> Self {
        Self {
            provider: ProviderChoice::Only(Provider::Cpu),
        }
    }
}

/// Frames with their truth to measure the fusion on.
#[derive(Debug, Args)]
pub struct FusionArgs {
    /// Folder that `covista dataset` wrote, with `scenes`
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Folder of the networks
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// What computes the networks
    #[command(flatten)]
    pub provider: ProviderArg,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct CooperativeArgs {
    /// Built-in scenarios or TOML files
    #[arg(value_name = "SCENARIO", default_values = ["obstacle-at-corner", "mixed-traffic"])]
    pub scenarios: Vec<String>,
    /// Where percepts come from
    #[arg(long, value_enum, default_value = "network")]
    pub perception: PerceptionArg,
    /// Runs of each scenario, with as many seeds
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub seeds: u64,
    /// The first seed
    #[arg(long, default_value_t = 1000)]
    pub seed: u64,
    /// Simulated seconds of a run, instead of the scenario's
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Folder of the networks
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// What computes the networks
    #[command(flatten)]
    pub provider: ProviderArg,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct ErrorsArgs {
    /// Folder that `covista dataset` wrote
    #[arg(long, value_name = "DIR", required_unless_present = "scenario")]
    pub data: Option<PathBuf>,
    /// A built-in scenario or a TOML file, whose CAVs are driven on exact percepts: every CAV's
    /// frames, one after the other
    #[arg(long)]
    pub scenario: Option<String>,
    /// Simulated seconds, instead of the scenario's
    #[arg(long, value_name = "S", requires = "scenario")]
    pub duration: Option<f64>,
    /// Seed of the scenario
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Fit the errors to --data, and how long they last to --scenario, and write them
    #[arg(long, value_name = "FILE", requires_all = ["data", "scenario"])]
    pub out: Option<PathBuf>,
    /// The error model to compare with, instead of the one that comes with covista
    #[arg(long, value_name = "FILE", conflicts_with = "out")]
    pub errors: Option<PathBuf>,
    /// Folder of the networks
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// A network and the recorded frames to measure it on.
#[derive(Debug, Args)]
pub struct NetworkArgs {
    /// The network's name, as `covista models list` shows it [default: the closed loop's]
    #[arg(long, value_name = "ID")]
    pub model: Option<String>,
    /// The frames
    #[command(flatten)]
    pub recorded: RecordedArgs,
}

/// Recorded frames to measure networks on.
#[derive(Debug, Args)]
pub struct RecordedArgs {
    /// Folder in KITTI's layout, such as `covista dataset` writes, or a single .bin, .png or .jpg
    #[arg(long, value_name = "PATH")]
    pub data: PathBuf,
    /// Labels of a single .bin, in KITTI's format [default: label_2 beside it]
    #[arg(long, value_name = "FILE")]
    pub labels: Option<PathBuf>,
    /// Calibration of a single file, in KITTI's format, or as .toml of a picture of any camera
    /// [default: calib beside it, or KITTI's]
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Folder of the networks
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// What computes the networks
    #[command(flatten)]
    pub provider: ProviderArg,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
