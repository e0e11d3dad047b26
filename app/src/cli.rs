mod bench;
mod eval;
mod experiment;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use covista_sensors::{Format, Split, TruthFile};

pub use bench::*;
pub use eval::*;
pub use experiment::*;

/// Cooperative vision, planning and safe control of connected vehicles, on a laptop.
///
/// Without a command: `covista demo obstacle-at-corner`.
#[derive(Debug, Parser)]
#[command(name = "covista", version)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Drive a scenario with and without shared vision and compare
    Demo(DemoArgs),
    /// Write synthetic camera and LIDAR frames with their ground truth
    Dataset(DatasetArgs),
    /// Measure a network on a dataset
    Eval(EvalArgs),
    /// Measure how fast a stage is on this machine
    Bench(BenchArgs),
    /// Train the behaviour of CAVs on the three-lane loop
    Train(TrainArgs),
    /// Run an experiment of the paper, and set its figures beside ours
    Experiment(ExperimentArgs),
    /// Put the experiments of a folder on one HTML page
    Report(ReportArgs),
    /// List the networks, or check their files against their cards
    Models(ModelsArgs),
}

/// Which of the two runs to make.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SharingArg {
    On,
    Off,
    Both,
}

/// Which controller acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModeArg {
    /// The barriers of docs/safety.md
    Safe,
    /// The paper's QP as its text has it: it keeps no distance
    Paper,
    /// No filter: the reference alone, and every action counts as safe
    Off,
}

/// Where percepts come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PerceptionArg {
    /// The lane network and the detector, on rendered images and point clouds
    Network,
    /// Boxes and lanes with the networks' errors, drawn from a fitted model; takes seconds
    Statistical,
    /// Exact boxes and lanes of what is in line of sight
    Truth,
}

#[derive(Debug, Args)]
pub struct DemoArgs {
    /// A built-in scenario or a TOML file; or recorded frames for the networks: a folder in KITTI's
    /// layout, a .bin, .png or .jpg
    #[arg(default_value = "obstacle-at-corner")]
    pub scenario: String,
    /// Whether the CAVs share what they see
    #[arg(long, value_enum, default_value = "both")]
    pub sharing: SharingArg,
    /// Where percepts come from
    #[arg(long, value_enum, default_value = "network")]
    pub perception: PerceptionArg,
    /// Errors for --perception statistical, as `covista eval errors` fits them [default: those of
    /// the networks that come with covista]
    #[arg(long, value_name = "FILE")]
    pub errors: Option<PathBuf>,
    /// Simulated seconds, instead of the scenario's
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Which controller acts [default: what --control says, or safe]
    #[arg(long, value_enum)]
    pub mode: Option<ModeArg>,
    /// Settings of the controller as TOML; what it leaves out keeps its default
    #[arg(long, value_name = "FILE")]
    pub control: Option<PathBuf>,
    /// Calibration of a recorded frame, in KITTI's format, or as .toml of a picture of any camera
    /// [default: the one beside it, or KITTI's]
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Output folder [default: out/SCENARIO]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Folder of the networks and their cards [default: models, where the command runs or beside
    /// the sources]
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// What computes the networks
    #[command(flatten)]
    pub provider: ProviderArg,
    /// Write the truth as CSV, one row a vehicle every 0.1 s
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Open the recordings in the rerun viewer afterwards
    #[arg(long)]
    pub view: bool,
}

impl Default for DemoArgs {
    fn default() -> Self {
        Self {
            scenario: "obstacle-at-corner".into(),
            sharing: SharingArg::Both,
            perception: PerceptionArg::Network,
            errors: None,
            duration: None,
            seed: 0,
            mode: None,
            control: None,
            calibration: None,
            out: None,
            models: None,
            provider: ProviderArg::default(),
            trace: None,
            view: false,
        }
    }
}

#[derive(Debug, Args)]
pub struct DatasetArgs {
    /// Output folder
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Frames in all; those already there are kept
    #[arg(long)]
    pub frames: u64,
    /// Number of the first frame
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub start: u64,
    /// Seed of the scenes
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// train, val or test; their scenes are never the same
    #[arg(long, default_value = "train")]
    pub split: Split,
    /// Layouts, of kitti, tusimple and mcap (made from KITTI's files, which then are written, too)
    #[arg(long, value_delimiter = ',', default_value = "kitti,tusimple")]
    pub format: Vec<Format>,
    /// Truth beyond the layouts', of points (what each was measured on, as SemanticKITTI's), depth
    /// and instance (16-bit pictures)
    #[arg(long, value_delimiter = ',')]
    pub truth: Vec<TruthFile>,
    /// The LIDAR: a built-in one or a beam table (.toml)
    #[arg(long, value_name = "NAME|FILE", default_value = "hdl-64e")]
    pub lidar: String,
    /// Camera and mounting of all frames (.toml) [default: drawn for each frame]
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct ModelsArgs {
    /// What to do
    #[arg(value_enum, default_value = "list")]
    pub what: ModelsWhat,
    /// Folder of the networks
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModelsWhat {
    /// One line a network
    List,
    /// Check hash, names and shapes
    Verify,
}
