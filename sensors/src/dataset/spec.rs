use std::collections::BTreeSet;
use std::path::PathBuf;
use std::str::FromStr;

use covista_world::Calibration;
use serde::{Deserialize, Serialize};

use crate::{Lidar, LidarError};

/// Which part of the data: the splits of one seed share no scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// For training.
    Train,
    /// For choosing among trained models.
    Val,
    /// For the figures that are reported.
    Test,
}

impl Split {
    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }
}

impl FromStr for Split {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Train, Self::Val, Self::Test]
            .into_iter()
            .find(|split| split.name() == text)
            .ok_or_else(|| format!("`{text}` is no split; use train, val or test"))
    }
}

/// In which layout frames are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// KITTI's object benchmark: `velodyne`, `image_2`, `calib`, `label_2`, `ImageSets`.
    Kitti,
    /// TuSimple's lane benchmark: `label_data.json`, its pictures in `image_2`.
    TuSimple,
    /// One file of ROS 2 messages, `frames.mcap`, made from KITTI's files beside it.
    Mcap,
}

impl Format {
    /// What a data set has unless something else is asked for.
    pub const DEFAULT: [Self; 2] = [Self::Kitti, Self::TuSimple];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Kitti => "kitti",
            Self::TuSimple => "tusimple",
            Self::Mcap => "mcap",
        }
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Kitti, Self::TuSimple, Self::Mcap]
            .into_iter()
            .find(|format| format.name() == text)
            .ok_or_else(|| format!("`{text}` is no format; use kitti, tusimple or mcap"))
    }
}

/// Truth that is written on request.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TruthFile {
    /// What each LIDAR point was measured on: `labels/000007.label`, as SemanticKITTI's.
    Points,
    /// How far each pixel is along the optical axis: `depth_2/000007.png`, as KITTI's depth maps.
    Depth,
    /// Which object each pixel shows: `instance_2/000007.png`, numbered as in the point labels.
    Instance,
}

impl TruthFile {
    /// The folder and the extension of its files.
    pub(super) fn place(self) -> (&'static str, &'static str) {
        match self {
            Self::Points => ("labels", "label"),
            Self::Depth => ("depth_2", "png"),
            Self::Instance => ("instance_2", "png"),
        }
    }

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Points => "points",
            Self::Depth => "depth",
            Self::Instance => "instance",
        }
    }
}

impl FromStr for TruthFile {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Points, Self::Depth, Self::Instance]
            .into_iter()
            .find(|truth| truth.name() == text)
            .ok_or_else(|| {
                format!("`{text}` is no truth that can be written; use points, depth or instance")
            })
    }
}

/// The built-in LIDAR of a name, or that of a beam table (`.toml`).
///
/// # Errors
/// When there is none of that name, or the file is unusable.
pub fn lidar_of(name_or_file: &str) -> Result<Lidar, LidarError> {
    if name_or_file.ends_with(".toml") {
        Lidar::load(name_or_file)
    } else {
        Lidar::builtin(name_or_file)
    }
}

/// Which data set to write, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct DatasetSpec {
    /// Folder; made where it is missing.
    pub out: PathBuf,
    /// Frames to write.
    pub frames: u64,
    /// Number of the first frame.
    pub start: u64,
    /// Seed of everything random.
    pub seed: u64,
    /// Part of the data.
    pub split: Split,
    /// Layouts.
    pub formats: BTreeSet<Format>,
    /// Truth beyond that of the layouts.
    pub truth: BTreeSet<TruthFile>,
    /// The LIDAR.
    pub lidar: Lidar,
    /// The camera, and where both sensors sit; drawn anew for each frame unless it is given.
    pub calibration: Option<Calibration>,
}

impl DatasetSpec {
    /// The first frames of seed 0's training split, measured by KITTI's LIDAR on a drawn rig, for
    /// KITTI's and TuSimple's tools.
    pub fn new(out: PathBuf, frames: u64) -> Self {
        Self {
            out,
            frames,
            start: 0,
            seed: 0,
            split: Split::Train,
            formats: Format::DEFAULT.into(),
            truth: BTreeSet::new(),
            lidar: Lidar::hdl64e(),
            calibration: None,
        }
    }

    /// Whether KITTI's files are written: MCAP is made from them.
    pub(super) fn has_kitti(&self) -> bool {
        self.formats.contains(&Format::Kitti) || self.has_mcap()
    }

    /// Whether a file needs the LIDAR: TuSimple's layout alone does without.
    pub(super) fn has_sweeps(&self) -> bool {
        self.has_kitti() || self.truth.contains(&TruthFile::Points)
    }

    pub(super) fn has_tusimple(&self) -> bool {
        self.formats.contains(&Format::TuSimple)
    }

    pub(super) fn has_mcap(&self) -> bool {
        self.formats.contains(&Format::Mcap)
    }
}
