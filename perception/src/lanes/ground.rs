//! Marks from pixels to the ground, and the curve of each mark in the vehicle frame.

use covista_world::{Calibration, LaneMarks, MarkCurve, MarkPoint, ROW_ANCHORS};
use nalgebra::{Matrix3, Point3, Vector2, Vector3};

use super::decode::FoundMarks;
use crate::ground::Ground;

/// A mark farther than this is too near the horizon to be placed.
const FARTHEST_M: f64 = 80.0;
/// Standard deviation of a mark's u, in pixels, of a network that is sure of itself; what comes to
/// it for each pixel of the network's own spread; and that of paint on the ground.
const PIXEL_STD_PX: f64 = 2.5;
const SPREAD_PART: f64 = 0.5;
const PAINT_STD_M: f64 = 0.05;
/// Standard deviation of c2 before anything is seen: half the curvature of a 60 m radius.
const CURVATURE_STD: f64 = 0.5 / 60.0;
/// A curve needs this many points, and this much length.
const FEWEST_POINTS: usize = 3;
const SHORTEST_M: f64 = 4.0;
/// Residuals, in standard deviations, at which a point counts half and is no longer counted.
const DOUBTFUL: f64 = 2.0;
const REJECTED: f64 = 5.0;
const REWEIGHTINGS: usize = 8;

/// The marks that the network found on the ground, and their curves.
pub fn to_lane_marks(found: &FoundMarks, ground: &Ground, calibration: &Calibration) -> LaneMarks {
    let focal_px = calibration.intrinsics.fx_px;
    let points = std::array::from_fn(|mark| {
        let places = found.pixels[mark].iter().zip(&found.spread_px[mark]);
        let in_rows = places
            .zip(&ROW_ANCHORS)
            .filter_map(|((u_px, spread_px), row)| {
                let u_px = f64::from((*u_px)?);
                let position_m = ground_point(calibration, ground, u_px, f64::from(row.0))?;
                let std_px = PIXEL_STD_PX.hypot(SPREAD_PART * f64::from(*spread_px));
                let std_m = PAINT_STD_M.hypot(std_px * position_m.x.max(1.0) / focal_px);
                (position_m.x < FARTHEST_M).then_some(MarkPoint { position_m, std_m })
            });
        in_rows.collect::<Vec<_>>()
    });
    LaneMarks {
        pixels: found.pixels,
        curves: points.each_ref().map(|points| fit(points)),
        points,
    }
}

/// Where the ray through a pixel meets the ground, in the vehicle frame, in metres; `None` at or
/// above the horizon.
pub fn ground_point(
    calibration: &Calibration,
    ground: &Ground,
    u_px: f64,
    v_px: f64,
) -> Option<Vector2<f64>> {
    let origin = calibration.vehicle_from_camera * Point3::origin();
    let ray = calibration.vehicle_from_camera * calibration.intrinsics.ray(u_px, v_px);
    Some(ground.meet(origin, ray)?.coords.xy())
}

/// y(x) = c0 + c1 x + c2 x^2 through ground points: least squares in units of each point's
/// standard deviation, reweighted by a Cauchy loss against points
/// that belong to something else. The prior on c2 keeps few points from bending the curve.
pub fn fit(points: &[MarkPoint]) -> Option<MarkCurve> {
    let mut weights = vec![1.0; points.len()];
    let mut coefficients = Vector3::zeros();
    for _ in 0..REWEIGHTINGS {
        let mut normal = Matrix3::zeros();
        normal[(2, 2)] = CURVATURE_STD.powi(-2);
        let mut moment = Vector3::zeros();
        for (point, weight) in points.iter().zip(&weights) {
            let [x, y]: [f64; 2] = point.position_m.into();
            let powers = Vector3::new(1.0, x, x * x);
            let weight = weight / point.std_m.powi(2);
            normal += weight * powers * powers.transpose();
            moment += weight * y * powers;
        }
        coefficients = normal.cholesky()?.solve(&moment);
        for (point, weight) in points.iter().zip(&mut weights) {
            let residual = residual(&coefficients, point);
            *weight = 1.0 / (1.0 + (residual / DOUBTFUL).powi(2));
        }
    }
    let seen = points
        .iter()
        .filter(|point| residual(&coefficients, point).abs() < REJECTED)
        .map(|point| point.position_m.x);
    let (count, nearest, farthest) = seen.fold(
        (0, f64::INFINITY, f64::NEG_INFINITY),
        |(count, nearest, farthest), x| (count + 1, nearest.min(x), farthest.max(x)),
    );
    (count >= FEWEST_POINTS && farthest - nearest >= SHORTEST_M).then(|| MarkCurve {
        coefficients: coefficients.into(),
        x_range_m: [nearest, farthest],
    })
}

/// How far a point is off the curve, in standard deviations.
fn residual(coefficients: &Vector3<f64>, point: &MarkPoint) -> f64 {
    let [x, y]: [f64; 2] = point.position_m.into();
    (y - coefficients.dot(&Vector3::new(1.0, x, x * x))) / point.std_m
}

#[cfg(test)]
mod tests {
    use super::super::decode::MarkPixels;
    use super::*;
    use covista_world::CameraIntrinsics;

    /// Pixels of marks at y = `marks[i](x)`, projected through the calibration.
    fn project(calibration: &Calibration, marks: [&dyn Fn(f64) -> f64; 4]) -> MarkPixels {
        let camera_from_vehicle = calibration.vehicle_from_camera.inverse();
        let CameraIntrinsics { fy_px, cy_px, .. } = calibration.intrinsics;
        std::array::from_fn(|mark| {
            std::array::from_fn(|row| {
                let below_horizon = f64::from(ROW_ANCHORS[row].0) - cy_px;
                if below_horizon <= 0.0 {
                    return None;
                }
                let x = 1.17 + 1.65 * fy_px / below_horizon;
                let point = camera_from_vehicle * Point3::new(x, marks[mark](x), 0.0);
                let [u, _] = calibration.intrinsics.project(&point)?;
                (0.0..1242.0).contains(&u).then_some(u as f32)
            })
        })
    }

    #[test]
    fn marks_of_a_straight_road_lie_where_they_are_painted() {
        let calibration = Calibration::kitti();
        let pixels = project(&calibration, [&|_| 8.75, &|_| 5.25, &|_| 1.75, &|_| -1.75]);
        let marks = to_lane_marks(&pixels.into(), &Ground::FLAT, &calibration);
        for (curve, y) in marks.curves.iter().zip([8.75, 5.25, 1.75, -1.75]) {
            let curve = curve.expect("seen");
            for x in [0.0, 10.0, 40.0] {
                assert!((curve.y_at(x) - y).abs() < 1e-3, "{curve:?} {y}");
            }
            assert!(curve.x_range_m[1] > 60.0 && curve.x_range_m[1] < FARTHEST_M);
        }
    }

    #[test]
    fn a_curved_mark_is_followed_past_an_outlier() {
        let calibration = Calibration::kitti();
        let bend = |x: f64| 1.75 + x * x / 160.0;
        let mut pixels = project(&calibration, [&bend; 4]);
        let seen = pixels[1].iter().rposition(Option::is_some).expect("seen");
        pixels[1][seen - 4] = Some(30.0);
        let curve =
            to_lane_marks(&pixels.into(), &Ground::FLAT, &calibration).curves[1].expect("seen");
        for x in [8.0, 20.0, 35.0] {
            assert!((curve.y_at(x) - bend(x)).abs() < 0.15, "{curve:?} at {x}");
        }
    }

    #[test]
    fn too_little_of_a_mark_makes_no_curve() {
        let points = |xs: [f64; 3]| {
            xs.map(|x| MarkPoint {
                position_m: Vector2::new(x, 1.0),
                std_m: 0.05,
            })
        };
        assert_eq!(fit(&points([7.0, 7.5, 8.0])), None);
        assert_eq!(fit(&[]), None);
        let curve = fit(&points([7.0, 9.0, 12.0])).expect("enough");
        assert!((curve.y_at(0.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_doubtful_point_bends_no_curve() {
        let calibration = Calibration::kitti();
        let mut found = FoundMarks::from(project(&calibration, [&|_| 1.75; 4]));
        let rows: Vec<usize> = (0..ROW_ANCHORS.len())
            .filter(|&row| found.pixels[1][row].is_some())
            .collect();
        for &row in &rows[..rows.len() / 2] {
            found.pixels[1][row] = found.pixels[1][row].map(|u_px| u_px + 12.0);
            found.spread_px[1][row] = 120.0;
        }
        let marks = to_lane_marks(&found, &Ground::FLAT, &calibration);
        assert!(marks.points[1][0].std_m > 5.0 * marks.points[0][0].std_m);
        let curve = marks.curves[1].expect("seen");
        assert!((curve.y_at(15.0) - 1.75).abs() < 0.05, "{curve:?}");
    }

    #[test]
    fn the_horizon_is_not_on_the_ground() {
        let calibration = Calibration::kitti();
        assert_eq!(
            ground_point(&calibration, &Ground::FLAT, 600.0, 172.0),
            None
        );
        assert_eq!(
            ground_point(&calibration, &Ground::FLAT, 600.0, f64::NAN),
            None
        );
    }
}
