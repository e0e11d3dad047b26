//! Average precision as the development kit of KITTI's object benchmark counts it, in the bird's
//! eye view and in 3D.
//!
//! Labels that are too low in the picture, too hidden or too truncated for a difficulty, and those
//! of a neighbouring class, are ignored: a box found on one is neither right nor wrong. Boxes found
//! that are lower than the difficulty asks for are ignored, too. The labels take their boxes in the
//! order of the file, twice. First each takes the surest box on it; the scores of those that are
//! right are thinned out to 41 that lie at even recalls. Then, for each such score, the boxes below
//! it are left out, each label takes the box that overlaps it most, and what is left over is wrong.
//! The precisions, made monotone, are averaged over every fourth sample (R11, until 2019) or over
//! all but the first (R40). `DontCare` regions have no place in space and excuse nothing here; they
//! do only in the kit's measure of 2D boxes.

#[cfg(test)]
mod tests;

use covista_world::Detection3d;

use crate::pointpillars::nms::{bev_iou, iou_3d};

/// Samples of the precision, at recalls of 0, 1/40 .. 1.
const SAMPLES: usize = 41;

/// KITTI's three levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Difficulty {
    /// At least 40 px high, fully visible, at most 15 % truncated.
    Easy,
    /// At least 25 px high, at most partly occluded, at most 30 % truncated.
    Moderate,
    /// At least 25 px high, at most largely occluded, at most 50 % truncated.
    Hard,
}

impl Difficulty {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Easy, Self::Moderate, Self::Hard];

    /// Least height in the picture, most occluded, most truncated.
    fn limits(self) -> (f64, u8, f64) {
        match self {
            Self::Easy => (40.0, 0, 0.15),
            Self::Moderate => (25.0, 1, 0.3),
            Self::Hard => (25.0, 2, 0.5),
        }
    }
}

/// Which overlap decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Overlap {
    /// That of the footprints: KITTI's bird's-eye-view benchmark.
    Ground,
    /// That of the volumes: KITTI's 3D object benchmark.
    Volume,
}

/// A label of the class that is measured or of its neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelledBox {
    /// Where it is, in the frame of the boxes found; its score has no meaning.
    pub shape: Detection3d,
    /// Whether it is of the neighbouring class: a van where cars are measured.
    pub is_neighbour: bool,
    /// Height of its 2D box, in pixels.
    pub height_px: f64,
    /// 0 fully visible, 1 partly, 2 largely occluded, 3 unknown.
    pub occluded: u8,
    /// Share of it outside the picture, in [0, 1].
    pub truncated: f64,
}

/// A box found, of any class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundBox {
    /// Where it is, with its score.
    pub shape: Detection3d,
    /// Whether it is of the class that is measured.
    pub is_of_class: bool,
    /// Height of its 2D box, in pixels.
    pub height_px: f64,
}

/// One frame's labels, in the order of their file, and the boxes found in it.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchmarkFrame {
    labelled: Vec<LabelledBox>,
    found: Vec<FoundBox>,
    /// Of each label, for each box found: overlap of the footprints and of the volumes.
    overlaps: Vec<Vec<[f64; 2]>>,
}

/// Average precision of one class at one difficulty, in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KittiPrecision {
    /// Labels that count.
    pub boxes: usize,
    /// Over 11 recalls.
    pub r11: f64,
    /// Over 40 recalls.
    pub r40: f64,
}

impl BenchmarkFrame {
    /// A frame of these labels and boxes.
    pub fn new(labelled: Vec<LabelledBox>, found: Vec<FoundBox>) -> Self {
        let overlaps = labelled
            .iter()
            .map(|label| {
                let each = found.iter().map(|found| {
                    [bev_iou, iou_3d].map(|overlap| overlap(&found.shape, &label.shape))
                });
                each.collect()
            })
            .collect();
        Self {
            labelled,
            found,
            overlaps,
        }
    }
}

impl KittiPrecision {
    /// Over `frames`; a box found is right when its overlap with a label is more than `min_iou`.
    /// `None` when no label counts.
    pub fn over(
        frames: &[BenchmarkFrame],
        difficulty: Difficulty,
        overlap: Overlap,
        min_iou: f64,
    ) -> Option<Self> {
        let rounds: Vec<Round<'_>> = frames
            .iter()
            .map(|frame| Round::new(frame, difficulty, overlap, min_iou))
            .collect();
        let labels = rounds.iter().flat_map(|round| &round.labels);
        let boxes = labels.filter(|role| **role == Role::Counts).count();
        if boxes == 0 {
            return None;
        }
        let scores = rounds.iter().flat_map(Round::scores_of_right).collect();
        let mut precision = [0.0; SAMPLES];
        for (sample, least_score) in precision.iter_mut().zip(sampled_scores(scores, boxes)) {
            let counts = rounds
                .iter()
                .map(|round| round.right_and_wrong(least_score));
            let (right, wrong) = counts.fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
            *sample = right as f64 / (right + wrong).max(1) as f64;
        }
        for sample in (1..SAMPLES).rev() {
            precision[sample - 1] = precision[sample - 1].max(precision[sample]);
        }
        Some(Self {
            boxes,
            r11: precision.iter().step_by(4).sum::<f64>() / 11.0,
            r40: precision[1..].iter().sum::<f64>() / 40.0,
        })
    }
}

/// The scores, of those of the right boxes, at which the recall over `labels` labels comes nearest
/// to 0, 1/40, 2/40 ..
fn sampled_scores(mut scores: Vec<f64>, labels: usize) -> Vec<f64> {
    scores.sort_by(|a, b| b.total_cmp(a));
    let mut sampled = Vec::new();
    let mut recall = 0.0;
    for (index, score) in scores.iter().enumerate() {
        let [here, next] = [1, 2].map(|more| (index + more) as f64 / labels as f64);
        let is_last = index + 1 == scores.len();
        if !is_last && next - recall < recall - here {
            continue;
        }
        sampled.push(*score);
        recall += 1.0 / (SAMPLES - 1) as f64;
    }
    sampled
}

/// What a box is to a difficulty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Counts,
    /// Neither right nor wrong, nor missed.
    Ignored,
    /// Of another class.
    Absent,
}

/// A frame at one difficulty and by one overlap.
struct Round<'a> {
    frame: &'a BenchmarkFrame,
    labels: Vec<Role>,
    found: Vec<Role>,
    overlap: Overlap,
    min_iou: f64,
}

impl<'a> Round<'a> {
    fn new(
        frame: &'a BenchmarkFrame,
        difficulty: Difficulty,
        overlap: Overlap,
        min_iou: f64,
    ) -> Self {
        let (least_px, most_occluded, most_truncated) = difficulty.limits();
        let of_label = |label: &LabelledBox| {
            let is_clear = label.height_px > least_px
                && label.occluded <= most_occluded
                && label.truncated <= most_truncated;
            if is_clear && !label.is_neighbour {
                Role::Counts
            } else {
                Role::Ignored
            }
        };
        let of_found = |found: &FoundBox| {
            if found.height_px < least_px {
                Role::Ignored
            } else if found.is_of_class {
                Role::Counts
            } else {
                Role::Absent
            }
        };
        Self {
            frame,
            labels: frame.labelled.iter().map(of_label).collect(),
            found: frame.found.iter().map(of_found).collect(),
            overlap,
            min_iou,
        }
    }

    /// The scores of the boxes that are right when each label takes the surest one on it.
    fn scores_of_right(&self) -> Vec<f64> {
        let mut taken = vec![false; self.found.len()];
        let mut scores = Vec::new();
        for (label, role) in self.labels.iter().enumerate() {
            let surest = self.on(label, &taken).reduce(|best, next| {
                if self.score(next) > self.score(best) {
                    next
                } else {
                    best
                }
            });
            let Some(found) = surest else { continue };
            taken[found] = true;
            if (*role, self.found[found]) == (Role::Counts, Role::Counts) {
                scores.push(self.score(found));
            }
        }
        scores
    }

    /// How many boxes of at least `least_score` are right and wrong when each label takes the one
    /// that overlaps it most.
    fn right_and_wrong(&self, least_score: f64) -> (usize, usize) {
        let is_left_out = |found: &FoundBox| found.shape.score < least_score;
        let mut taken: Vec<bool> = self.frame.found.iter().map(is_left_out).collect();
        let mut right = 0;
        for (label, role) in self.labels.iter().enumerate() {
            let counts = |found: &usize| self.found[*found] == Role::Counts;
            let nearest = self.on(label, &taken).filter(counts).reduce(|best, next| {
                if self.overlap(label, next) > self.overlap(label, best) {
                    next
                } else {
                    best
                }
            });
            let Some(found) = nearest.or_else(|| self.on(label, &taken).next()) else {
                continue;
            };
            taken[found] = true;
            right += usize::from((*role, self.found[found]) == (Role::Counts, Role::Counts));
        }
        let is_wrong = |found: &usize| self.found[*found] == Role::Counts && !taken[*found];
        (right, (0..taken.len()).filter(is_wrong).count())
    }

    /// The boxes that overlap a label enough and are not taken.
    fn on(&self, label: usize, taken: &[bool]) -> impl Iterator<Item = usize> {
        (0..self.found.len()).filter(move |&found| {
            self.found[found] != Role::Absent
                && !taken[found]
                && self.overlap(label, found) > self.min_iou
        })
    }

    fn overlap(&self, label: usize, found: usize) -> f64 {
        let [ground, volume] = self.frame.overlaps[label][found];
        match self.overlap {
            Overlap::Ground => ground,
            Overlap::Volume => volume,
        }
    }

    fn score(&self, found: usize) -> f64 {
        self.frame.found[found].shape.score
    }
}
