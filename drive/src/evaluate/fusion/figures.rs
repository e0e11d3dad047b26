//! Verdicts counted: the figures of the fusion.

use serde::Serialize;

use super::geometry::{Deviation, GeometryErrors};
use super::{Origin, Road, Subject, Verdict};

/// What counts as near: the range of the headline figure.
const NEAR_M: [f64; 2] = [0.0, 50.0];
const BIN_M: f64 = 10.0;
const BINS: usize = 7;
/// Bounds of the probabilities that reliability is told for.
const PROBABILITIES: [f64; 6] = [0.0, 0.5, 0.7, 0.9, 0.99, 1.0];

/// The fusion's figures on the frames of one data set.
#[derive(Debug, Clone, PartialEq)]
pub struct FusionEvaluation {
    /// Seed of the data set.
    pub seed: Option<u64>,
    /// Its split.
    pub split: Option<String>,
    /// Lane indices by what they were made from, road, view and distance; those within 50 m first.
    pub lane_indices: Vec<LaneIndexFigures>,
    /// How well the probabilities that the fusion gives are kept, with both networks.
    pub reliability: Vec<Reliability>,
    /// Errors of the other numbers of the percepts.
    pub geometry: Vec<GeometryErrors>,
}

/// One row of `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "figure", rename_all = "snake_case")]
pub enum FusionFigures {
    /// Lane indices.
    LaneIndex(LaneIndexFigures),
    /// Probabilities against frequencies.
    Reliability(Reliability),
    /// Distances and angles.
    Geometry(GeometryErrors),
}

/// How many vehicles are put into the right lane; shares in percent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LaneIndexFigures {
    /// Where the marks come from.
    pub marks: Origin,
    /// Where the boxes come from.
    pub boxes: Origin,
    /// `marked` is `straight` and `curve` together.
    pub road: &'static str,
    /// `all`, `camera` or `outside` of its view.
    pub view: &'static str,
    /// Nearest distance in the ground plane, in metres.
    pub from_m: f64,
    /// Farthest distance.
    pub to_m: f64,
    /// Visible vehicles in one of the three lanes.
    pub vehicles: usize,
    /// Of these: found and put into their lane.
    pub lane_index_accuracy: Option<f64>,
    /// Of these: not found.
    pub undetected: Option<f64>,
    /// Of these: found and put into no lane.
    pub undecided: Option<f64>,
    /// Of these: put into another lane.
    pub wrong: Option<f64>,
    /// Of those found: put into their lane.
    pub lane_index_accuracy_detected: Option<f64>,
    /// Visible vehicles in none of the three lanes that were found.
    pub elsewhere: usize,
    /// Of these: put into one of the lanes, all the same.
    pub elsewhere_given_lane: Option<f64>,
    /// Boxes where nothing is.
    pub false_boxes: usize,
    /// Of these: put into one of the lanes.
    pub false_boxes_given_lane: Option<f64>,
}

/// Vehicles to which fusion gave a probability in a range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reliability {
    /// Where the marks come from.
    pub marks: Origin,
    /// Least probability.
    pub from_probability: f64,
    /// Greatest.
    pub to_probability: f64,
    /// Visible vehicles, in a lane or elsewhere.
    pub vehicles: usize,
    /// Mean probability given, in percent.
    pub expected_accuracy: Option<f64>,
    /// Share that is in the likeliest lane, in percent; where fusion said none, all count as not.
    pub lane_index_accuracy: Option<f64>,
}

impl FusionEvaluation {
    pub(super) fn new(
        origin: Option<(u64, String)>,
        verdicts: &[Verdict],
        deviations: &[Deviation],
    ) -> Self {
        let (seed, split) = origin.unzip();
        let bins = (0..BINS).map(|bin| [bin as f64 * BIN_M, (bin + 1) as f64 * BIN_M]);
        let ranges: Vec<[f64; 2]> = std::iter::once(NEAR_M).chain(bins).collect();
        let mut lane_indices = Vec::new();
        for range_m in &ranges {
            for marks in [Origin::Network, Origin::Exact] {
                for boxes in [Origin::Network, Origin::Exact] {
                    for road in ["marked", "straight", "curve", "unmarked"] {
                        for view in ["all", "camera", "outside"] {
                            let group = Group {
                                marks,
                                boxes,
                                road,
                                view,
                                range_m: *range_m,
                            };
                            lane_indices.extend(group.figures(verdicts));
                        }
                    }
                }
            }
        }
        let probabilities = PROBABILITIES.windows(2);
        let reliability = [Origin::Network, Origin::Exact]
            .into_iter()
            .flat_map(|marks| {
                probabilities
                    .clone()
                    .map(move |bounds| Reliability::new(marks, bounds, verdicts))
            });
        Self {
            seed,
            split,
            lane_indices,
            reliability: reliability.collect(),
            geometry: ranges
                .iter()
                .map(|range_m| GeometryErrors::new(*range_m, deviations))
                .collect(),
        }
    }

    /// All figures as rows.
    pub fn rows(&self) -> Vec<FusionFigures> {
        let lanes = self
            .lane_indices
            .iter()
            .cloned()
            .map(FusionFigures::LaneIndex);
        let reliability = self
            .reliability
            .iter()
            .cloned()
            .map(FusionFigures::Reliability);
        let geometry = self.geometry.iter().cloned().map(FusionFigures::Geometry);
        lanes.chain(reliability).chain(geometry).collect()
    }
}

struct Group {
    marks: Origin,
    boxes: Origin,
    road: &'static str,
    view: &'static str,
    range_m: [f64; 2],
}

impl Group {
    fn holds(&self, verdict: &Verdict) -> bool {
        let [from_m, to_m] = self.range_m;
        let road = match self.road {
            "straight" => verdict.road == Road::Straight,
            "curve" => verdict.road == Road::Bent,
            "unmarked" => verdict.road == Road::Unmarked,
            _ => verdict.road != Road::Unmarked,
        };
        let view = match self.view {
            "camera" => verdict.in_camera,
            "outside" => !verdict.in_camera,
            _ => true,
        };
        let origins = (verdict.marks, verdict.boxes) == (self.marks, self.boxes);
        origins && road && view && (from_m..to_m).contains(&verdict.distance_m)
    }

    /// `None` where there is nothing to count.
    fn figures(&self, verdicts: &[Verdict]) -> Option<LaneIndexFigures> {
        let (mut vehicles, mut right, mut undetected, mut undecided) = (0, 0, 0, 0);
        let mut elsewhere = [0, 0];
        let mut nothing = [0, 0];
        for verdict in verdicts.iter().filter(|verdict| self.holds(verdict)) {
            let given = verdict.found.map(|found| found.lane);
            match (verdict.subject, given) {
                (Subject::InLane(truth), given) => {
                    vehicles += 1;
                    undetected += usize::from(given.is_none());
                    undecided += usize::from(given == Some(None));
                    right += usize::from(given == Some(Some(truth)));
                }
                (Subject::Elsewhere, Some(lane)) => {
                    elsewhere[0] += 1;
                    elsewhere[1] += usize::from(lane.is_some());
                }
                (Subject::Nothing, Some(lane)) => {
                    nothing[0] += 1;
                    nothing[1] += usize::from(lane.is_some());
                }
                (Subject::Elsewhere | Subject::Nothing, None) => {}
            }
        }
        let wrong = vehicles - right - undetected - undecided;
        let [from_m, to_m] = self.range_m;
        (vehicles + elsewhere[0] + nothing[0] > 0).then(|| LaneIndexFigures {
            marks: self.marks,
            boxes: self.boxes,
            road: self.road,
            view: self.view,
            from_m,
            to_m,
            vehicles,
            lane_index_accuracy: percent(right, vehicles),
            undetected: percent(undetected, vehicles),
            undecided: percent(undecided, vehicles),
            wrong: percent(wrong, vehicles),
            lane_index_accuracy_detected: percent(right, vehicles - undetected),
            elsewhere: elsewhere[0],
            elsewhere_given_lane: percent(elsewhere[1], elsewhere[0]),
            false_boxes: nothing[0],
            false_boxes_given_lane: percent(nothing[1], nothing[0]),
        })
    }
}

impl Reliability {
    fn new(marks: Origin, bounds: &[f64], verdicts: &[Verdict]) -> Self {
        let (from, to) = (bounds[0], bounds[1]);
        let (mut vehicles, mut expected, mut right) = (0, 0.0, 0);
        for verdict in verdicts {
            let is_asked = (verdict.marks, verdict.boxes) == (marks, Origin::Network)
                && verdict.road != Road::Unmarked
                && verdict.subject != Subject::Nothing;
            let Some(found) = verdict.found.filter(|_| is_asked) else {
                continue;
            };
            let is_last = to >= 1.0;
            if found.probability < from || (found.probability >= to && !is_last) {
                continue;
            }
            vehicles += 1;
            expected += found.probability;
            right += usize::from(match (verdict.subject, found.lane) {
                (Subject::InLane(truth), Some(lane)) => truth == lane,
                _ => false,
            });
        }
        Self {
            marks,
            from_probability: from,
            to_probability: to,
            vehicles,
            expected_accuracy: (vehicles > 0).then(|| 100.0 * expected / vehicles as f64),
            lane_index_accuracy: percent(right, vehicles),
        }
    }
}

pub(super) fn percent(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| 100.0 * part as f64 / whole as f64)
}
