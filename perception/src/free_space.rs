//! How far the LIDAR sees the way free, by azimuth.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use covista_world::{Calibration, FreeSpace, PointCloud};
use nalgebra::Point3;

/// Bins of half a degree.
const BINS: usize = 720;
/// Heights above the ground at which a return stands in the way.
const IN_THE_WAY_M: RangeInclusive<f64> = 0.35..=2.2;
/// Nearer returns come from the own body.
const OWN_BODY_M: f64 = 2.0;
/// No claim is made beyond this: a vehicle's returns get too few.
const FARTHEST_M: f64 = 100.0;

/// The nearest return above the ground in each bin of azimuth around the LIDAR, at most 100 m; 0 in
/// a bin without any return, ground included: nothing was measured there.
///
/// It is only what is seen from here: whatever stands behind the nearest return is not.
pub fn free_space(sweep: &PointCloud, calibration: &Calibration) -> FreeSpace {
    let vehicle_from_lidar = &calibration.vehicle_from_lidar;
    let origin_m = vehicle_from_lidar.translation.vector.xy();
    let mut nearest_m: Vec<Option<f64>> = vec![None; BINS];
    for [x, y, z, _] in &sweep.points {
        let point = vehicle_from_lidar * Point3::new(f64::from(*x), f64::from(*y), f64::from(*z));
        let from_lidar = point.coords.xy() - origin_m;
        let range_m = from_lidar.norm();
        if range_m < OWN_BODY_M {
            continue;
        }
        let azimuth = from_lidar.y.atan2(from_lidar.x).rem_euclid(TAU);
        let bin = ((azimuth / TAU * BINS as f64) as usize).min(BINS - 1);
        let free_m = if IN_THE_WAY_M.contains(&point.z) {
            range_m
        } else {
            FARTHEST_M
        };
        let so_far_m = &mut nearest_m[bin];
        *so_far_m = so_far_m.map_or(Some(free_m), |so_far| Some(so_far.min(free_m)));
    }
    let ranges_m = nearest_m
        .into_iter()
        .map(|nearest| nearest.unwrap_or(0.0) as f32)
        .collect();
    FreeSpace { origin_m, ranges_m }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_return_above_the_ground_ends_the_free_range() {
        let ground_z = -1.73;
        let ground = (0..BINS).map(|bin| {
            let azimuth = (bin as f32 + 0.5) / BINS as f32 * std::f32::consts::TAU;
            [8.0 * azimuth.cos(), 8.0 * azimuth.sin(), ground_z, 0.3]
        });
        let mut sweep = PointCloud {
            points: vec![
                [20.0, 0.1, ground_z + 1.0, 0.3],
                [15.0, 0.1, ground_z + 1.0, 0.3],
                [10.0, 0.1, ground_z + 0.05, 0.3],
                [5.0, 0.1, ground_z + 3.0, 0.3],
                [1.0, 0.01, ground_z + 1.0, 0.3],
                [0.0, -30.0, ground_z + 0.5, 0.3],
                [-150.0, 0.0, ground_z + 0.5, 0.3],
            ],
        };
        sweep.points.extend(ground);
        let free = free_space(&sweep, &Calibration::kitti());
        assert!((free.origin_m.x - 0.9).abs() < 1e-12);
        let at = |degrees: f64| free.free_range_m(degrees.to_radians());
        assert!((at(0.2) - 15.0).abs() < 1e-2);
        assert!((at(-90.0) - 30.0).abs() < 1e-3);
        assert!((at(45.0) - 100.0).abs() < 1e-9);
        assert!((at(180.0) - 100.0).abs() < 1e-9);
    }

    #[test]
    fn where_nothing_returns_nothing_is_free() {
        let blind = free_space(&PointCloud::default(), &Calibration::kitti());
        assert!(blind.ranges_m.iter().all(|range| range.abs() < 1e-9));
    }
}
