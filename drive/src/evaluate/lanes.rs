use covista_perception::{LaneFinder, metrics::lane_accuracy};
use covista_sensors::{kitti::KittiFrame, read_tusimple_line};
use serde::Serialize;

use super::{EvaluateError, Evaluated, Progress, file_of};
use crate::recorded::{FittedPicture, with_files};

/// The lane network's figures, in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LaneEvaluation {
    /// TuSimple's accuracy, mean over frames.
    pub accuracy_tusimple: f64,
    /// UFLD's variant of it.
    pub accuracy_ufld: f64,
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
    let (mut sums, mut counted) = ([0.0; 2], 0_usize);
    for (index, frame) in usable.iter().enumerate() {
        let Some(picture) = FittedPicture::read(frame, finder.image_size_px())? else {
            continue;
        };
        let labels = file_of(&frame.lanes)?;
        let text =
            std::fs::read_to_string(labels).map_err(|error| EvaluateError::file(labels, error))?;
        let truth = read_tusimple_line(&text, |pixel| picture.in_network(pixel))
            .map_err(|reason| EvaluateError::file(labels, reason))?;
        let found = finder.find_marks(&picture.image)?;
        if let Some(accuracy) = lane_accuracy(&found, &truth) {
            sums[0] += accuracy.tusimple;
            sums[1] += accuracy.ufld;
            counted += 1;
        }
        progress(index + 1, usable.len());
    }
    if counted == 0 && !usable.is_empty() {
        return Err(EvaluateError::NothingToScore(usable.len()));
    }
    let [accuracy_tusimple, accuracy_ufld] = sums.map(|sum| 100.0 * sum / counted.max(1) as f64);
    Evaluated::new(
        usable.len(),
        lacking,
        LaneEvaluation {
            accuracy_tusimple,
            accuracy_ufld,
        },
    )
}
