//! From the truth to measurements: the LIDAR and the camera by ray casting with noise, the ground
//! truth, and the writers of data sets in the layouts of KITTI and TuSimple.
//!
//! *Architecture invariant:* this crate knows the simulated truth and gives away measurements and
//! labels; it knows nothing of the stages that perceive, share, decide or control, and runs no
//! network.

mod appearance;
mod benchmark;
mod boxes;
mod bvh;
mod camera;
mod carriageway;
mod caster;
mod dataset;
mod exposure;
mod fan;
mod ground;
mod hull;
pub mod kitti;
mod lidar;
mod light;
mod marks;
mod mcap;
mod noise;
mod part;
mod pavement;
mod pixel_rays;
mod rig;
mod ros2;
mod shadow;
mod sight;
mod silhouette;
mod skyline;
mod solids;
mod statistical;
mod sunlight;
#[cfg(test)]
mod testing;
mod tile;
mod truth_images;
mod tusimple;
mod viewpoint;

pub use benchmark::{Ground, SensorTimings, busy_road, time_sensors};
pub use boxes::{TruthBox, in_line_of_sight, seen_vehicles, truth_boxes, truth_detections};
pub use camera::take_picture;
pub use caster::{Hit, ObjectRef, RayScene, Sighting};
pub use dataset::{
    DatasetError, DatasetSpec, Format, Manifest, RecordedVehicle, SceneFile, Split, TruthFile,
    lidar_of, read_scene, stop_flag, write_dataset,
};
pub use exposure::{Bonnet, CameraSettings};
pub use lidar::{Beam, LabelledCloud, Lidar, LidarError, Motion, PointLabel};
pub use marks::{MarkTruth, true_marks};
pub use mcap::{McapError, write_mcap};
pub use rig::{Rig, sample_rig};
pub use statistical::{
    DrawnBox, ErrorModel, ErrorModelError, ErrorSource, FalseBoxRate, FalseBoxes, LaneErrors,
    LaneShares, Lasting, Observer, QUANTILE_SHARES, Quantiles, SeenVehicle, VehicleErrors,
};
pub use truth_images::{TruthImages, instance_number, take_truth_images};
pub use tusimple::{MarkPixels, read_tusimple_line, tusimple_line};
pub use viewpoint::Viewpoint;
