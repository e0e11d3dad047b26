//! TuSimple's lane benchmark: accuracy, false positives and false negatives of one image.

use covista_world::{MARK_COUNT, ROW_ANCHORS};

use crate::lanes::decode::MarkPixels;

/// A point is right within this many pixels across its mark.
const WITHIN_PX: f64 = 20.0;
/// TuSimple's stand-in for a point that isn't there.
const ABSENT: f64 = -100.0;
/// TuSimple's and UFLD's code give nothing for an image with this many more marks than there are.
const MARKS_TOO_MANY: usize = 2;
/// A true mark is found when one that is found is right at this part of the row anchors.
const FOUND_FROM: f64 = 0.85;

/// TuSimple's figures of one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaneAccuracy {
    /// Mean over the true marks of the part of the row anchors at which the best mark found is
    /// right, in [0, 1]; a mark that is absent in both counts as right there.
    pub tusimple: f64,
    /// The same, but 0 when more than two marks too many are found, as in TuSimple's published
    /// code and in UFLD's copy of it.
    pub ufld: f64,
    /// Part of the marks found that are none, in [0, 1]: those beyond the true marks found; 0 when
    /// more than two too many are found, as in that code.
    pub false_positive: f64,
    /// Part of the true marks that are not found, right at less than 85 % of the row anchors, in
    /// [0, 1]; 1 when more than two marks too many are found.
    pub false_negative: f64,
    /// Row anchors of true marks that are seen, and where the best mark found is right: C_clip of
    /// the paper's Section V-B.
    pub right_points: usize,
    /// Row anchors at which a true mark is seen: S_clip of the paper's Section V-B.
    pub true_points: usize,
}

/// Compares the marks found in an image with the true ones; `None` when there is no true one.
pub fn lane_accuracy(found: &MarkPixels, truth: &MarkPixels) -> Option<LaneAccuracy> {
    let [found, truth] = [found, truth].map(present);
    if truth.is_empty() {
        return None;
    }
    let marks = truth.len() as f64;
    let parts: Vec<f64> = truth
        .iter()
        .map(|mark| best_of(&found, mark, |_| true) as f64 / ROW_ANCHORS.len() as f64)
        .collect();
    let hits = parts.iter().filter(|part| **part >= FOUND_FROM).count();
    let tusimple = parts.iter().sum::<f64>() / marks;
    let too_many = found.len() > truth.len() + MARKS_TOO_MANY;
    let right = truth.iter().map(|mark| best_of(&found, mark, is_seen));
    let seen = truth.iter().flatten().filter(|u| is_seen(**u));
    Some(LaneAccuracy {
        tusimple,
        ufld: if too_many { 0.0 } else { tusimple },
        false_positive: match found.len() {
            0 => 0.0,
            _ if too_many => 0.0,
            count => (count as f64 - hits as f64) / count as f64,
        },
        false_negative: if too_many {
            1.0
        } else {
            1.0 - hits as f64 / marks
        },
        right_points: right.sum(),
        true_points: seen.count(),
    })
}

/// Row anchors, of those where the true mark is as `counts` says, at which the best of the marks
/// found is right.
fn best_of(found: &[MarkRow], true_mark: &MarkRow, counts: impl Fn(f64) -> bool) -> usize {
    let within_px = WITHIN_PX / slope(true_mark).atan().cos();
    let right = |mark: &MarkRow| {
        mark.iter()
            .zip(true_mark)
            .filter(|(u, true_u)| counts(**true_u) && (*u - *true_u).abs() < within_px)
            .count()
    };
    found.iter().map(right).max().unwrap_or(0)
}

fn is_seen(u: f64) -> bool {
    u >= 0.0
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
            .filter(|(u, _)| is_seen(**u))
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

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn false_positives_and_negatives_in_closed_form() {
        let figures =
            |found: MarkPixels, truth: MarkPixels| lane_accuracy(&found, &truth).expect("marks");
        let wrong = |of: LaneAccuracy| (of.false_positive, of.false_negative);
        assert_eq!(wrong(figures(marks(4, 0.0), marks(4, 0.0))), (0.0, 0.0));
        // Two of three are there, and one of the two true ones is found besides.
        assert_eq!(
            wrong(figures(marks(3, 0.0), marks(2, 0.0))),
            (1.0 / 3.0, 0.0)
        );
        assert_eq!(wrong(figures(marks(1, 0.0), marks(2, 0.0))), (0.0, 0.5));
        // All beside their marks.
        assert_eq!(wrong(figures(marks(2, 50.0), marks(2, 0.0))), (1.0, 1.0));
        // Four where one is: TuSimple's code gives up on the image.
        assert_eq!(wrong(figures(marks(4, 0.0), marks(1, 0.0))), (0.0, 1.0));
        assert_eq!(wrong(figures(marks(0, 0.0), marks(1, 0.0))), (0.0, 1.0));
        // Right at 23 and at 24 of 28 row anchors: 82 and 86 %.
        let cut = |rows: usize| {
            let mut found = marks(1, 0.0);
            found[0][10..10 + rows].fill(None);
            figures(found, marks(1, 0.0)).false_negative
        };
        assert_eq!((cut(5), cut(4)), (1.0, 0.0));
    }

    #[test]
    fn the_papers_points_are_those_of_seen_truth() {
        let points = |found: MarkPixels, truth: MarkPixels| {
            let figures = lane_accuracy(&found, &truth).expect("marks");
            (figures.right_points, figures.true_points)
        };
        // 18 of the 28 row anchors show each mark; that both are absent elsewhere is no merit.
        assert_eq!(points(marks(2, 0.0), marks(2, 0.0)), (36, 36));
        assert_eq!(points(marks(2, 21.0), marks(2, 0.0)), (0, 36));
        assert_eq!(points(marks(1, 19.0), marks(2, 0.0)), (18, 36));
        assert_eq!(points(marks(4, 0.0), marks(1, 0.0)), (18, 18));
    }
}
