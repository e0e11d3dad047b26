//! The course of the lanes through the marks that the camera sees and along the vehicles that the
//! LIDAR sees, by weighted least squares.

use std::f64::consts::{FRAC_PI_2, PI};

use covista_world::{Detection3d, MARK_COUNT, MarkPoint};

use super::course::{
    CURVATURE, CenterLine, HEADING, LaneCourse, NODES, OFFSET, Parameters, Square, WIDTH, basis,
    mark_lanes,
};

/// What is known of a road before it is seen: the standard deviation of the own place across it
/// and of the heading along it,
const OFFSET_STD_M: f64 = 5.0;
const HEADING_STD_RAD: f64 = 0.03;
/// of its mean curvature, and of how curvature changes from node to node,
const CURVATURE_STD_PER_M: f64 = 1.0 / 150.0;
const CURVATURE_CHANGE_STD_PER_M: f64 = 2.5e-3;
/// and of the width of a lane.
const LANE_WIDTH_M: f64 = 3.4;
const LANE_WIDTH_STD_M: f64 = 0.3;
/// How vehicles point along their lanes, and how well the detector sees that.
const VEHICLE_HEADING_STD_RAD: f64 = 0.05;
/// Residual in standard deviations at which a measurement counts half.
const DOUBTFUL: f64 = 2.0;
/// Measurements far off count at first, so that the course can bend to them: the residual at which
/// one counts half is this many times as large in the first iteration and falls in equal steps.
const TOLERANT: f64 = 9.0;
const TOLERANT_ITERATIONS: usize = 4;
const ITERATIONS: usize = 12;
/// A course needs this many points of marks.
const FEWEST_POINTS: usize = 4;

/// A measured quantity: how far it is off the course, how that follows the parameters, and its
/// standard deviation.
struct Residual {
    off: f64,
    by: Parameters,
    std: f64,
}

impl LaneCourse {
    /// The course that the marks' points lie on and the boxes, in the vehicle frame, point along;
    /// `None` where there are too few points.
    ///
    /// Gauss-Newton on one Cauchy-weighted sum of squares: the distance of each point from its mark,
    /// the angle of each box to the line (whichever way it drives), and the prior. The inverse of
    /// its normal matrix is the covariance.
    pub fn fit(points: &[Vec<MarkPoint>; MARK_COUNT], boxes: &[Detection3d]) -> Option<Self> {
        let prior = prior_information();
        let expected = LANE_WIDTH_M * basis(WIDTH);
        let mut parameters = expected + first_offset_m(points)? * basis(OFFSET);
        let mut covariance = Square::zeros();
        for iteration in 0..ITERATIONS {
            let line = CenterLine::new(&parameters);
            let width_m = parameters[WIDTH];
            let on_marks = points.iter().enumerate().flat_map(|(mark, points)| {
                let lanes = mark_lanes(mark);
                let line = &line;
                points.iter().map(move |point| {
                    let beside = line.beside(point.position_m);
                    Residual {
                        off: beside.d_m - lanes * width_m,
                        by: beside.d_by - lanes * basis(WIDTH),
                        std: point.std_m,
                    }
                })
            });
            let along_boxes = boxes.iter().map(|found| {
                let beside = line.beside(found.center_m.xy());
                Residual {
                    off: axis_angle(found.yaw_rad - beside.heading_rad),
                    by: -beside.heading_by,
                    std: VEHICLE_HEADING_STD_RAD,
                }
            });
            let left = 1.0 - iteration as f64 / TOLERANT_ITERATIONS as f64;
            let doubtful = DOUBTFUL * (TOLERANT * left).max(1.0);
            let mut normal = prior;
            let mut moment = prior * (parameters - expected);
            for Residual { off, by, std } in on_marks.chain(along_boxes) {
                let weight = 1.0 / (1.0 + (off / std / doubtful).powi(2)) / (std * std);
                normal += weight * by * by.transpose();
                moment += weight * off * by;
            }
            covariance = normal.cholesky()?.inverse();
            parameters -= covariance * moment;
        }
        let is_finite = parameters.iter().chain(&covariance).all(|x| x.is_finite());
        is_finite.then(|| Self {
            line: CenterLine::new(&parameters),
            lane_width_m: parameters[WIDTH],
            covariance,
        })
    }
}

fn prior_information() -> Square {
    let mut prior = Square::zeros();
    let mut expect = |combination: Parameters, std: f64| {
        prior += combination * combination.transpose() / (std * std);
    };
    expect(basis(OFFSET), OFFSET_STD_M);
    expect(basis(HEADING), HEADING_STD_RAD);
    expect(basis(WIDTH), LANE_WIDTH_STD_M);
    for node in 0..NODES {
        let std = CURVATURE_STD_PER_M * (NODES as f64).sqrt();
        expect(basis(CURVATURE + node), std);
        if node > 0 {
            let change = basis(CURVATURE + node) - basis(CURVATURE + node - 1);
            expect(change, CURVATURE_CHANGE_STD_PER_M);
        }
    }
    prior
}

/// Where the centre line passes the vehicle if it is straight: the median of the nearer half of
/// the points.
fn first_offset_m(points: &[Vec<MarkPoint>; MARK_COUNT]) -> Option<f64> {
    let mut offsets: Vec<[f64; 2]> = points
        .iter()
        .enumerate()
        .flat_map(|(mark, points)| {
            let lanes = mark_lanes(mark);
            points.iter().map(move |point| {
                [
                    point.position_m.x,
                    point.position_m.y - lanes * LANE_WIDTH_M,
                ]
            })
        })
        .collect();
    if offsets.len() < FEWEST_POINTS {
        return None;
    }
    offsets.sort_by(|a, b| a[0].total_cmp(&b[0]));
    offsets.truncate(offsets.len().div_ceil(2));
    offsets.sort_by(|a, b| a[1].total_cmp(&b[1]));
    Some(offsets[offsets.len() / 2][1])
}

/// The angle between two undirected axes, in [-pi/2, pi/2).
fn axis_angle(angle_rad: f64) -> f64 {
    (angle_rad + FRAC_PI_2).rem_euclid(PI) - FRAC_PI_2
}
