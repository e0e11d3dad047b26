//! One frame: the scene, measured, in the files of each layout.

use std::collections::BTreeMap;

use covista_traffic::{SampledScene, sample_scene};
use covista_world::CameraImage;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::error::{DatasetError, encoding};
use super::folder::{record_path, sha256_hex};
use super::truth_files::truth_files;
use super::{DatasetSpec, Split};
use crate::dataset::description::SceneDescription;
use crate::kitti::{KittiLabel, calibration_text, cloud_bytes};
use crate::{
    LabelledCloud, Lidar, RayScene, Viewpoint, sample_rig, take_picture, true_marks, truth_boxes,
    tusimple_line,
};

pub(super) const LANES_FOLDER: &str = "lanes";
pub(super) const RECORD_FOLDER: &str = "scenes";
/// Vehicles farther than this from the LIDAR are not labelled.
const LABEL_RANGE_M: f64 = 75.0;

/// A file of a frame.
pub(super) struct FrameFile {
    /// Its path in the data set's folder.
    pub(super) path: String,
    pub(super) content: Vec<u8>,
}

/// Makes frames; each depends on the data set's seed and split and on its own number alone.
pub(super) struct FrameMaker<'a> {
    spec: &'a DatasetSpec,
    pub(super) scene_seed: u64,
    lidar_seed: u64,
    camera_seed: u64,
    rig_seed: u64,
}

/// What a frame is and was drawn from: `scenes/000007.json`.
#[derive(Serialize)]
struct Record<'a> {
    frame: u64,
    seed: u64,
    split: Split,
    #[serde(flatten)]
    scene: SceneDescription,
    /// SHA-256 of the frame's other files.
    files: BTreeMap<&'a str, String>,
}

/// The folders that a data set has.
pub(super) fn folders(spec: &DatasetSpec) -> Vec<&'static str> {
    let mut folders = vec!["image_2", RECORD_FOLDER];
    if spec.has_kitti() {
        folders.extend(["velodyne", "calib", "label_2", "ImageSets"]);
    }
    if spec.has_tusimple() {
        folders.push(LANES_FOLDER);
    }
    folders.extend(spec.truth.iter().map(|truth| truth.place().0));
    folders
}

impl<'a> FrameMaker<'a> {
    pub(super) fn new(spec: &'a DatasetSpec) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(spec.split as u64);
        Self {
            spec,
            scene_seed: rng.next_u64(),
            lidar_seed: rng.next_u64(),
            camera_seed: rng.next_u64(),
            rig_seed: rng.next_u64(),
        }
    }

    /// The files of a frame in the order in which they are to be written, its record last.
    pub(super) fn measure(&self, frame: u64) -> Result<Vec<FrameFile>, DatasetError> {
        let rig = sample_rig(self.rig_seed, frame);
        let calibration = self.spec.calibration.as_ref().unwrap_or(&rig.calibration);
        let lidar = Lidar {
            motion: rig.lidar_motion,
            specimen: rig.lidar_specimen,
            ..self.spec.lidar.clone()
        };
        let SampledScene { scene, ego, kind } = sample_scene(self.scene_seed, frame);
        let rays = RayScene::rolling(&scene, lidar.half_turn_s());
        let view = Viewpoint::new(&scene, &rays, ego, calibration)
            .ok_or("the scene lacks its own vehicle")
            .map_err(encoding(frame))?;
        let swept = if self.spec.has_sweeps() {
            lidar.sweep_labelled(&view, self.lidar_seed ^ frame)
        } else {
            LabelledCloud::default()
        };
        let image = take_picture(&view, &rig.camera, self.camera_seed ^ frame);
        let truth = truth_boxes(&view, &swept);
        let marks = true_marks(&view);
        let mut files = vec![FrameFile {
            path: format!("image_2/{frame:06}.png"),
            content: png(&image).map_err(encoding(frame))?,
        }];
        if self.spec.has_kitti() {
            let labels: String = truth
                .iter()
                .filter(|truth| truth.lidar_points > 0)
                .filter(|truth| truth.center_m.xy().norm() <= LABEL_RANGE_M)
                .map(|truth| format!("{}\n", KittiLabel::new(truth, calibration)))
                .collect();
            files.extend([
                FrameFile {
                    path: format!("velodyne/{frame:06}.bin"),
                    content: cloud_bytes(&swept.cloud),
                },
                FrameFile {
                    path: format!("calib/{frame:06}.txt"),
                    content: calibration_text(calibration).into_bytes(),
                },
                FrameFile {
                    path: format!("label_2/{frame:06}.txt"),
                    content: labels.into_bytes(),
                },
            ]);
        }
        for (truth, content) in
            truth_files(&view, &swept, &self.spec.truth).map_err(encoding(frame))?
        {
            let (folder, extension) = truth.place();
            files.push(FrameFile {
                path: format!("{folder}/{frame:06}.{extension}"),
                content,
            });
        }
        if self.spec.has_tusimple() {
            let line = tusimple_line(&files[0].path, &marks.pixels).map_err(encoding(frame))?;
            files.push(FrameFile {
                path: format!("{LANES_FOLDER}/{frame:06}.json"),
                content: (line + "\n").into_bytes(),
            });
        }
        let record = Record {
            frame,
            seed: self.spec.seed,
            split: self.spec.split,
            scene: SceneDescription::new(&view, kind, &rig, &truth, &marks, self.spec.has_sweeps()),
            files: files
                .iter()
                .map(|file| (file.path.as_str(), sha256_hex(&file.content)))
                .collect(),
        };
        let content = serde_json::to_vec(&record).map_err(encoding(frame))?;
        files.push(FrameFile {
            path: record_path(frame),
            content,
        });
        Ok(files)
    }
}

fn png(image: &CameraImage) -> Result<Vec<u8>, image::ImageError> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Sub).write_image(
        &image.rgb,
        image.width_px,
        image.height_px,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}
