use std::path::{Path, PathBuf};

use covista_perception::{
    PerceiveError, Perceiver,
    metrics::{TrueBox, average_precision, lane_accuracy},
};
use covista_sensors::kitti::{KittiError, KittiLabel, read_calibration, read_cloud};
use covista_world::{
    Calibration, CameraImage, Detection3d, MARK_COUNT, ObjectClass, PointCloud, ROW_ANCHORS,
    SensorFrame, wrap_angle,
};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// The detector's range in the LIDAR frame: |x| and |y| in metres.
const RANGE_M: [f64; 2] = [69.12, 12.8];
/// A true box with fewer returns neither counts nor makes a detection of it wrong.
const LEAST_POINTS: usize = 5;
/// The most hidden vehicles that count: KITTI's "partly occluded".
const MOST_OCCLUDED: u8 = 1;

/// The networks on one dataset.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Frames evaluated.
    pub frames: usize,
    /// The lane network.
    pub lanes: LaneEvaluation,
    /// The detector, by class.
    pub detector: Vec<DetectorEvaluation>,
}

/// The lane network's figures, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LaneEvaluation {
    /// TuSimple's accuracy, mean over frames.
    pub accuracy_tusimple: f64,
    /// UFLD's variant of it.
    pub accuracy_ufld: f64,
}

/// The detector's figures for one class, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DetectorEvaluation {
    /// The class.
    pub class: ObjectClass,
    /// True boxes that count: in range, at least five returns, at most partly occluded.
    pub boxes: usize,
    /// Average precision (40 recalls) at a bird's-eye IoU of 0.5.
    pub ap_bev_50_r40: Option<f64>,
    /// Average precision (40 recalls) at a bird's-eye IoU of 0.7.
    pub ap_bev_70_r40: Option<f64>,
}

/// Why a dataset can't be evaluated.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// There is no frame.
    #[error("{0} holds no frame; write some with `covista dataset --out {0} --frames 100`")]
    NoFrames(String),
    /// A file can't be read.
    #[error("{path}: {reason}")]
    File {
        /// The file.
        path: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A point cloud or calibration is unusable.
    #[error(transparent)]
    Kitti(#[from] KittiError),
    /// A frame is refused or a network fails.
    #[error(transparent)]
    Perception(#[from] PerceiveError),
}

/// Runs both networks on the dataset in `folder`, in the layout of `covista dataset`.
///
/// # Errors
/// When a file is missing or unusable or a network fails.
pub fn evaluate(
    folder: &Path,
    perceiver: &mut Perceiver,
    progress: &dyn Fn(usize, usize),
) -> Result<Evaluation, EvaluateError> {
    let names = frame_names(folder)?;
    let mut lane_sums = [0.0; 2];
    let mut lane_frames = 0_usize;
    let mut boxes: Vec<(Vec<Detection3d>, Vec<TrueBox>)> = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let frame = LabelledFrame::read(folder, name)?;
        let found = perceiver.perceive(&frame.measured, &frame.calibration)?;
        if let Some(accuracy) = lane_accuracy(&found.marks.pixels, &frame.marks) {
            lane_sums[0] += accuracy.tusimple;
            lane_sums[1] += accuracy.ufld;
            lane_frames += 1;
        }
        let lidar_from_vehicle = frame.calibration.vehicle_from_lidar.inverse();
        let in_lidar = found.percepts.iter().map(|percept| Detection3d {
            center_m: (lidar_from_vehicle * Point3::from(percept.detection.center_m)).coords,
            ..percept.detection
        });
        boxes.push((in_lidar.collect(), frame.boxes));
        progress(index + 1, names.len());
    }
    let percent = |sum: f64| 100.0 * sum / lane_frames.max(1) as f64;
    Ok(Evaluation {
        frames: names.len(),
        lanes: LaneEvaluation {
            accuracy_tusimple: percent(lane_sums[0]),
            accuracy_ufld: percent(lane_sums[1]),
        },
        detector: [ObjectClass::Car, ObjectClass::Truck]
            .map(|class| detector_row(&boxes, class))
            .to_vec(),
    })
}

fn detector_row(
    frames: &[(Vec<Detection3d>, Vec<TrueBox>)],
    class: ObjectClass,
) -> DetectorEvaluation {
    let of_class: Vec<(Vec<Detection3d>, Vec<TrueBox>)> = frames
        .iter()
        .map(|(found, truth)| {
            let found = found.iter().filter(|found| found.class == class).copied();
            let truth = truth.iter().map(|truth| TrueBox {
                ignored: truth.ignored || truth.footprint.class != class,
                ..*truth
            });
            (found.collect(), truth.collect())
        })
        .collect();
    let ap = |iou| average_precision(&of_class, iou).map(|ap| 100.0 * ap);
    DetectorEvaluation {
        class,
        boxes: of_class
            .iter()
            .flat_map(|(_, truth)| truth)
            .filter(|truth| !truth.ignored)
            .count(),
        ap_bev_50_r40: ap(0.5),
        ap_bev_70_r40: ap(0.7),
    }
}

fn frame_names(folder: &Path) -> Result<Vec<String>, EvaluateError> {
    let list = folder.join("lanes");
    let none = || EvaluateError::NoFrames(folder.display().to_string());
    let mut names: Vec<String> = std::fs::read_dir(list)
        .map_err(|_| none())?
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            let is_frame = path
                .extension()
                .is_some_and(|extension| extension == "json");
            is_frame.then(|| path.file_stem()?.to_str().map(str::to_owned))?
        })
        .collect();
    names.sort();
    if names.is_empty() {
        return Err(none());
    }
    Ok(names)
}

struct LabelledFrame {
    measured: SensorFrame,
    calibration: Calibration,
    marks: [[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT],
    boxes: Vec<TrueBox>,
}

impl LabelledFrame {
    fn read(folder: &Path, name: &str) -> Result<Self, EvaluateError> {
        let file =
            |sub: &str, extension: &str| folder.join(sub).join(format!("{name}.{extension}"));
        let calibration = read_calibration(&file("calib", "txt"))?;
        let points = read_cloud(&file("velodyne", "bin"))?;
        let labels = file("label_2", "txt");
        let boxes = read_text(&labels)?
            .lines()
            .map(|line| {
                line.parse::<KittiLabel>()
                    .map(|label| true_box(&label, &calibration, &points))
                    .map_err(|reason| file_error(&labels, reason))
            })
            .collect::<Result<_, _>>()?;
        Ok(Self {
            measured: SensorFrame {
                time_s: 0.0,
                image: read_image(&file("image_2", "png"))?,
                points,
            },
            marks: read_marks(&file("lanes", "json"))?,
            calibration,
            boxes,
        })
    }
}

fn file_error(path: &Path, reason: impl ToString) -> EvaluateError {
    EvaluateError::File {
        path: path.display().to_string(),
        reason: reason.to_string(),
    }
}

fn read_text(path: &PathBuf) -> Result<String, EvaluateError> {
    std::fs::read_to_string(path).map_err(|error| file_error(path, error))
}

fn read_image(path: &Path) -> Result<CameraImage, EvaluateError> {
    let image = image::open(path)
        .map_err(|error| file_error(path, error))?
        .into_rgb8();
    Ok(CameraImage {
        width_px: image.width(),
        height_px: image.height(),
        rgb: image.into_raw(),
    })
}

/// The part of a TuSimple line that is read.
#[derive(Deserialize)]
struct TuSimpleLine {
    lanes: Vec<Vec<f32>>,
}

fn read_marks(
    path: &PathBuf,
) -> Result<[[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT], EvaluateError> {
    let line: TuSimpleLine =
        serde_json::from_str(&read_text(path)?).map_err(|error| file_error(path, error))?;
    let mut marks = [[None; ROW_ANCHORS.len()]; MARK_COUNT];
    for (mark, lane) in marks.iter_mut().zip(&line.lanes) {
        for (u, value) in mark.iter_mut().zip(lane) {
            *u = (*value >= 0.0).then_some(*value);
        }
    }
    Ok(marks)
}

fn true_box(label: &KittiLabel, calibration: &Calibration, points: &PointCloud) -> TrueBox {
    let [height, width, length] = label.size_hwl_m;
    let bottom = calibration.camera_from_lidar().inverse() * Point3::from(label.location_m);
    let center_m = bottom.coords + Vector3::z() * (height / 2.0);
    let footprint = Detection3d {
        center_m,
        size_m: Vector3::new(length, width, height),
        yaw_rad: wrap_angle(-label.rotation_y_rad - std::f64::consts::FRAC_PI_2),
        class: if label.kind == "Car" {
            ObjectClass::Car
        } else {
            ObjectClass::Truck
        },
        score: 1.0,
    };
    let in_range = center_m.x.abs() <= RANGE_M[0] && center_m.y.abs() <= RANGE_M[1];
    TrueBox {
        footprint,
        ignored: !in_range
            || label.occluded > MOST_OCCLUDED
            || returns_on(&footprint, points) < LEAST_POINTS,
    }
}

fn returns_on(footprint: &Detection3d, points: &PointCloud) -> usize {
    let (sin, cos) = footprint.yaw_rad.sin_cos();
    let half = footprint.size_m / 2.0;
    points
        .points
        .iter()
        .filter(|[x, y, z, _]| {
            let offset =
                Vector3::new(f64::from(*x), f64::from(*y), f64::from(*z)) - footprint.center_m;
            let along = cos * offset.x + sin * offset.y;
            let across = -sin * offset.x + cos * offset.y;
            along.abs() <= half.x && across.abs() <= half.y && offset.z.abs() <= half.z
        })
        .count()
}
