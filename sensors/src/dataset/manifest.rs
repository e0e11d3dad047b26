use std::collections::{BTreeMap, BTreeSet};

use covista_world::CameraIntrinsics;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::folder::sha256_hex;
use super::spec::{DatasetSpec, Format, Split, TruthFile};

/// Raised whenever the same seed gives other bytes than before.
pub(super) const VERSION: u32 = 2;

/// What a data set on disk was made with, and what is finished of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the generator.
    pub version: u32,
    /// Seed.
    pub seed: u64,
    /// Part of the data.
    pub split: Split,
    /// Layouts.
    pub formats: BTreeSet<Format>,
    /// Truth beyond that of the layouts.
    pub truth: BTreeSet<TruthFile>,
    /// The LIDAR's name.
    pub lidar: String,
    /// SHA-256 of all that its beam table says.
    pub lidar_sha256: String,
    /// The camera, unless it is drawn anew for each frame.
    pub camera: Option<CameraIntrinsics>,
    /// LIDAR frame to vehicle frame, likewise.
    pub vehicle_from_lidar: Option<Isometry3<f64>>,
    /// Camera frame to vehicle frame, likewise.
    pub vehicle_from_camera: Option<Isometry3<f64>>,
    /// Finished frames.
    pub frames: u64,
    /// SHA-256 of each file of the finished frames, by its path in the folder.
    pub files: BTreeMap<String, String>,
}

/// The part of a manifest that all versions have.
#[derive(Deserialize)]
struct AnyVersion {
    version: u32,
}

impl Manifest {
    /// Of a data set without a frame.
    pub(super) fn new(spec: &DatasetSpec) -> Self {
        let calibration = spec.calibration.as_ref();
        Self {
            version: VERSION,
            seed: spec.seed,
            split: spec.split,
            formats: spec.formats.clone(),
            truth: spec.truth.clone(),
            lidar: spec.lidar.name.clone(),
            lidar_sha256: sha256_hex(format!("{:?}", spec.lidar).as_bytes()),
            camera: calibration.map(|fixed| fixed.intrinsics),
            vehicle_from_lidar: calibration.map(|fixed| fixed.vehicle_from_lidar),
            vehicle_from_camera: calibration.map(|fixed| fixed.vehicle_from_camera),
            frames: 0,
            files: BTreeMap::new(),
        }
    }

    /// What keeps frames of this data set out of a folder with the manifest `text`, if anything.
    pub(super) fn difference(&self, text: &str) -> Option<&'static str> {
        match serde_json::from_str::<AnyVersion>(text) {
            Err(_) => return Some("a manifest.json that can't be read"),
            Ok(found) if found.version != self.version => {
                return Some("a data set of another version of the generator");
            }
            Ok(_) => {}
        }
        let Ok(found) = serde_json::from_str::<Self>(text) else {
            return Some("a manifest.json that can't be read");
        };
        let differs = [
            (found.seed != self.seed, "a data set of another seed"),
            (found.split != self.split, "a data set of another split"),
            (found.formats != self.formats, "a data set of other formats"),
            (found.truth != self.truth, "a data set with other truth"),
            (
                found.lidar_sha256 != self.lidar_sha256,
                "a data set of another LIDAR",
            ),
            (
                (
                    found.camera,
                    found.vehicle_from_lidar,
                    found.vehicle_from_camera,
                ) != (
                    self.camera,
                    self.vehicle_from_lidar,
                    self.vehicle_from_camera,
                ),
                "a data set of another calibration",
            ),
        ];
        differs
            .into_iter()
            .find_map(|(differs, what)| differs.then_some(what))
    }
}
