//! Marks from pixels to the ground, and the curve of each mark in the vehicle frame.

use covista_world::{Calibration, LaneMarks, MarkCurve, ROW_ANCHORS};
use nalgebra::{Matrix3, Point3, Vector2, Vector3};

use super::decode::MarkPixels;
use crate::ground::Ground;

/// A mark farther than this is too near the horizon to be placed.
const FARTHEST_M: f64 = 80.0;
/// Standard deviation of a mark's u, in pixels, and of paint on the ground.
const PIXEL_STD_PX: f64 = 2.5;
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

/// Adds to the marks' pixels their points on the ground and their curves.
pub fn to_lane_marks(pixels: MarkPixels, ground: &Ground, calibration: &Calibration) -> LaneMarks {
    let points_m = pixels.each_ref().map(|mark| {
        let rows = mark.iter().zip(&ROW_ANCHORS);
        rows.filter_map(|(u_px, row)| {
            ground_point(calibration, ground, f64::from((*u_px)?), f64::from(row.0))
        })
        .filter(|point| point.x < FARTHEST_M)
        .collect::<Vec<_>>()
    });
    let curves = points_m
        .each_ref()
        .map(|points| fit(points, calibration.intrinsics.fx_px));
    LaneMarks {
        pixels,
        points_m,
        curves,
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

/// Standard deviation of a mark's point across the road: that of its pixel grows with distance.
pub fn mark_std_m(point: &Vector2<f64>, focal_px: f64) -> f64 {
    PAINT_STD_M.hypot(PIXEL_STD_PX * point.x.max(1.0) / focal_px)
}

/// y(x) = c0 + c1 x + c2 x^2 through ground points: least squares in units of each point's
/// standard deviation, which grows with its distance, reweighted by a Cauchy loss against points
/// that belong to something else. The prior on c2 keeps few points from bending the curve.
pub fn fit(points: &[Vector2<f64>], focal_px: f64) -> Option<MarkCurve> {
    let std_m = |point: &Vector2<f64>| mark_std_m(point, focal_px);
    let mut weights = vec![1.0; points.len()];
    let mut coefficients = Vector3::zeros();
    for _ in 0..REWEIGHTINGS {
        let mut normal = Matrix3::zeros();
        normal[(2, 2)] = CURVATURE_STD.powi(-2);
        let mut moment = Vector3::zeros();
        for (point, weight) in points.iter().zip(&weights) {
            let powers = Vector3::new(1.0, point.x, point.x * point.x);
            let weight = weight / std_m(point).powi(2);
            normal += weight * powers * powers.transpose();
            moment += weight * point.y * powers;
        }
        coefficients = normal.cholesky()?.solve(&moment);
        for (point, weight) in points.iter().zip(&mut weights) {
            let residual = residual_m(&coefficients, point) / std_m(point);
            *weight = 1.0 / (1.0 + (residual / DOUBTFUL).powi(2));
        }
    }
    let seen = points
        .iter()
        .filter(|point| residual_m(&coefficients, point).abs() < REJECTED * std_m(point))
        .map(|point| point.x);
    let (count, nearest, farthest) = seen.fold(
        (0, f64::INFINITY, f64::NEG_INFINITY),
        |(count, nearest, farthest), x| (count + 1, nearest.min(x), farthest.max(x)),
    );
    (count >= FEWEST_POINTS && farthest - nearest >= SHORTEST_M).then(|| MarkCurve {
        coefficients: coefficients.into(),
        x_range_m: [nearest, farthest],
    })
}

fn residual_m(coefficients: &Vector3<f64>, point: &Vector2<f64>) -> f64 {
    point.y - coefficients.dot(&Vector3::new(1.0, point.x, point.x * point.x))
}

#[cfg(test)]
mod tests {
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
        let marks = to_lane_marks(pixels, &Ground::FLAT, &calibration);
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
        let curve = to_lane_marks(pixels, &Ground::FLAT, &calibration).curves[1].expect("seen");
        for x in [8.0, 20.0, 35.0] {
            assert!((curve.y_at(x) - bend(x)).abs() < 0.15, "{curve:?} at {x}");
        }
    }

    #[test]
    fn too_little_of_a_mark_makes_no_curve() {
        let near = [
            Vector2::new(7.0, 1.0),
            Vector2::new(7.5, 1.0),
            Vector2::new(8.0, 1.0),
        ];
        assert_eq!(fit(&near, 721.0), None);
        assert_eq!(fit(&[], 721.0), None);
        let far = [7.0, 9.0, 12.0].map(|x| Vector2::new(x, 1.0));
        let curve = fit(&far, 721.0).expect("enough");
        assert!((curve.y_at(0.0) - 1.0).abs() < 1e-6);
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
