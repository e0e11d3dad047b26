//! The detector's figures: KITTI's in the picture, average precision all around, and what it does
//! at its score threshold.

mod benchmark;
mod frame;
mod hardness;
mod operating_point;

use std::collections::BTreeMap;

use covista_perception::{
    Detector,
    metrics::{TrueBox, average_precision},
};
use covista_sensors::kitti::KittiFrame;
use covista_world::{Detection3d, ObjectClass};
use serde::Serialize;

pub use hardness::{Bar, Hardness};
pub use operating_point::{OperatingPoint, RecallBar};

use super::{EvaluateError, Evaluated, Progress};
use crate::recorded::with_files;
use frame::MeasuredFrame;
pub(crate) use frame::in_picture;

/// All around, the most hidden vehicles that count: KITTI's "partly occluded".
const MOST_OCCLUDED: u8 = 1;

/// The detector's figures.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorEvaluation {
    /// Whether the labels cover the picture only, as KITTI's: then so do all figures.
    pub picture_only: bool,
    /// By class.
    pub classes: Vec<ClassEvaluation>,
}

/// The detector's figures for one class, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassEvaluation {
    /// The class.
    pub class: ObjectClass,
    /// True boxes that count all around: in range, at least five returns, at most partly occluded.
    pub boxes: usize,
    /// Average precision (40 recalls) all around at a bird's-eye IoU of 0.5.
    pub ap_bev_50_r40: Option<f64>,
    /// Average precision (40 recalls) all around at a bird's-eye IoU of 0.7.
    pub ap_bev_70_r40: Option<f64>,
    /// Labels that count for KITTI, by difficulty: `boxes_easy`, `boxes_moderate`, `boxes_hard`.
    #[serde(flatten)]
    pub kitti_boxes: BTreeMap<String, usize>,
    /// KITTI's figures in the picture: `ap_3d_car_moderate_r40` and so on, at IoU 0.7; those that
    /// end in `_iou50` at 0.5.
    #[serde(flatten)]
    pub kitti: BTreeMap<String, Option<f64>>,
    /// What is found at the score threshold of the detector's card.
    #[serde(flatten)]
    pub operating_point: OperatingPoint,
    /// How hard the labels in the picture are.
    #[serde(flatten)]
    pub hardness: Hardness,
}

/// Runs the detector on the frames that have a point cloud and labels.
///
/// As KITTI's labels end at the picture, so do all figures where all labels of the data lie before
/// the camera: boxes found outside of the picture are left out. All around, a box found in a
/// `DontCare` region neither counts nor is wrong.
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
        measured.push(MeasuredFrame::read(frame, detector)?);
        progress(index + 1, usable.len());
    }
    let picture_only = measured
        .iter()
        .all(MeasuredFrame::is_labelled_before_the_camera);
    let classes = [ObjectClass::Car, ObjectClass::Truck]
        .map(|class| of_class(&measured, class, picture_only, detector.score_threshold()));
    Evaluated::new(
        usable.len(),
        lacking,
        DetectorEvaluation {
            picture_only,
            classes: classes.to_vec(),
        },
    )
}

fn of_class(
    frames: &[MeasuredFrame],
    class: ObjectClass,
    picture_only: bool,
    score_threshold: f64,
) -> ClassEvaluation {
    let all_around: Vec<(Vec<Detection3d>, Vec<TrueBox>)> = frames
        .iter()
        .map(|frame| {
            let found = frame.found_all_around(class, picture_only);
            (found, frame.true_boxes(class, MOST_OCCLUDED))
        })
        .collect();
    let ap = |iou| average_precision(&all_around, iou).map(|ap| 100.0 * ap);
    let (kitti_boxes, kitti) = benchmark::figures(frames, class);
    ClassEvaluation {
        class,
        boxes: all_around
            .iter()
            .flat_map(|(_, truth)| truth)
            .filter(|truth| !truth.ignored)
            .count(),
        ap_bev_50_r40: ap(0.5),
        ap_bev_70_r40: ap(0.7),
        kitti_boxes,
        kitti,
        operating_point: OperatingPoint::of(frames, class, picture_only, score_threshold),
        hardness: Hardness::of(frames, class),
    }
}
