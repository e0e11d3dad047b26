//! From the truth to measurements: the LIDAR and the camera by ray casting with noise, the ground
//! truth, and the writers of data sets in the layouts of KITTI and TuSimple.
//!
//! *Architecture invariant:* this crate knows the simulated truth and gives away measurements and
//! labels; it knows nothing of the stages that perceive, share, decide or control, and runs no
//! network.

mod appearance;
mod boxes;
mod camera;
mod caster;
mod dataset;
mod exposure;
mod ground;
mod hull;
pub mod kitti;
mod lidar;
mod marks;
mod mcap;
mod noise;
mod pavement;
mod ros2;
mod shadow;
mod silhouette;
#[cfg(test)]
mod testing;
mod tusimple;
mod viewpoint;

pub use boxes::{TruthBox, in_line_of_sight, truth_boxes, truth_detections};
pub use camera::take_picture;
pub use caster::{Hit, ObjectRef, RayScene, ground_hit};
pub use dataset::{DatasetError, DatasetSpec, Format, Manifest, Split, stop_flag, write_dataset};
pub use lidar::Lidar;
pub use marks::{MarkTruth, true_marks};
pub use mcap::{McapError, write_mcap};
pub use tusimple::{MarkPixels, read_tusimple_line, tusimple_line};
pub use viewpoint::Viewpoint;
