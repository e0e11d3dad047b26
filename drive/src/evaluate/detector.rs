use covista_perception::{
    Detector,
    metrics::{TrueBox, average_precision},
};
use covista_sensors::kitti::{KittiFrame, KittiLabel, read_cloud, read_image, read_labels};
use covista_world::{Calibration, CameraIntrinsics, Detection3d, ObjectClass, PointCloud};
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use super::{EvaluateError, Evaluated, Progress, file_of};
use crate::recorded::{calibration_of, with_files};

/// A true box with fewer returns neither counts nor makes a detection of it wrong.
const LEAST_POINTS: usize = 5;
/// The most hidden vehicles that count: KITTI's "partly occluded".
const MOST_OCCLUDED: u8 = 1;

/// The detector's figures, in percent.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorEvaluation {
    /// Whether the labels cover the picture only, as KITTI's: then so do the figures.
    pub picture_only: bool,
    /// By class.
    pub classes: Vec<ClassEvaluation>,
}

/// The detector's figures for one class, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassEvaluation {
    /// The class.
    pub class: ObjectClass,
    /// True boxes that count: in range, at least five returns, at most partly occluded.
    pub boxes: usize,
    /// Average precision (40 recalls) at a bird's-eye IoU of 0.5.
    pub ap_bev_50_r40: Option<f64>,
    /// Average precision (40 recalls) at a bird's-eye IoU of 0.7.
    pub ap_bev_70_r40: Option<f64>,
}

/// One frame's boxes and labels, in the LIDAR frame.
struct Frame {
    calibration: Calibration,
    labels: Vec<KittiLabel>,
    found: Vec<Detection3d>,
    truth: Vec<TrueBox>,
}

/// Runs the detector on the frames that have a point cloud and labels.
///
/// As with KITTI's own measure, a box found in a `DontCare` region neither counts nor is wrong,
/// and where all labels of the data lie before the camera, boxes outside the picture are left out.
///
/// # Errors
/// When there is none, a file is unusable or the network fails.
pub fn evaluate_detector(
    frames: &[KittiFrame],
    detector: &mut Detector,
    progress: Progress<'_>,
) -> Result<Evaluated<DetectorEvaluation>, EvaluateError> {
    let (usable, lacking) = with_files(
        frames,
        &[
            ("velodyne", |frame| &frame.cloud),
            ("label_2", |frame| &frame.labels),
            ("calib", |frame| &frame.calibration),
        ],
    );
    let mut measured = Vec::new();
    for (index, frame) in usable.iter().enumerate() {
        measured.push(Frame::measure(frame, detector)?);
        progress(index + 1, usable.len());
    }
    let picture_only = measured.iter().all(Frame::is_labelled_before_the_camera);
    let boxes: Vec<_> = measured
        .into_iter()
        .map(|frame| frame.counted(picture_only))
        .collect();
    let classes = [ObjectClass::Car, ObjectClass::Truck].map(|class| of_class(&boxes, class));
    Evaluated::new(
        usable.len(),
        lacking,
        DetectorEvaluation {
            picture_only,
            classes: classes.to_vec(),
        },
    )
}

fn of_class(frames: &[(Vec<Detection3d>, Vec<TrueBox>)], class: ObjectClass) -> ClassEvaluation {
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
    ClassEvaluation {
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

impl Frame {
    fn measure(frame: &KittiFrame, detector: &mut Detector) -> Result<Self, EvaluateError> {
        let mut calibration = calibration_of(frame)?;
        if let Some(path) = &frame.image {
            let image = read_image(path)?;
            calibration.intrinsics.width_px = image.width_px;
            calibration.intrinsics.height_px = image.height_px;
        }
        let points = read_cloud(file_of(&frame.cloud)?)?;
        let labels = read_labels(file_of(&frame.labels)?)?;
        let range_m = detector.range_m().map(f64::from);
        let truth = labels
            .iter()
            .filter_map(|label| true_box(label, &calibration, &points, &range_m));
        Ok(Self {
            truth: truth.collect(),
            found: detector.detect(&points)?,
            calibration,
            labels,
        })
    }

    fn is_labelled_before_the_camera(&self) -> bool {
        let objects = self.labels.iter().filter(|label| label.kind != DONT_CARE);
        objects
            .map(|label| label.location_m[2])
            .all(|z_m| z_m > 0.0)
    }

    /// The boxes found and true that the measure is taken on.
    fn counted(self, picture_only: bool) -> (Vec<Detection3d>, Vec<TrueBox>) {
        let camera = &self.calibration.intrinsics;
        let camera_from_lidar = self.calibration.camera_from_lidar();
        let dont_care = |[u, v]: [f64; 2]| {
            self.labels
                .iter()
                .filter(|label| label.kind == DONT_CARE)
                .any(|region| {
                    let [left, top, right, bottom] = region.bbox_px;
                    (left..=right).contains(&u) && (top..=bottom).contains(&v)
                })
        };
        let counts = |found: &Detection3d| {
            let pixel = camera.project(&(camera_from_lidar * Point3::from(found.center_m)));
            match pixel {
                Some(pixel) if is_inside(camera, pixel) => !dont_care(pixel),
                _ => !picture_only,
            }
        };
        let found = self.found.iter().copied().filter(counts).collect();
        (found, self.truth)
    }
}

const DONT_CARE: &str = "DontCare";

fn is_inside(camera: &CameraIntrinsics, [u, v]: [f64; 2]) -> bool {
    (0.0..f64::from(camera.width_px)).contains(&u)
        && (0.0..f64::from(camera.height_px)).contains(&v)
}

/// The box of a label; `None` for what the detector must not report: people and cyclists. Boxes
/// of kinds that it does not know (`Tram`, `Misc`) are ignored.
fn true_box(
    label: &KittiLabel,
    calibration: &Calibration,
    points: &PointCloud,
    range_m: &[f64; 6],
) -> Option<TrueBox> {
    let (class, is_known) = match label.kind.as_str() {
        "Car" => (ObjectClass::Car, true),
        "Van" | "Truck" => (ObjectClass::Truck, true),
        "Pedestrian" | "Person_sitting" | "Cyclist" | DONT_CARE => return None,
        _ => (ObjectClass::Truck, false),
    };
    let [height, width, length] = label.size_hwl_m;
    let (center_m, yaw_rad) = label.pose_in_lidar(calibration);
    let footprint = Detection3d {
        center_m,
        size_m: Vector3::new(length, width, height),
        yaw_rad,
        class,
        score: 1.0,
    };
    let in_range = (0..2).all(|axis| (range_m[axis]..=range_m[axis + 3]).contains(&center_m[axis]));
    Some(TrueBox {
        footprint,
        ignored: !is_known
            || !in_range
            || label.occluded > MOST_OCCLUDED
            || returns_on(&footprint, points) < LEAST_POINTS,
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    fn detection(x: f64, y: f64) -> Detection3d {
        Detection3d {
            center_m: Vector3::new(x, y, -0.9),
            size_m: Vector3::new(4.0, 1.8, 1.6),
            yaw_rad: 0.0,
            class: ObjectClass::Car,
            score: 0.9,
        }
    }

    fn label(text: &str) -> KittiLabel {
        text.parse().expect("a label")
    }

    #[test]
    fn boxes_in_dont_care_regions_or_outside_the_picture_are_left_out() {
        let car = "Car 0 0 0 600 150 650 200 1.6 1.8 4.0 0.0 1.65 20.0 -1.57";
        let region = "DontCare -1 -1 -10 500 160 560 220 -1 -1 -1 -1000 -1000 -1000 -10";
        let frame = |labels: &[&str]| Frame {
            calibration: Calibration::kitti(),
            labels: labels.iter().map(|text| label(text)).collect(),
            found: vec![
                detection(20.0, 0.0),
                detection(20.0, 2.5),
                detection(-20.0, 0.0),
            ],
            truth: Vec::new(),
        };
        // 2.5 m to the left at 20 m is at u = 518.
        let kitti = frame(&[car, region]);
        assert!(kitti.is_labelled_before_the_camera());
        let (found, _) = kitti.counted(true);
        assert_eq!(found, [detection(20.0, 0.0)]);

        let behind = car.replace(" 20.0 ", " -20.0 ");
        let all_around = frame(&[car, &behind]);
        assert!(!all_around.is_labelled_before_the_camera());
        assert_eq!(all_around.counted(false).0.len(), 3);
    }

    #[test]
    fn people_are_no_boxes_and_unknown_kinds_are_ignored() {
        let cloud = PointCloud {
            points: vec![[20.27, 0.0, -0.8, 0.3]; 9],
        };
        let range_m = [-69.0, -12.0, -3.0, 69.0, 12.0, 1.0];
        let read = |kind: &str, z: &str| {
            let line = format!("{kind} 0 0 0 600 150 650 200 1.6 1.8 4.0 0.0 1.65 {z} -1.57 0.9");
            true_box(&label(&line), &Calibration::kitti(), &cloud, &range_m)
        };
        let car = read("Car", "20.0").expect("a box");
        assert_eq!(
            (car.footprint.class, car.ignored),
            (ObjectClass::Car, false)
        );
        assert_eq!(
            read("Van", "20.0").expect("a box").footprint.class,
            ObjectClass::Truck
        );
        assert!(read("Tram", "20.0").expect("a box").ignored);
        assert!(read("Car", "30.0").expect("a box without returns").ignored);
        for kind in ["Pedestrian", "Cyclist", "Person_sitting", "DontCare"] {
            assert_eq!(read(kind, "20.0"), None);
        }
    }
}
