use covista_perception::{
    LaneFinder,
    metrics::{LaneAccuracy, lane_accuracy},
};
use covista_sensors::{kitti::KittiFrame, read_tusimple_line};
use serde::Serialize;

use super::{EvaluateError, Evaluated, Progress, file_of};
use crate::recorded::{FittedPicture, with_files};

/// The lane network's figures, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LaneEvaluation {
    /// TuSimple's accuracy, mean over frames.
    pub accuracy_tusimple: f64,
    /// The same, 0 for frames with more than two marks too many, as in UFLD's code.
    pub accuracy_ufld: f64,
    /// The paper's (Section V-B): right points over true points, each summed over all frames.
    pub accuracy_paper: f64,
    /// Marks found that are none, mean over frames of their part.
    pub false_positive: f64,
    /// True marks that are not found, mean over frames of their part.
    pub false_negative: f64,
}

impl LaneEvaluation {
    fn of(frames: &[LaneAccuracy]) -> Self {
        let mean = |value: fn(&LaneAccuracy) -> f64| {
            100.0 * frames.iter().map(value).sum::<f64>() / frames.len().max(1) as f64
        };
        let points = |value: fn(&LaneAccuracy) -> usize| frames.iter().map(value).sum::<usize>();
        let right = points(|frame| frame.right_points) as f64;
        Self {
            accuracy_tusimple: mean(|frame| frame.tusimple),
            accuracy_ufld: mean(|frame| frame.ufld),
            accuracy_paper: 100.0 * right / points(|frame| frame.true_points).max(1) as f64,
            false_positive: mean(|frame| frame.false_positive),
            false_negative: mean(|frame| frame.false_negative),
        }
    }
}

/// Runs the lane network on the frames that have a picture and lane labels.
///
/// # Errors
/// When there is none or none with a mark, a file is unusable or the network fails.
pub fn evaluate_lanes(
    frames: &[KittiFrame],
    finder: &mut LaneFinder,
    progress: Progress<'_>,
) -> Result<Evaluated<LaneEvaluation>, EvaluateError> {
    let (usable, lacking) = with_files(
        frames,
        &[
            ("image_2", |frame| &frame.image),
            ("lanes", |frame| &frame.lanes),
        ],
    );
    let mut counted = Vec::new();
    for (index, frame) in usable.iter().enumerate() {
        let Some(picture) = FittedPicture::read(frame, finder.image_size_px())? else {
            continue;
        };
        let labels = file_of(&frame.lanes)?;
        let text =
            std::fs::read_to_string(labels).map_err(|error| EvaluateError::file(labels, error))?;
        let truth = read_tusimple_line(&text, |pixel| picture.in_network(pixel))
            .map_err(|reason| EvaluateError::file(labels, reason))?;
        let found = finder.find_marks(&picture.image)?.pixels;
        counted.extend(lane_accuracy(&found, &truth));
        progress(index + 1, usable.len());
    }
    if counted.is_empty() && !usable.is_empty() {
        return Err(EvaluateError::NothingToScore(usable.len()));
    }
    Evaluated::new(usable.len(), lacking, LaneEvaluation::of(&counted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_accuracy_weighs_points_and_tusimples_frames() {
        let frame = |right_points, true_points| LaneAccuracy {
            tusimple: right_points as f64 / true_points as f64,
            ufld: 0.0,
            false_positive: 0.5,
            false_negative: 0.25,
            right_points,
            true_points,
        };
        let of = LaneEvaluation::of(&[frame(90, 100), frame(5, 10)]);
        assert!((of.accuracy_tusimple - 70.0).abs() < 1e-12);
        assert!((of.accuracy_paper - 9500.0 / 110.0).abs() < 1e-12);
        assert_eq!((of.false_positive, of.false_negative), (50.0, 25.0));
    }
}
