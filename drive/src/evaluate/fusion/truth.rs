//! The truth of one frame: its record in `scenes/`, and the angles in its labels.

use covista_sensors::kitti::{KittiFrame, read_labels};
use covista_world::{Calibration, Detection3d, LaneIndex, ObjectClass};
use nalgebra::Vector3;
use serde::Deserialize;

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

#[derive(Deserialize)]
struct Record {
    seed: u64,
    split: String,
    vehicles: Vec<Vehicle>,
}

#[derive(Deserialize)]
struct Vehicle {
    lane: Option<LaneIndex>,
    center_m: [f64; 3],
    size_m: [f64; 3],
    yaw_rad: f64,
    lidar_points: usize,
}

/// Reads the truth of a frame.
///
/// # Errors
/// When the record or the labels can't be read or are malformed.
pub(super) fn read_scene(
    frame: &KittiFrame,
    calibration: &Calibration,
) -> Result<SceneTruth, EvaluateError> {
    let path = file_of(&frame.scene)?;
    let text = std::fs::read_to_string(path).map_err(|error| EvaluateError::file(path, error))?;
    let record: Record =
        serde_json::from_str(&text).map_err(|error| EvaluateError::file(path, error))?;
    let labels = read_labels(file_of(&frame.labels)?)?;
    let vehicles = record.vehicles.into_iter().map(|vehicle| {
        let center_m = Vector3::from(vehicle.center_m);
        let label = labels.iter().find(|label| {
            let (label_m, _) = label.pose_in_lidar(calibration);
            (label_m - center_m).norm() < SAME_PLACE_M
        });
        TrueVehicle {
            body: Detection3d {
                center_m,
                size_m: Vector3::from(vehicle.size_m),
                yaw_rad: vehicle.yaw_rad,
                class: ObjectClass::Car,
                score: 1.0,
            },
            lane: vehicle.lane,
            lidar_points: vehicle.lidar_points,
            angles: label.map(|label| Angles {
                alpha_rad: label.alpha_rad,
                rotation_y_rad: label.rotation_y_rad,
            }),
        }
    });
    Ok(SceneTruth {
        seed: record.seed,
        split: record.split,
        vehicles: vehicles.collect(),
    })
}
