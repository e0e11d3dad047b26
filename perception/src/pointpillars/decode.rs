//! The detector's maps to boxes: SECOND's deltas from the anchors of each cell.

use std::f64::consts::{FRAC_PI_2, PI};

use covista_world::{Detection3d, ObjectClass, wrap_angle};
use nalgebra::Vector3;

use super::network::HeadMaps;
use super::nms::Suppression;
use crate::card::PointPillarsSpec;

/// Boxes that enter non-maximum suppression, best first; a sound network gives far fewer.
const MAX_CANDIDATES: usize = 1000;
/// Boxes of one frame, best first: more vehicles than a sweep ever shows.
const MAX_BOXES: usize = 100;
/// Logits that are compared with the threshold at once.
const CHUNK: usize = 64;
/// Largest logarithm of a box's size over its anchor's.
const MAX_LOG_SIZE: f64 = 1.0;

#[derive(Debug)]
struct Anchor {
    class: ObjectClass,
    size_m: Vector3<f64>,
    center_z_m: f64,
    yaw_rad: f64,
}

/// Decodes the maps of a detector.
#[derive(Debug)]
pub struct BoxDecoder {
    anchors: Vec<Anchor>,
    /// x and y of the first cell's centre, and the distance of cells, in metres.
    origin_m: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    suppression: Suppression,
    candidates: Vec<Candidate>,
}

/// An anchor whose box is sure enough.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    logit: f32,
    cell: usize,
    anchor: usize,
}

impl BoxDecoder {
    /// The decoder of a detector.
    pub fn new(spec: &PointPillarsSpec) -> Self {
        let anchors = spec.anchors.iter().flat_map(|anchor| {
            [0.0, FRAC_PI_2].map(|yaw_rad| Anchor {
                class: anchor.class,
                size_m: anchor.size_m.into(),
                center_z_m: anchor.center_z_m,
                yaw_rad,
            })
        });
        let cell_m = 2.0 * f64::from(spec.pillar_m);
        Self {
            anchors: anchors.collect(),
            origin_m: [0, 1].map(|axis| f64::from(spec.range_m[axis]) + 0.5 * cell_m),
            cell_m,
            columns: spec.grid()[0] / 2,
            rows: spec.grid()[1] / 2,
            suppression: Suppression::new(spec.nms_iou, MAX_BOXES),
            candidates: Vec::new(),
        }
    }

    /// The boxes with at least the score `least_score`, in (0, 1), that survive non-maximum
    /// suppression, best first, in the LIDAR frame.
    pub fn decode(&mut self, maps: HeadMaps<'_>, least_score: f64) -> Vec<Detection3d> {
        let threshold = (least_score / (1.0 - least_score)).ln() as f32;
        self.find_candidates(maps.class_logits, threshold);
        self.suppression.clear();
        for candidate in &self.candidates {
            if let Some(found) = self.decode_candidate(candidate, maps)
                && self.suppression.add(found).is_full()
            {
                break;
            }
        }
        self.suppression.kept().to_vec()
    }

    /// The surest anchors with at least the logit `threshold`, the best first.
    fn find_candidates(&mut self, class_logits: &[f32], threshold: f32) {
        let candidates = &mut self.candidates;
        candidates.clear();
        let cells = self.rows * self.columns;
        for (anchor, logits) in class_logits.chunks_exact(cells).enumerate() {
            for (chunk, logits) in logits.chunks(CHUNK).enumerate() {
                if !logits
                    .iter()
                    .fold(false, |any, logit| any | (*logit >= threshold))
                {
                    continue;
                }
                let cells = (CHUNK * chunk..).zip(logits);
                let sure = cells.filter(|(_, logit)| **logit >= threshold);
                candidates.extend(sure.map(|(cell, &logit)| Candidate {
                    logit,
                    cell,
                    anchor,
                }));
            }
        }
        let best_first = |a: &Candidate, b: &Candidate| {
            let place = |of: &Candidate| (of.cell, of.anchor);
            b.logit
                .total_cmp(&a.logit)
                .then_with(|| place(a).cmp(&place(b)))
        };
        if candidates.len() > MAX_CANDIDATES {
            candidates.select_nth_unstable_by(MAX_CANDIDATES, best_first);
            candidates.truncate(MAX_CANDIDATES);
        }
        candidates.sort_unstable_by(best_first);
    }

    /// The box of a candidate; `None` where the network's numbers are not finite.
    fn decode_candidate(&self, candidate: &Candidate, maps: HeadMaps<'_>) -> Option<Detection3d> {
        let Candidate {
            logit,
            cell,
            anchor: index,
        } = *candidate;
        let anchor = &self.anchors[index];
        let cells = self.rows * self.columns;
        let delta = |number: usize| f64::from(maps.box_deltas[(7 * index + number) * cells + cell]);
        let deltas: [f64; 7] = std::array::from_fn(delta);
        if !deltas.iter().all(|delta| delta.is_finite()) {
            return None;
        }
        let [ahead, behind] =
            [0, 1].map(|half| maps.direction_logits[(2 * index + half) * cells + cell]);
        let center = |axis: usize, index: usize| self.origin_m[axis] + index as f64 * self.cell_m;
        let diagonal = anchor.size_m.x.hypot(anchor.size_m.y);
        let grown = |axis: usize| {
            anchor.size_m[axis] * deltas[3 + axis].clamp(-MAX_LOG_SIZE, MAX_LOG_SIZE).exp()
        };
        let half = (anchor.yaw_rad + deltas[6] + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2;
        Some(Detection3d {
            center_m: Vector3::new(
                center(0, cell % self.columns) + deltas[0] * diagonal,
                center(1, cell / self.columns) + deltas[1] * diagonal,
                anchor.center_z_m + deltas[2] * anchor.size_m.z,
            ),
            size_m: Vector3::new(grown(0), grown(1), grown(2)),
            yaw_rad: wrap_angle(if behind > ahead { half + PI } else { half }),
            class: anchor.class,
            score: 1.0 / (1.0 + (-f64::from(logit)).exp()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::card::AnchorSpec;

    fn spec() -> PointPillarsSpec {
        PointPillarsSpec {
            range_m: [-8.0, -4.0, -3.0, 8.0, 4.0, 1.0],
            pillar_m: 0.5,
            max_pillars: 100,
            max_points_per_pillar: 4,
            score_threshold: 0.5,
            nms_iou: 0.1,
            anchors: vec![
                AnchorSpec {
                    class: ObjectClass::Car,
                    size_m: [4.0, 3.0, 1.5],
                    center_z_m: -0.95,
                },
                AnchorSpec {
                    class: ObjectClass::Truck,
                    size_m: [6.5, 2.2, 2.6],
                    center_z_m: -0.45,
                },
            ],
        }
    }

    /// Maps of the 8x16 cells of `spec`, empty but for what `set` puts in.
    fn decode(set: impl Fn(&mut [f32], &mut [f32], &mut [f32])) -> Vec<Detection3d> {
        let slots = CELLS * 4;
        let mut class_logits = vec![-9.0; slots];
        let mut box_deltas = vec![0.0; 7 * slots];
        let mut direction_logits = vec![0.0; 2 * slots];
        set(&mut class_logits, &mut box_deltas, &mut direction_logits);
        let maps = HeadMaps {
            class_logits: &class_logits,
            box_deltas: &box_deltas,
            direction_logits: &direction_logits,
        };
        BoxDecoder::new(&spec()).decode(maps, 0.5)
    }

    const CELLS: usize = 8 * 16;

    /// Place of one of the `numbers` numbers of an anchor.
    fn slot([ix, iy]: [usize; 2], anchor: usize, [number, numbers]: [usize; 2]) -> usize {
        (anchor * numbers + number) * CELLS + iy * 16 + ix
    }

    #[test]
    fn a_hand_made_map_gives_its_box() {
        let cell = [10, 2];
        let boxes = decode(|class, deltas, direction| {
            class[slot(cell, 1, [0, 1])] = 3f32.ln();
            let numbers = [0.1, -0.2, 0.5, 2f32.ln(), 0.0, -0.5, 0.3];
            for (number, value) in numbers.into_iter().enumerate() {
                deltas[slot(cell, 1, [number, 7])] = value;
            }
            direction[slot(cell, 1, [1, 2])] = 1.0;
        });
        let [found] = boxes[..] else {
            panic!("one box, not {boxes:?}");
        };
        // The anchor's diagonal is 5 m; the cell's centre is (2.5, -1.5).
        let center = Vector3::new(2.5 + 0.5, -1.5 - 1.0, -0.95 + 0.75);
        assert!((found.center_m - center).norm() < 1e-6, "{found:?}");
        let size = Vector3::new(8.0, 3.0, 1.5 * (-0.5f64).exp());
        assert!((found.size_m - size).norm() < 1e-6, "{found:?}");
        // pi/2 + 0.3 folds to 0.3 - pi/2, and the second bin turns it round again.
        assert!(
            (found.yaw_rad - (FRAC_PI_2 + 0.3)).abs() < 1e-6,
            "{found:?}"
        );
        assert!((found.score - 0.75).abs() < 1e-6);
        assert_eq!(found.class, ObjectClass::Car);
    }

    #[test]
    fn a_truck_at_yaw_zero_is_the_third_anchor() {
        let boxes = decode(|class, _, _| class[slot([0, 0], 2, [0, 1])] = 5.0);
        assert_eq!(boxes.len(), 1);
        assert_eq!(boxes[0].class, ObjectClass::Truck);
        assert!((boxes[0].center_m - Vector3::new(-7.5, -3.5, -0.45)).norm() < 1e-6);
        assert!(boxes[0].yaw_rad.abs() < 1e-12);
    }

    #[test]
    fn numbers_that_are_not_finite_make_no_box() {
        let boxes = decode(|class, deltas, _| {
            class[slot([1, 1], 0, [0, 1])] = f32::NAN;
            class[slot([9, 1], 0, [0, 1])] = 9.0;
            deltas[slot([9, 1], 0, [0, 7])] = f32::INFINITY;
        });
        assert!(boxes.is_empty(), "{boxes:?}");
    }

    #[test]
    fn a_map_full_of_boxes_ends_in_few() {
        let boxes = decode(|class, deltas, _| {
            class.fill(9.0);
            deltas.fill(1e30);
        });
        assert!(boxes.len() <= MAX_BOXES);
        assert!(
            boxes
                .iter()
                .all(|found| found.yaw_rad.is_finite() && found.size_m.max() < 20.0)
        );
    }
}
