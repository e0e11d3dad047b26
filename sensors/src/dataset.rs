//! Data sets: random scenes, measured by LIDAR and camera at the same time stamp, with KITTI's and
//! TuSimple's labels.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicUsize, Ordering};

use covista_traffic::{SampledScene, sample_scene};
use covista_world::{Calibration, CameraImage};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::kitti::{KittiLabel, calibration_text, cloud_bytes};
use crate::{
    CameraSettings, Lidar, RayScene, Viewpoint, take_picture, true_marks, truth_boxes,
    tusimple_line,
};

/// Raised whenever the same seed gives other bytes than before.
const VERSION: u32 = 1;
/// Vehicles farther than this from the LIDAR are not labelled.
const LABEL_RANGE_M: f64 = 75.0;
/// TuSimple's file of all frames, and the folder of its lines.
const LANES_FILE: &str = "label_data.json";
const LANES_FOLDER: &str = "lanes";
const MANIFEST_FILE: &str = "manifest.json";

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

impl FromStr for Split {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "train" => Ok(Self::Train),
            "val" => Ok(Self::Val),
            "test" => Ok(Self::Test),
            _ => Err(format!("`{text}` is no split; use train, val or test")),
        }
    }
}

/// Which data set to write, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
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
}

/// What a data set on disk was made with.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Version of the generator.
    pub version: u32,
    /// Seed.
    pub seed: u64,
    /// Part of the data.
    pub split: Split,
    /// Frames in the folder, numbered from `start`.
    pub frames: u64,
    /// Number of the first frame.
    pub start: u64,
    /// The LIDAR's beams and columns.
    pub lidar: [u32; 2],
    /// Width and height of the images in pixels.
    pub image_px: [u32; 2],
}

/// Why a data set can't be written.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The file system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: String,
        /// Its reason.
        source: std::io::Error,
    },
    /// The folder holds another data set.
    #[error(
        "{path} holds a data set of another seed, split, start or version; choose another folder or remove it"
    )]
    Foreign {
        /// The folder.
        path: String,
    },
    /// A frame can't be put in its file format.
    #[error("frame {frame}: {what}")]
    Encoding {
        /// Number of the frame.
        frame: u64,
        /// What failed.
        what: String,
    },
}

/// Writes the frames that are not there yet, in parallel, and tells `progress` (frames done, frames
/// in all) after each.
///
/// A frame's files are named by its number: `velodyne/000007.bin`, `image_2/000007.png`,
/// `calib/000007.txt`, `label_2/000007.txt`, `lanes/000007.json`. `label_data.json` joins the lanes
/// of all frames.
///
/// # Errors
/// When a file can't be written or the folder holds another data set.
pub fn write_dataset(
    spec: &DatasetSpec,
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Manifest, DatasetError> {
    let generator = Generator::new(spec);
    generator.claim_folder()?;
    let frames = spec.start..spec.start.saturating_add(spec.frames);
    let (done, total) = (AtomicUsize::new(0), spec.frames as usize);
    frames.clone().into_par_iter().try_for_each(|frame| {
        generator.write_frame(frame)?;
        progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
        Ok(())
    })?;
    generator.join_lanes(frames)?;
    let manifest = generator.manifest();
    generator.write_manifest(&manifest)?;
    Ok(manifest)
}

/// Everything that all frames share.
struct Generator<'a> {
    spec: &'a DatasetSpec,
    calibration: Calibration,
    lidar: Lidar,
    scene_seed: u64,
    lidar_seed: u64,
    camera_seed: u64,
}

/// A file of a frame: folder, extension, content.
type FrameFile = (&'static str, &'static str, Vec<u8>);

impl<'a> Generator<'a> {
    fn new(spec: &'a DatasetSpec) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        rng.set_stream(spec.split as u64);
        Self {
            spec,
            calibration: Calibration::kitti(),
            lidar: Lidar::hdl64e(),
            scene_seed: rng.next_u64(),
            lidar_seed: rng.next_u64(),
            camera_seed: rng.next_u64(),
        }
    }

    fn manifest(&self) -> Manifest {
        let intrinsics = self.calibration.intrinsics;
        Manifest {
            version: VERSION,
            seed: self.spec.seed,
            split: self.spec.split,
            frames: self.spec.frames,
            start: self.spec.start,
            lidar: [self.lidar.elevations_rad.len() as u32, self.lidar.columns],
            image_px: [intrinsics.width_px, intrinsics.height_px],
        }
    }

    /// Makes the folders, or makes sure that they hold frames of this data set.
    fn claim_folder(&self) -> Result<(), DatasetError> {
        for folder in ["velodyne", "image_2", "calib", "label_2", LANES_FOLDER] {
            let folder = self.spec.out.join(folder);
            std::fs::create_dir_all(&folder).map_err(io_error(&folder))?;
        }
        let path = self.spec.out.join(MANIFEST_FILE);
        let own = self.manifest();
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                let same = serde_json::from_str(&text).is_ok_and(|found: Manifest| {
                    let frames = own.frames;
                    Manifest { frames, ..found } == own
                });
                if same {
                    return Ok(());
                }
                Err(DatasetError::Foreign {
                    path: self.spec.out.display().to_string(),
                })
            }
            Err(_) => self.write_manifest(&Manifest { frames: 0, ..own }),
        }
    }

    fn write_manifest(&self, manifest: &Manifest) -> Result<(), DatasetError> {
        let text = serde_json::to_string_pretty(manifest).map_err(encoding(self.spec.start))?;
        write_whole(&self.spec.out.join(MANIFEST_FILE), (text + "\n").as_bytes())
    }

    fn path(&self, folder: &str, frame: u64, extension: &str) -> PathBuf {
        self.spec
            .out
            .join(folder)
            .join(format!("{frame:06}.{extension}"))
    }

    /// Writes a frame unless it is there. Its lanes are written last: where they are, all is.
    fn write_frame(&self, frame: u64) -> Result<(), DatasetError> {
        if self.path(LANES_FOLDER, frame, "json").exists() {
            return Ok(());
        }
        for (folder, extension, content) in self.measure(frame)? {
            write_whole(&self.path(folder, frame, extension), &content)?;
        }
        Ok(())
    }

    fn measure(&self, frame: u64) -> Result<[FrameFile; 5], DatasetError> {
        let SampledScene { scene, ego, .. } = sample_scene(self.scene_seed, frame);
        let rays = RayScene::new(&scene);
        let view = Viewpoint::new(&scene, &rays, ego, &self.calibration)
            .ok_or("the scene lacks its own vehicle")
            .map_err(encoding(frame))?;
        let cloud = self.lidar.sweep(&view, self.lidar_seed ^ frame);
        let seed = self.camera_seed ^ frame;
        let settings = CameraSettings::draw(&mut ChaCha8Rng::seed_from_u64(seed));
        let image = take_picture(&view, &settings, seed);
        let labels: String = truth_boxes(&view, &cloud)
            .iter()
            .filter(|truth| truth.lidar_points > 0)
            .filter(|truth| truth.center_m.xy().norm() <= LABEL_RANGE_M)
            .map(|truth| format!("{}\n", KittiLabel::new(truth, &self.calibration)))
            .collect();
        let lanes = tusimple_line(
            &format!("image_2/{frame:06}.png"),
            &true_marks(&view).pixels,
        )
        .map_err(encoding(frame))?;
        Ok([
            ("velodyne", "bin", cloud_bytes(&cloud)),
            ("image_2", "png", png(&image).map_err(encoding(frame))?),
            (
                "calib",
                "txt",
                calibration_text(&self.calibration).into_bytes(),
            ),
            ("label_2", "txt", labels.into_bytes()),
            (LANES_FOLDER, "json", (lanes + "\n").into_bytes()),
        ])
    }

    fn join_lanes(&self, frames: std::ops::Range<u64>) -> Result<(), DatasetError> {
        let lines = frames.map(|frame| {
            let path = self.path(LANES_FOLDER, frame, "json");
            std::fs::read_to_string(&path).map_err(io_error(&path))
        });
        let lines = lines.collect::<Result<String, _>>()?;
        write_whole(&self.spec.out.join(LANES_FILE), lines.as_bytes())
    }
}

fn io_error(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
    let path = path.display().to_string();
    move |source| DatasetError::Io {
        path: path.clone(),
        source,
    }
}

fn encoding<E: std::fmt::Display>(frame: u64) -> impl Fn(E) -> DatasetError {
    move |error| DatasetError::Encoding {
        frame,
        what: error.to_string(),
    }
}

/// Writes a file so that it is either whole or not there.
fn write_whole(path: &Path, content: &[u8]) -> Result<(), DatasetError> {
    let part = path.with_extension("part");
    std::fs::write(&part, content).map_err(io_error(&part))?;
    std::fs::rename(&part, path).map_err(io_error(path))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(out: &Path, split: Split) -> DatasetSpec {
        DatasetSpec {
            out: out.to_owned(),
            frames: 2,
            start: 0,
            seed: 5,
            split,
        }
    }

    /// Names and contents of all files, by name.
    fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
        let mut files = Vec::new();
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                files.extend(contents(&path));
            } else {
                let content = std::fs::read(&path).expect("a file");
                files.push((path, content));
            }
        }
        files.sort();
        files
    }

    #[test]
    fn a_data_set_is_the_same_with_any_number_of_threads_and_after_an_interruption() {
        let root = tempfile::tempdir().expect("a folder");
        let write = |name: &str, threads: usize| {
            let out = root.path().join(name);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let spec = spec(&out, Split::Train);
            pool.expect("a pool")
                .install(|| write_dataset(&spec, |_, _| ()))
                .expect("a data set");
            let files = contents(&out).into_iter();
            files
                .map(|(path, content)| {
                    (path.strip_prefix(&out).expect("inside").to_owned(), content)
                })
                .collect::<Vec<_>>()
        };
        let one = write("one", 1);
        assert_eq!(one.len(), 5 * 2 + 2);
        assert_eq!(one, write("three", 3));

        let lanes = root.path().join("one/lanes/000001.json");
        std::fs::remove_file(lanes).expect("removed");
        std::fs::write(root.path().join("one/velodyne/000001.bin"), b"torn").expect("written");
        assert_eq!(one, write("one", 2));
    }

    #[test]
    fn splits_share_nothing_and_a_foreign_folder_is_left_alone() {
        let root = tempfile::tempdir().expect("a folder");
        let train = spec(root.path(), Split::Train);
        let val = spec(root.path(), Split::Val);
        let scene = |spec| sample_scene(Generator::new(spec).scene_seed, 0).scene;
        assert_ne!(format!("{:?}", scene(&train)), format!("{:?}", scene(&val)));
        Generator::new(&train)
            .claim_folder()
            .expect("an empty folder");
        let message = write_dataset(&val, |_, _| ())
            .expect_err("refused")
            .to_string();
        assert!(message.contains("choose another folder"), "{message}");
        assert!(Generator::new(&train).claim_folder().is_ok());
    }
}
