//! How good the networks are: TuSimple's figures for marks ([`lanes`]), KITTI's for boxes in the
//! picture ([`kitti`]), average precision of boxes all around ([`all_around`]).

pub mod all_around;
pub mod kitti;
pub mod lanes;

pub use all_around::{Pair, TrueBox, average_precision, pair};
pub use kitti::{BenchmarkFrame, Difficulty, FoundBox, KittiPrecision, LabelledBox, Overlap};
pub use lanes::{LaneAccuracy, lane_accuracy};
