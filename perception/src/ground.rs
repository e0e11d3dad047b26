//! The ground about the vehicle, as the LIDAR sees it.

use covista_world::{Calibration, PointCloud};
use nalgebra::{Point3, SMatrix, SVector, Vector2, Vector3};

/// Where the ground is looked for, in the vehicle frame: the lowest return of each cell.
const REACH_M: f64 = 70.0;
const HALF_WIDTH_M: f64 = 15.0;
const CELL_M: f64 = 2.0;
/// Nearer returns come from the own body.
const OWN_BODY_M: f64 = 3.0;
/// Standard deviations before anything is seen: of the height below the vehicle in metres, of the
/// slopes, and of their change in 1/m along the vehicle and across.
const PRIOR_STD: [f64; 5] = [0.2, 0.03, 0.03, 1.5e-3, 5e-4];
/// Standard deviation of a cell's lowest return: near by, and what comes to it for each metre.
const HEIGHT_STD_M: f64 = 0.06;
const HEIGHT_STD_PER_M: f64 = 1e-3;
/// The first look counts cells by their height in units of what a slope may make of level ground.
const LEVEL_STD_M: f64 = 0.1;
const LEVEL_STD_PER_M: f64 = 0.02;
/// Residual in standard deviations at which a cell counts a quarter: bushes, walls and vehicles
/// stand on the ground and are not it.
const DOUBTFUL: f64 = 1.5;
const REWEIGHTINGS: usize = 16;

type Terms = SVector<f64, 5>;

/// z = a + b x + c y + d x^2 + e x y in the vehicle frame: a road that climbs, dips and banks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    coefficients: Terms,
}

impl Ground {
    /// The plane z = 0.
    pub const FLAT: Self = Self {
        coefficients: Terms::from_array_storage(nalgebra::ArrayStorage([[0.0; 5]])),
    };

    /// The ground in a sweep, by weighted least squares against whatever stands on it. Where the
    /// sweep shows none it is near the plane that the LIDAR's mounting says.
    pub fn fit(sweep: &PointCloud, calibration: &Calibration) -> Self {
        let cells = lowest_returns(sweep, calibration);
        let mut weights: Vec<f64> = cells
            .iter()
            .map(|cell| {
                let level_m = LEVEL_STD_M + LEVEL_STD_PER_M * cell.xy().norm();
                1.0 / (1.0 + (cell.z / level_m).powi(2))
            })
            .collect();
        let mut ground = Self::FLAT;
        for _ in 0..REWEIGHTINGS {
            let information = Terms::from(PRIOR_STD).map(|std| std.powi(-2));
            let mut normal = SMatrix::<f64, 5, 5>::from_diagonal(&information);
            let mut moment = Terms::zeros();
            for (cell, weight) in cells.iter().zip(&weights) {
                let terms = terms(cell.xy());
                let weight = weight / std_m(cell).powi(2);
                normal += weight * terms * terms.transpose();
                moment += weight * cell.z * terms;
            }
            let Some(factors) = normal.cholesky() else {
                return Self::FLAT;
            };
            ground.coefficients = factors.solve(&moment);
            for (cell, weight) in cells.iter().zip(&mut weights) {
                let residual = (cell.z - ground.height_m(cell.xy())) / std_m(cell);
                *weight = (1.0 + (residual / DOUBTFUL).powi(2)).powi(-2);
            }
        }
        ground
    }

    /// Height of the ground at a point of the vehicle frame.
    pub fn height_m(&self, point: Vector2<f64>) -> f64 {
        self.coefficients.dot(&terms(point))
    }

    /// Where a ray from above first meets the ground: along the ray, the height above the ground is
    /// a quadratic.
    pub fn meet(&self, origin: Point3<f64>, ray: Vector3<f64>) -> Option<Point3<f64>> {
        let [_, b, c, d, e] = self.coefficients.into();
        let above_m = origin.z - self.height_m(origin.xy().coords);
        let slope = Vector2::new(b + 2.0 * d * origin.x + e * origin.y, c + e * origin.x);
        let sinking = slope.dot(&ray.xy()) - ray.z;
        let bending = d * ray.x * ray.x + e * ray.x * ray.y;
        let root = (sinking * sinking + 4.0 * bending * above_m).sqrt();
        let part = 2.0 * above_m / (sinking + root);
        let hit = origin + ray * part;
        (part > 0.0 && hit.iter().all(|value| value.is_finite())).then_some(hit)
    }
}

fn terms(point: Vector2<f64>) -> Terms {
    Terms::new(1.0, point.x, point.y, point.x * point.x, point.x * point.y)
}

fn std_m(cell: &Vector3<f64>) -> f64 {
    HEIGHT_STD_M + HEIGHT_STD_PER_M * cell.xy().norm()
}

/// The lowest return of each cell, in the vehicle frame, whatever the order of the points.
fn lowest_returns(sweep: &PointCloud, calibration: &Calibration) -> Vec<Vector3<f64>> {
    let [columns, rows] = [REACH_M, HALF_WIDTH_M].map(|half| (2.0 * half / CELL_M) as usize);
    let mut lowest: Vec<Option<Vector3<f64>>> = vec![None; columns * rows];
    for [x, y, z, _] in &sweep.points {
        let point = calibration.vehicle_from_lidar
            * Point3::new(f64::from(*x), f64::from(*y), f64::from(*z));
        let outside = point.x.abs() >= REACH_M || point.y.abs() >= HALF_WIDTH_M;
        if outside || point.xy().coords.norm() < OWN_BODY_M {
            continue;
        }
        let [column, row] = [point.x + REACH_M, point.y + HALF_WIDTH_M]
            .map(|from_corner_m| (from_corner_m / CELL_M) as usize);
        let cell = &mut lowest[column.min(columns - 1) * rows + row.min(rows - 1)];
        let found = point.coords;
        let is_lower = cell.is_none_or(|so_far| {
            let order = [2, 0, 1].map(|axis| found[axis].total_cmp(&so_far[axis]));
            order[0].then(order[1]).then(order[2]).is_lt()
        });
        if is_lower {
            *cell = Some(found);
        }
    }
    lowest.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rings of returns from z(x, y) of the vehicle frame, and a wall 2 m high beside the road.
    fn sweep(height_m: impl Fn(f64, f64) -> f64) -> PointCloud {
        let lidar = Calibration::kitti().vehicle_from_lidar.inverse();
        let mut points = Vec::new();
        let mut add = |x: f64, y: f64, z: f64| {
            let point = (lidar * Point3::new(x, y, z)).cast::<f32>();
            points.push([point.x, point.y, point.z, 0.3]);
        };
        for ring in 0..40 {
            let radius = 5.0 * 1.07_f64.powi(ring);
            for step in 0..360 {
                let (sin, cos) = f64::from(step).to_radians().sin_cos();
                let (x, y) = (0.9 + radius * cos, radius * sin);
                if y < 9.0 {
                    add(x, y, height_m(x, y));
                } else if y < 10.0 {
                    add(x, y, height_m(x, y) + 2.0);
                }
            }
        }
        PointCloud { points }
    }

    #[test]
    fn a_hill_with_a_bank_is_found_beside_a_wall() {
        let truth = |x: f64, y: f64| -0.03 + 0.01 * x - 0.02 * y + 4e-4 * x * x + 1e-4 * x * y;
        let ground = Ground::fit(&sweep(truth), &Calibration::kitti());
        for (x, y) in [(0.0, 0.0), (20.0, 5.0), (45.0, -5.0), (-40.0, 3.0)] {
            let error = ground.height_m(Vector2::new(x, y)) - truth(x, y);
            assert!(error.abs() < 0.03, "{error} at {x}, {y}");
        }
    }

    #[test]
    fn nothing_seen_is_flat_and_the_order_of_returns_is_nothing() {
        let calibration = Calibration::kitti();
        let blind = Ground::fit(&PointCloud::default(), &calibration);
        assert_eq!(blind, Ground::FLAT);
        let mut points = sweep(|x, _| 0.01 * x);
        let ground = Ground::fit(&points, &calibration);
        points.points.reverse();
        assert_eq!(Ground::fit(&points, &calibration), ground);
    }

    #[test]
    fn a_ray_meets_the_ground_where_both_are() {
        let coefficients = Terms::new(0.1, 0.02, -0.01, 3e-4, 1e-4);
        let hill = Ground { coefficients };
        let origin = Point3::new(1.17, 0.0, 1.65);
        for (y, z) in [(0.1, -0.05), (-0.2, -0.02), (0.0, 0.0)] {
            let hit = hill.meet(origin, Vector3::new(1.0, y, z)).expect("a hit");
            assert!((hit.z - hill.height_m(hit.xy().coords)).abs() < 1e-9);
        }
        let up = Vector3::new(1.0, 0.0, 0.5);
        assert_eq!(Ground::FLAT.meet(origin, up), None);
        assert_eq!(Ground::FLAT.meet(origin, Vector3::x()), None);
        let flat = Ground::FLAT.meet(origin, Vector3::new(1.0, 0.0, -0.1));
        assert!((flat.expect("a hit") - Point3::new(17.67, 0.0, 0.0)).norm() < 1e-9);
    }
}
