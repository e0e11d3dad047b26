//! The truth of one frame: its record in `scenes/`, and the angles in its labels.

use covista_sensors::{
    RecordedVehicle,
    kitti::{KittiFrame, read_labels},
    read_scene as read_record,
};
use covista_world::{Calibration, Detection3d, LaneIndex};

use super::super::{EvaluateError, file_of};

/// A label is of the vehicle whose centre is so near: files have millimetres.
const SAME_PLACE_M: f64 = 0.05;

/// What is there.
pub(super) struct SceneTruth {
    pub seed: u64,
    pub split: String,
    pub vehicles: Vec<TrueVehicle>,
}

/// A vehicle that is there, seen or not.
pub(super) struct TrueVehicle {
    /// In the LIDAR frame; its class and score have no meaning.
    pub body: Detection3d,
    /// Its lane, if it is in one of the three.
    pub lane: Option<LaneIndex>,
    pub lidar_points: usize,
    /// KITTI's angles, where it has a label.
    pub angles: Option<Angles>,
}

#[derive(Clone, Copy)]
pub(super) struct Angles {
    pub alpha_rad: f64,
    pub rotation_y_rad: f64,
}

/// Reads the truth of a frame.
///
/// # Errors
/// When the record or the labels can't be read or are malformed.
pub(super) fn read_scene(
    frame: &KittiFrame,
    calibration: &Calibration,
) -> Result<SceneTruth, EvaluateError> {
    let scene = read_record(file_of(&frame.scene)?)?;
    let labels = read_labels(file_of(&frame.labels)?)?;
    let vehicles = scene.vehicles.into_iter().map(|vehicle| {
        let RecordedVehicle { seen, lidar_points } = vehicle;
        let center_m = seen.truth.center_m;
        let label = labels.iter().find(|label| {
            let (label_m, _) = label.pose_in_lidar(calibration);
            (label_m - center_m).norm() < SAME_PLACE_M
        });
        TrueVehicle {
            body: seen.truth,
            lane: seen.lane,
            lidar_points,
            angles: label.map(|label| Angles {
                alpha_rad: label.alpha_rad,
                rotation_y_rad: label.rotation_y_rad,
            }),
        }
    });
    Ok(SceneTruth {
        seed: scene.seed,
        split: scene.split,
        vehicles: vehicles.collect(),
    })
}
