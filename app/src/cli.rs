use std::{
    num::{NonZeroU32, NonZeroU64, NonZeroUsize},
    path::PathBuf,
    str::FromStr,
};

use clap::{Args, Parser, Subcommand, ValueEnum};
use covista_drive::{Experiment, Seeds};
use covista_perception::{Provider, ProviderChoice};
use covista_sensors::{Format, Split, TruthFile};

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

/// Where percepts come from in an experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PerceptArg {
    /// Exact boxes and lanes of what is in line of sight
    Truth,
    /// Boxes and lanes with the networks' errors, drawn from a fitted model
    Statistical,
}

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
    /// Behaviour steps of an episode, 0.5 s each [default: 800; headway 500, training 200,
    /// obstacle-at-corner the scenario's length]
    #[arg(long, value_name = "STEPS")]
    pub episode: Option<NonZeroU32>,
    /// Where the CAVs' percepts come from; not for episode-reward
    #[arg(long, value_enum, default_value = "truth")]
    pub perception: PerceptArg,
    /// Folder of the trained policies [default: models, where the command runs or beside the
    /// sources]
    #[arg(long, value_name = "DIR")]
    pub policies: Option<PathBuf>,
    /// Train the policies anew first, into --policies or DIR/policies
    #[arg(long)]
    pub retrain: bool,
    /// Decisions of each learner of a training, for --retrain and episode-reward
    #[arg(long, value_name = "N", default_value = "20000")]
    pub decisions: NonZeroU64,
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
    #[arg(long, value_name = "N", default_value = "20000")]
    pub decisions: NonZeroU64,
    /// Go on from DIR/checkpoint.safetensors, where there is one
    #[arg(long)]
    pub resume: bool,
    /// Where checkpoint, policy and learning curve go
    #[arg(long, value_name = "DIR", default_value = "out/train")]
    pub out: PathBuf,
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

#[derive(Debug, Args)]
pub struct BenchArgs {
    /// What to time
    #[command(subcommand)]
    pub what: BenchWhat,
}

/// What to time.
#[derive(Debug, Subcommand)]
pub enum BenchWhat {
    /// Rays, LIDAR sweeps and pictures, against the number of vehicles and rays
    Sensors(SensorBenchArgs),
    /// The networks, alone and end to end, against their accuracy
    Perception(PerceptionBenchArgs),
    /// The safety filter: an adversarial campaign on the truth, and the time of one step
    Control(ControlBenchArgs),
    /// Human traffic on the three-lane loop, on one core
    Traffic(TrafficBenchArgs),
    /// The closed loop without networks, an episode of training, and one agent's update
    Training(TrainingBenchArgs),
}

#[derive(Debug, Args)]
pub struct TrainingBenchArgs {
    /// Decisions of the episode of Alg. 2; 800 are the paper's 40,000 control steps
    #[arg(long, value_name = "N", default_value = "800")]
    pub decisions: NonZeroU64,
    /// Make the same updates in Python, too, turn by turn
    #[arg(long, value_enum, value_name = "WHAT")]
    pub against: Option<UpdatePeerArg>,
    /// Write settings, machine and rows to FILE
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What else makes the updates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum UpdatePeerArg {
    /// PyTorch in eager mode, on one thread
    Pytorch,
}

#[derive(Debug, Args)]
pub struct TrafficBenchArgs {
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct ControlBenchArgs {
    /// Controlled steps of the campaign; the other parts are shorter in proportion
    #[arg(long, value_name = "N", default_value = "10000000")]
    pub steps: NonZeroU64,
    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct SensorBenchArgs {
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct PerceptionBenchArgs {
    /// A network's name, as `covista models list` shows it; may be repeated [default: all of them]
    #[arg(long, value_name = "ID")]
    pub model: Vec<String>,
    /// cpu, openvino, cuda or auto, the fastest there is; may be repeated [default: cpu and auto]
    #[arg(long, value_name = "NAME")]
    pub provider: Vec<ProviderChoice>,
    /// Threads of each network [default: one a core]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Frames that count, of each network
    #[arg(long, value_name = "N", default_value = "100")]
    pub repetitions: NonZeroUsize,
    /// Folder in KITTI's layout with pictures and sweeps [default: frames rendered at the start]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Run the same networks in Python, too, turn by turn; may be repeated
    #[arg(long, value_enum, value_name = "WHAT")]
    pub against: Vec<PeerArg>,
    /// Folder of the networks
    #[arg(long, value_name = "DIR")]
    pub models: Option<PathBuf>,
    /// Write the rows as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw accuracy against images/s
    #[arg(long, value_name = "FILE.png")]
    pub plot: Option<PathBuf>,
}

/// What else runs the networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PeerArg {
    /// ONNX Runtime's Python package with NumPy around it
    OnnxruntimePython,
    /// PyTorch in eager mode with NumPy around it
    Pytorch,
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
