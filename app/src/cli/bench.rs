//! Options of `covista bench`.

use std::{
    num::{NonZeroU64, NonZeroUsize},
    path::PathBuf,
};

use clap::{Args, Subcommand, ValueEnum};
use covista_perception::ProviderChoice;

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
