//! A frame's record, `scenes/000007.json`, read back.

use std::path::Path;

use covista_traffic::{VehicleId, VehicleModel};
use covista_world::{Detection3d, LaneIndex, MARK_COUNT};
use nalgebra::Vector3;
use serde::Deserialize;

use crate::SeenVehicle;
use crate::kitti::{KittiError, io_error, malformed};

/// What a frame of a data set was drawn from, and the truth of its vehicles.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFile {
    /// Seed of the data set.
    pub seed: u64,
    /// Its split.
    pub split: String,
    /// Whether both marks between the three lanes are labelled: all freeways, no street.
    pub marked: bool,
    /// The vehicles other than the own one, hidden ones included.
    pub vehicles: Vec<RecordedVehicle>,
}

/// A vehicle of the record.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedVehicle {
    /// As it truly is.
    pub seen: SeenVehicle,
    /// Returns of the LIDAR from it; 0 in a frame without a sweep.
    pub lidar_points: usize,
}

#[derive(Deserialize)]
struct Record {
    seed: u64,
    split: String,
    #[serde(default)]
    marks_m: [Vec<[f64; 2]>; MARK_COUNT],
    vehicles: Vec<Vehicle>,
}

#[derive(Deserialize)]
struct Vehicle {
    id: u32,
    model: String,
    lane: Option<LaneIndex>,
    center_m: [f64; 3],
    size_m: [f64; 3],
    yaw_rad: f64,
    visibility: f64,
    #[serde(default)]
    lidar_points: usize,
}

/// Reads the record of a frame.
///
/// # Errors
/// When the file can't be read, or isn't what `covista dataset` writes.
pub fn read_scene(path: &Path) -> Result<SceneFile, KittiError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    let malformed = malformed(path);
    let record: Record =
        serde_json::from_str(&text).map_err(|error| malformed(error.to_string()))?;
    let vehicles = record.vehicles.iter().map(|vehicle| {
        let model = VehicleModel::ALL
            .into_iter()
            .find(|model| format!("{model:?}").to_lowercase() == vehicle.model)
            .ok_or_else(|| malformed(format!("there is no vehicle model {}", vehicle.model)))?;
        let seen = SeenVehicle {
            id: VehicleId(vehicle.id),
            truth: Detection3d {
                center_m: Vector3::from(vehicle.center_m),
                size_m: Vector3::from(vehicle.size_m),
                yaw_rad: vehicle.yaw_rad,
                class: model.class(),
                score: 1.0,
            },
            lane: vehicle.lane,
            visibility: vehicle.visibility,
        };
        Ok(RecordedVehicle {
            seen,
            lidar_points: vehicle.lidar_points,
        })
    });
    Ok(SceneFile {
        seed: record.seed,
        marked: record.marks_m[1..MARK_COUNT - 1]
            .iter()
            .all(|mark| !mark.is_empty()),
        vehicles: vehicles.collect::<Result<_, KittiError>>()?,
        split: record.split,
    })
}

#[cfg(test)]
mod tests {
    use covista_world::ObjectClass;

    use super::*;

    #[test]
    fn a_record_is_read_and_what_is_none_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("000001.json");
        let text = r#"{"frame":1,"seed":5,"split":"val","vehicles":[{"id":3,"model":"bus",
            "lane":2,"center_m":[10.0,-3.5,-0.3],"size_m":[12.0,2.5,3.0],"yaw_rad":0.1,
            "visibility":0.5,"lidar_points":70}]}"#;
        std::fs::write(&path, text).expect("written");
        let scene = read_scene(&path).expect("a record");
        assert_eq!((scene.seed, scene.split.as_str()), (5, "val"));
        let [bus] = scene.vehicles.as_slice() else {
            panic!("one vehicle: {scene:?}")
        };
        assert_eq!(
            (bus.seen.id, bus.seen.lane),
            (VehicleId(3), LaneIndex::new(2))
        );
        assert_eq!(bus.seen.truth.class, ObjectClass::Truck);
        assert!((bus.seen.truth.size_m.x - 12.0).abs() < 1e-12);
        for (from, to) in [("bus", "tank"), ("\"seed\":5,", ""), ("}]}", "}]")] {
            std::fs::write(&path, text.replace(from, to)).expect("written");
            let said = read_scene(&path).expect_err("refused").to_string();
            assert!(
                said.contains("000001.json") && !said.contains('\n'),
                "{said}"
            );
        }
    }
}
