//! The course of the three lanes: one centre line, to which all marks are parallel.

use covista_world::{LANE_COUNT, LaneIndex, MARK_COUNT};
use nalgebra::{SMatrix, SVector, Vector2};

/// The course reaches this far behind the rear axle and ahead of it, along the road.
const REACH_M: f64 = 80.0;
/// Length of the clothoids that it is made of.
pub(super) const NODE_SPACING_M: f64 = 20.0;
/// Curvatures at the clothoids' ends.
pub(super) const NODES: usize = 9;
/// The line is followed in steps of a metre.
const SAMPLES: usize = 161;
const STEP_M: f64 = 1.0;

/// Index of each parameter: the centre line's y at the rear axle and its heading there, its
/// curvature at each node from behind, the width of a lane.
pub(super) const OFFSET: usize = 0;
pub(super) const HEADING: usize = 1;
pub(super) const CURVATURE: usize = 2;
pub(super) const WIDTH: usize = CURVATURE + NODES;
pub(super) const PARAMETERS: usize = WIDTH + 1;

/// The parameters, or derivatives by them.
pub(super) type Parameters = SVector<f64, PARAMETERS>;
/// Their information or covariance.
pub(super) type Square = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// A line whose curvature is linear between nodes, in the vehicle frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CenterLine {
    samples: Vec<Sample>,
}

#[derive(Debug, Clone, PartialEq)]
struct Sample {
    position_m: Vector2<f64>,
    heading_rad: f64,
    curvature_per_m: f64,
    /// How position (x, y) and heading follow the parameters.
    position_by: [Parameters; 2],
    heading_by: Parameters,
}

/// A point beside the line.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Beside {
    /// How far it is to the left of the line.
    pub d_m: f64,
    /// How that follows the parameters.
    pub d_by: Parameters,
    /// The line's heading beside it.
    pub heading_rad: f64,
    /// How that follows the parameters.
    pub heading_by: Parameters,
}

impl CenterLine {
    pub(super) fn new(parameters: &Parameters) -> Self {
        let origin = (REACH_M / STEP_M) as usize;
        let curvatures_by: Vec<Parameters> = (0..SAMPLES).map(curvature_by).collect();
        let headings_by = integral(&curvatures_by, origin, basis(HEADING));
        let headings: Vec<f64> = headings_by.iter().map(|by| by.dot(parameters)).collect();
        let forwards: Vec<Vector2<f64>> = headings
            .iter()
            .map(|heading| Vector2::new(heading.cos(), heading.sin()))
            .collect();
        let start = Vector2::new(0.0, parameters[OFFSET]);
        let positions = integral(&forwards, origin, start);
        // Turning the line at one point swings what follows about it: d forward = left d heading.
        let swings = |axis: usize, start| {
            let turned = forwards.iter().zip(&headings_by).map(|(forward, by)| {
                let left = Vector2::new(-forward.y, forward.x);
                left[axis] * by
            });
            integral(&turned.collect::<Vec<_>>(), origin, start)
        };
        let (xs_by, ys_by) = (swings(0, Parameters::zeros()), swings(1, basis(OFFSET)));
        let samples = (0..SAMPLES).map(|index| Sample {
            position_m: positions[index],
            heading_rad: headings[index],
            curvature_per_m: curvatures_by[index].dot(parameters),
            position_by: [xs_by[index], ys_by[index]],
            heading_by: headings_by[index],
        });
        Self {
            samples: samples.collect(),
        }
    }

    /// How a point lies beside the line.
    pub(super) fn beside(&self, point_m: Vector2<f64>) -> Beside {
        let far = |index: &usize| (point_m - self.samples[*index].position_m).norm_squared();
        let nearest = (0..SAMPLES).min_by(|a, b| far(a).total_cmp(&far(b)));
        let sample = &self.samples[nearest.unwrap_or(0)];
        let (sin, cos) = sample.heading_rad.sin_cos();
        let offset = point_m - sample.position_m;
        let along_m = cos * offset.x + sin * offset.y;
        let across_m = -sin * offset.x + cos * offset.y;
        let [x_by, y_by] = &sample.position_by;
        Beside {
            d_m: across_m - sample.curvature_per_m * along_m * along_m / 2.0,
            d_by: sin * x_by - cos * y_by - along_m * sample.heading_by,
            heading_rad: sample.heading_rad + sample.curvature_per_m * along_m,
            heading_by: sample.heading_by,
        }
    }
}

/// How the curvature at a sample follows those at the nodes.
fn curvature_by(sample: usize) -> Parameters {
    let nodes = sample as f64 * STEP_M / NODE_SPACING_M;
    let before = (nodes as usize).min(NODES - 2);
    let part = nodes - before as f64;
    (1.0 - part) * basis(CURVATURE + before) + part * basis(CURVATURE + before + 1)
}

pub(super) fn basis(index: usize) -> Parameters {
    let mut basis = Parameters::zeros();
    basis[index] = 1.0;
    basis
}

/// The integral of values a step apart by the trapezoidal rule; `start` at index `origin`.
fn integral<const N: usize>(
    values: &[SVector<f64, N>],
    origin: usize,
    start: SVector<f64, N>,
) -> Vec<SVector<f64, N>> {
    let mut sum = SVector::zeros();
    let mut sums = vec![sum];
    for pair in values.windows(2) {
        sum += STEP_M / 2.0 * (pair[0] + pair[1]);
        sums.push(sum);
    }
    let shift = start - sums[origin];
    sums.into_iter().map(|sum| sum + shift).collect()
}

/// The three lanes about the vehicle as one frame shows them: where they run, how wide they are,
/// and how sure that is.
#[derive(Debug, Clone, PartialEq)]
pub struct LaneCourse {
    pub(super) line: CenterLine,
    pub(super) lane_width_m: f64,
    pub(super) covariance: Square,
}

/// Where a vehicle is among the lanes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LanePosition {
    /// The likeliest of the three lanes.
    pub lane: LaneIndex,
    /// Probability that the point lies in it.
    pub probability: f64,
    /// How far the point lies to the left of the road's centre line, in metres.
    pub d_m: f64,
    /// Standard deviation of that, in metres.
    pub d_std_m: f64,
}

impl LaneCourse {
    /// Width of a lane in metres.
    pub fn lane_width_m(&self) -> f64 {
        self.lane_width_m
    }

    /// Where a ground point of the vehicle frame is among the lanes.
    pub fn locate(&self, point_m: Vector2<f64>) -> LanePosition {
        let beside = self.line.beside(point_m);
        let std_m = |by: &Parameters| by.dot(&(self.covariance * by)).max(0.0).sqrt();
        let in_lane = |lane: LaneIndex| {
            let lanes_left = f64::from(LANE_COUNT - 1) / 2.0 - f64::from(lane.get());
            let from_center_m = beside.d_m - lanes_left * self.lane_width_m;
            let std_m = std_m(&(beside.d_by - lanes_left * basis(WIDTH)));
            let [right, left] = [-0.5, 0.5].map(|side| {
                normal_cdf((side * self.lane_width_m - from_center_m) / std_m.max(1e-6))
            });
            left - right
        };
        let lanes = LaneIndex::all().map(|lane| (lane, in_lane(lane)));
        let (lane, probability) = lanes.fold((LaneIndex::LEFTMOST, 0.0), |best, next| {
            if next.1 > best.1 { next } else { best }
        });
        LanePosition {
            lane,
            probability,
            d_m: beside.d_m,
            d_std_m: std_m(&beside.d_by),
        }
    }
}

/// Lanes from the centre line to a mark, to the left.
pub(super) fn mark_lanes(mark: usize) -> f64 {
    (MARK_COUNT - 1) as f64 / 2.0 - mark as f64
}

/// The standard normal distribution, to 1e-7 (Abramowitz and Stegun, 26.2.17).
fn normal_cdf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let series = t
        * (0.319_381_530
            + t * (-0.356_563_782
                + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = (-x * x / 2.0).exp() / std::f64::consts::TAU.sqrt() * series;
    if x < 0.0 { tail } else { 1.0 - tail }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn arc(curvature_per_m: f64) -> Parameters {
        let mut parameters = Parameters::zeros();
        parameters.rows_mut(CURVATURE, NODES).fill(curvature_per_m);
        parameters
    }

    #[test]
    fn a_circle_is_a_circle() {
        let line = CenterLine::new(&arc(1.0 / 80.0));
        for (angle, radius) in [(0.0_f64, 80.0), (0.5, 76.5), (-0.6, 85.0), (0.7, 80.0)] {
            let point = Vector2::new(radius * angle.sin(), 80.0 - radius * angle.cos());
            let beside = line.beside(point);
            assert!((beside.d_m - (80.0 - radius)).abs() < 0.01, "{beside:?}");
            assert!((beside.heading_rad - angle).abs() < 1e-3);
        }
    }

    #[test]
    fn the_normal_distribution_is_the_tables() {
        for (x, expected) in [
            (0.0, 0.5),
            (1.0, 0.841_344_746),
            (-1.96, 0.024_997_895),
            (3.0, 0.998_650_102),
            (-40.0, 0.0),
            (40.0, 1.0),
        ] {
            assert!((normal_cdf(x) - expected).abs() < 1e-7, "{x}");
        }
    }

    proptest! {
        #[test]
        fn derivatives_are_those_of_small_changes(
            offset in -5.0..5.0_f64,
            heading in -0.1..0.1_f64,
            curvatures in proptest::array::uniform9(-0.012..0.012_f64),
            along in -75.0..75.0_f64,
            across in -6.0..6.0_f64,
            index in 0..PARAMETERS,
        ) {
            let mut parameters = Parameters::zeros();
            parameters[OFFSET] = offset;
            parameters[HEADING] = heading;
            parameters.rows_mut(CURVATURE, NODES).copy_from_slice(&curvatures);
            let line = CenterLine::new(&parameters);
            let sample = &line.samples[(along + REACH_M) as usize];
            let (sin, cos) = sample.heading_rad.sin_cos();
            let point = sample.position_m + across * Vector2::new(-sin, cos);
            let before = line.beside(point);
            let small = 1e-6;
            let after = CenterLine::new(&(parameters + small * basis(index))).beside(point);
            let scale = before.d_by.amax().max(1.0);
            prop_assert!(((after.d_m - before.d_m) / small - before.d_by[index]).abs() < 0.01 * scale);
        }
    }
}
