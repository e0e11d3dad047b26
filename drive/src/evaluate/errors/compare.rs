//! The figures by which two sets of frames are compared: the networks' and the model's.

use serde::Serialize;

use super::fit::{box_errors, is_flipped, share};
use super::{ErrorFrames, Sample};

const DISTANCE_M: [f64; 4] = [0.0, 20.0, 40.0, 75.0];

/// What is found of the vehicles in one range of distance, and how well.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorFigures {
    /// From and to, from the LIDAR in the plane, in metres.
    pub distance_m: [f64; 2],
    /// Frames.
    pub frames: usize,
    /// Vehicles in range and in sight.
    pub vehicles: usize,
    /// Share of them that is found.
    pub recall: f64,
    /// Median and 90th percentile of the distance between the centres in the plane, in metres.
    pub center_m: [f64; 2],
    /// The same of the length's error.
    pub length_m: [f64; 2],
    /// The same of the heading's error, front and rear not told apart, in radians.
    pub yaw_rad: [f64; 2],
    /// Share of those found whose box points backwards.
    pub flipped: f64,
    /// Share of those found that are taken for the other class.
    pub other_class: f64,
    /// Share of those found in a lane that are given that lane.
    pub lane_right: f64,
    /// Share of those found in a lane that are given none.
    pub lane_none: f64,
    /// Mean score of those found.
    pub mean_score: f64,
    /// Boxes a frame where no vehicle is.
    pub false_per_frame: f64,
}

/// Figures of frames in ranges of distance.
pub fn figures_by_distance(frames: &ErrorFrames) -> Vec<ErrorFigures> {
    let (samples, false_boxes) = frames.sorted();
    let rows = DISTANCE_M.windows(2).map(|limits| {
        let is_in = |distance_m: f64| limits[0] < distance_m && distance_m <= limits[1];
        let samples: Vec<&Sample> = samples
            .iter()
            .filter(|sample| is_in(sample.truth.truth.center_m.xy().norm()))
            .collect();
        let pairs: Vec<_> = samples
            .iter()
            .filter_map(|sample| Some((sample.truth, sample.found?)))
            .collect();
        let found = pairs.len();
        let errors: Vec<[f64; 7]> = pairs
            .iter()
            .map(|(truth, found)| box_errors(&truth.truth, &found.detection))
            .collect();
        let spread = |of: &dyn Fn(&[f64; 7]) -> f64| {
            let mut values: Vec<f64> = errors.iter().map(|errors| of(errors).abs()).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: f64| {
                let place = (share * values.len() as f64) as usize;
                values.get(place).copied().unwrap_or(0.0)
            };
            [at(0.5), at(0.9)]
        };
        let in_lane: Vec<_> = pairs
            .iter()
            .filter(|(truth, _)| truth.lane.is_some())
            .collect();
        let lanes = |is: &dyn Fn(&covista_sensors::SeenVehicle, &super::FoundBox) -> bool| {
            let counted = in_lane.iter().filter(|(truth, found)| is(truth, found));
            share(counted.count(), in_lane.len())
        };
        let boxes = |is: &dyn Fn(&covista_sensors::SeenVehicle, &super::FoundBox) -> bool| {
            let counted = pairs.iter().filter(|(truth, found)| is(truth, found));
            share(counted.count(), found)
        };
        let scores = pairs.iter().map(|(_, found)| found.detection.score);
        let false_here = false_boxes
            .iter()
            .filter(|(_, found)| is_in(found.detection.center_m.xy().norm()));
        ErrorFigures {
            distance_m: [limits[0], limits[1]],
            frames: frames.frames.len(),
            vehicles: samples.len(),
            recall: share(found, samples.len()),
            center_m: spread(&|errors| errors[0].hypot(errors[1])),
            length_m: spread(&|errors| errors[3]),
            yaw_rad: spread(&|errors| errors[6]),
            flipped: boxes(&|truth, found| is_flipped(&truth.truth, &found.detection)),
            other_class: boxes(&|truth, found| truth.truth.class != found.detection.class),
            lane_right: lanes(&|truth, found| found.lane == truth.lane),
            lane_none: lanes(&|_, found| found.lane.is_none()),
            mean_score: scores.sum::<f64>() / found.max(1) as f64,
            false_per_frame: share(false_here.count(), frames.frames.len()),
        }
    });
    rows.collect()
}
