//! Boxes found against true ones all around, seen from above.

use covista_world::Detection3d;

use crate::pointpillars::nms::bev_iou;

/// Recalls at which the precision is sampled, 1/40 to 40/40.
const RECALL_SAMPLES: usize = 40;

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
        .flat_map(|(found, truth)| {
            let pairs = pair(found, truth, min_iou).into_iter();
            pairs.filter_map(|pair| {
                let counts = pair.truth.is_none_or(|(i, _)| !truth[i].ignored);
                counts.then_some((found[pair.found].score, pair.truth.is_some()))
            })
        })
        .collect();
    outcomes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut right = 0;
    let curve: Vec<(f64, f64)> = outcomes
        .iter()
        .enumerate()
        .filter_map(|(i, (score, is_right))| {
            right += usize::from(*is_right);
            // Boxes of one score come together: their order says nothing.
            let is_last = outcomes.get(i + 1).is_none_or(|next| next.0 < *score);
            is_last.then(|| (right as f64 / count as f64, right as f64 / (i + 1) as f64))
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

/// A found box and the true one it takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Index of the found box.
    pub found: usize,
    /// Index of the true box and its BEV IoU with the found one; `None` when it takes none.
    pub truth: Option<(usize, f64)>,
}

/// Each found box, the surest first, with the true one that it takes: of those that are left with
/// a BEV IoU of at least `min_iou` one that counts before one that is ignored, then the one it
/// overlaps most.
pub fn pair(found: &[Detection3d], truth: &[TrueBox], min_iou: f64) -> Vec<Pair> {
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by(|a, b| found[*b].score.total_cmp(&found[*a].score));
    let mut taken = vec![false; truth.len()];
    order
        .into_iter()
        .map(|index| {
            let best = (0..truth.len())
                .filter(|i| !taken[*i])
                .map(|i| (i, bev_iou(&found[index], &truth[i].footprint)))
                .filter(|(_, iou)| *iou >= min_iou)
                .max_by(|(a, iou_a), (b, iou_b)| {
                    let counts = |i: usize| !truth[i].ignored;
                    counts(*a).cmp(&counts(*b)).then(iou_a.total_cmp(iou_b))
                });
            if let Some((i, _)) = best {
                taken[i] = true;
            }
            Pair {
                found: index,
                truth: best,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::ObjectClass;
    use nalgebra::Vector3;

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
    fn the_order_of_equal_scores_says_nothing() {
        let right = (vec![at(0.1, 0.9)], vec![truth(0.0, false)]);
        let wrong = (vec![at(40.0, 0.9)], vec![truth(0.0, false)]);
        let first = average_precision(&[right.clone(), wrong.clone()], 0.7);
        assert_eq!(first, average_precision(&[wrong, right], 0.7));
        assert_eq!(first, Some(0.25));
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
