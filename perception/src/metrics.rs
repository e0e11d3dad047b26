//! How good the networks are: TuSimple's figures for marks ([`lanes`]), KITTI's for boxes in the
//! picture ([`kitti`]), average precision of boxes all around ([`average_precision`]).

pub mod average_precision;
pub mod kitti;
pub mod lanes;

pub use average_precision::{Pair, TrueBox, average_precision, pair};
pub use kitti::{BenchmarkFrame, Difficulty, FoundBox, KittiPrecision, LabelledBox, Overlap};
pub use lanes::{LaneAccuracy, lane_accuracy};
