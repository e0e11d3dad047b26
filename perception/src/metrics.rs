//! How good the networks are: TuSimple's accuracy for marks, average precision for boxes.

use covista_world::{Detection3d, MARK_COUNT, ROW_ANCHORS};

use crate::lanes::decode::MarkPixels;
use crate::pointpillars::nms::bev_iou;

/// A point is right within this many pixels across its lane.
const WITHIN_PX: f64 = 20.0;
/// TuSimple's stand-in for a point that isn't there.
const ABSENT: f64 = -100.0;
/// UFLD's variant gives nothing for a clip with this many more lanes than there are.
const LANES_TOO_MANY: usize = 2;
/// Recalls at which the precision is sampled, 1/40 to 40/40.
const RECALL_SAMPLES: usize = 40;

/// TuSimple's accuracy of one image, in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneAccuracy {
    /// Mean over the true marks of the part of the row anchors at which the best mark found is
    /// right; a mark that is absent in both counts as right there.
    pub tusimple: f64,
    /// The same, but 0 when more than two marks too many are found.
    pub ufld: f64,
}

/// Compares the marks found in an image with the true ones; `None` when there is no true one.
pub fn lane_accuracy(found: &MarkPixels, truth: &MarkPixels) -> Option<LaneAccuracy> {
    let [found, truth] = [found, truth].map(present);
    if truth.is_empty() {
        return None;
    }
    let of_mark = |true_mark: &MarkRow| {
        let within_px = WITHIN_PX / slope(true_mark).atan().cos();
        let right = |mark: &MarkRow| {
            mark.iter()
                .zip(true_mark)
                .filter(|(u, true_u)| (*u - *true_u).abs() < within_px)
                .count()
        };
        found.iter().map(right).max().unwrap_or(0) as f64 / ROW_ANCHORS.len() as f64
    };
    let tusimple = truth.iter().map(of_mark).sum::<f64>() / truth.len() as f64;
    let too_many = found.len() > truth.len() + LANES_TOO_MANY;
    Some(LaneAccuracy {
        tusimple,
        ufld: if too_many { 0.0 } else { tusimple },
    })
}

/// u at each row anchor, or [`ABSENT`].
type MarkRow = [f64; ROW_ANCHORS.len()];

/// The marks that are seen at two row anchors or more.
fn present(marks: &MarkPixels) -> Vec<MarkRow> {
    (0..MARK_COUNT)
        .filter(|&mark| marks[mark].iter().flatten().count() >= 2)
        .map(|mark| marks[mark].map(|u| u.map_or(ABSENT, f64::from)))
        .collect()
}

/// Slope du/dv of the least-squares line through a mark.
fn slope(mark: &MarkRow) -> f64 {
    let seen = || {
        mark.iter()
            .zip(&ROW_ANCHORS)
            .filter(|(u, _)| **u >= 0.0)
            .map(|(u, row)| (*u, f64::from(row.0)))
    };
    let count = seen().count() as f64;
    let mean_u = seen().map(|(u, _)| u).sum::<f64>() / count;
    let mean_v = seen().map(|(_, v)| v).sum::<f64>() / count;
    let covariance: f64 = seen().map(|(u, v)| (u - mean_u) * (v - mean_v)).sum();
    let variance: f64 = seen().map(|(_, v)| (v - mean_v).powi(2)).sum();
    if variance > 0.0 {
        covariance / variance
    } else {
        0.0
    }
}

/// A true box; one that is ignored neither counts nor makes a detection of it wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueBox {
    /// Where it is; its score has no meaning.
    pub footprint: Detection3d,
    /// Too far, too hidden or of another class.
    pub ignored: bool,
}

/// Average precision in [0, 1] over frames of (found, true) boxes of one class: BEV IoU of at
/// least `min_iou`, precision made monotone and sampled at 40 recalls (KITTI's R40). `None` when
/// no true box counts.
pub fn average_precision(frames: &[(Vec<Detection3d>, Vec<TrueBox>)], min_iou: f64) -> Option<f64> {
    let count = frames
        .iter()
        .flat_map(|(_, truth)| truth)
        .filter(|truth| !truth.ignored)
        .count();
    if count == 0 {
        return None;
    }
    let mut outcomes: Vec<(f64, bool)> = frames
        .iter()
        .flat_map(|(found, truth)| match_frame(found, truth, min_iou))
        .collect();
    outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut right = 0;
    let curve: Vec<(f64, f64)> = outcomes
        .iter()
        .enumerate()
        .map(|(i, (_, is_right))| {
            right += usize::from(*is_right);
            (right as f64 / count as f64, right as f64 / (i + 1) as f64)
        })
        .collect();
    let precision_from = |recall: f64| {
        curve
            .iter()
            .filter(|(reached, _)| *reached >= recall - 1e-9)
            .map(|(_, precision)| *precision)
            .fold(0.0, f64::max)
    };
    let sum: f64 = (1..=RECALL_SAMPLES)
        .map(|sample| precision_from(sample as f64 / RECALL_SAMPLES as f64))
        .sum();
    Some(sum / RECALL_SAMPLES as f64)
}

/// Score and rightness of each detection that counts, matched to the true boxes best score first.
fn match_frame(found: &[Detection3d], truth: &[TrueBox], min_iou: f64) -> Vec<(f64, bool)> {
    let mut order: Vec<&Detection3d> = found.iter().collect();
    order.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut taken = vec![false; truth.len()];
    order
        .into_iter()
        .filter_map(|detection| {
            let best = truth
                .iter()
                .enumerate()
                .filter(|(i, _)| !taken[*i])
                .map(|(i, truth)| (i, bev_iou(detection, &truth.footprint)))
                .filter(|(_, iou)| *iou >= min_iou)
                .max_by(|(a, iou_a), (b, iou_b)| {
                    let counts = |i: usize| !truth[i].ignored;
                    counts(*a).cmp(&counts(*b)).then(iou_a.total_cmp(iou_b))
                });
            match best {
                None => Some((detection.score, false)),
                Some((i, _)) => {
                    taken[i] = true;
                    (!truth[i].ignored).then_some((detection.score, true))
                }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::ObjectClass;
    use nalgebra::Vector3;

    /// Marks at u = 100, 400, 700, 1000 px plus `shift` below row anchor 10.
    fn marks(count: usize, shift: f32) -> MarkPixels {
        std::array::from_fn(|mark| {
            std::array::from_fn(|row| {
                (mark < count && row >= 10).then_some(100.0 + 300.0 * mark as f32 + shift)
            })
        })
    }

    #[test]
    fn lane_accuracy_in_closed_form() {
        let accuracy = |found: MarkPixels, truth: MarkPixels| lane_accuracy(&found, &truth);
        let perfect = accuracy(marks(4, 19.0), marks(4, 0.0)).expect("marks");
        assert!((perfect.tusimple - 1.0).abs() < 1e-12);
        // 21 px off: right only where neither sees anything, at 10 of 28 rows.
        let shifted = accuracy(marks(4, 21.0), marks(4, 0.0)).expect("marks");
        assert!((shifted.tusimple - 10.0 / 28.0).abs() < 1e-12);
        // One of two found.
        let half = accuracy(marks(1, 0.0), marks(2, 0.0)).expect("marks");
        assert!((half.tusimple - (1.0 + 10.0 / 28.0) / 2.0).abs() < 1e-12);
        assert_eq!(accuracy(marks(4, 0.0), marks(0, 0.0)), None);
        assert_eq!(
            accuracy(marks(0, 0.0), marks(1, 0.0)).map(|found| found.tusimple),
            Some(0.0)
        );
        // Four found where one is: UFLD's variant gives nothing.
        let many = accuracy(marks(4, 0.0), marks(1, 0.0)).expect("marks");
        assert!((many.tusimple - 1.0).abs() < 1e-12 && many.ufld.abs() < 1e-12);
    }

    #[test]
    fn a_slanted_mark_is_given_more_room() {
        // du/dv = 1: 20 px across the mark are 28.3 px along the row.
        let slanted = |shift: f32| -> MarkPixels {
            std::array::from_fn(|mark| {
                std::array::from_fn(|row| (mark == 0).then_some(200.0 + 10.0 * row as f32 + shift))
            })
        };
        let right =
            |shift| lane_accuracy(&slanted(shift), &slanted(0.0)).map(|found| found.tusimple);
        assert_eq!(right(28.0), Some(1.0));
        assert_eq!(right(29.0), Some(0.0));
    }

    fn at(x: f64, score: f64) -> Detection3d {
        Detection3d {
            center_m: Vector3::new(x, 0.0, 0.0),
            size_m: Vector3::new(4.0, 2.0, 1.5),
            yaw_rad: 0.0,
            class: ObjectClass::Car,
            score,
        }
    }

    fn truth(x: f64, ignored: bool) -> TrueBox {
        TrueBox {
            footprint: at(x, 1.0),
            ignored,
        }
    }

    #[test]
    fn average_precision_in_closed_form() {
        let two = || vec![truth(0.0, false), truth(20.0, false)];
        let ap = |found| average_precision(&[(found, two())], 0.7).expect("true boxes");
        assert!((ap(vec![at(0.1, 0.9), at(20.1, 0.8)]) - 1.0).abs() < 1e-12);
        assert!((ap(vec![at(0.1, 0.9)]) - 0.5).abs() < 1e-12);
        // right, wrong, right: precision 1 up to recall 1/2, then 2/3.
        let mixed = ap(vec![at(0.1, 0.9), at(40.0, 0.85), at(20.1, 0.8)]);
        assert!((mixed - (0.5 + 0.5 * 2.0 / 3.0)).abs() < 1e-12);
        // A second box on the same vehicle is wrong.
        let double = ap(vec![at(0.1, 0.9), at(0.0, 0.85), at(20.1, 0.8)]);
        assert!((double - mixed).abs() < 1e-12);
    }

    #[test]
    fn ignored_boxes_neither_count_nor_hurt() {
        let frames = [(
            vec![at(0.0, 0.9), at(20.0, 0.95)],
            vec![truth(0.0, false), truth(20.0, true)],
        )];
        assert_eq!(average_precision(&frames, 0.7), Some(1.0));
        assert_eq!(
            average_precision(&[(vec![at(0.0, 0.9)], vec![truth(0.0, true)])], 0.7),
            None
        );
    }
}
