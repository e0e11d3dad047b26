use nalgebra::{Point3, Vector2, Vector3};

use super::{Grid, Terrain};

/// No ray is followed beyond this.
const FARTHEST_M: f64 = 10_000.0;
/// How far a ray is pushed over the border of a cell.
const NUDGE_M: f64 = 1e-6;

impl Terrain {
    /// Distance along the ray from `origin` along the unit vector `direction` to the point within
    /// `max_m` at which it goes below the ground.
    ///
    /// A ray that starts below the ground meets none.
    pub fn meet(&self, origin: &Point3<f64>, direction: &Vector3<f64>, max_m: f64) -> Option<f64> {
        match &self.grid {
            None => {
                let distance_m = -origin.z / direction.z;
                (direction.z < 0.0 && distance_m > 0.0 && distance_m <= max_m).then_some(distance_m)
            }
            Some(grid) => grid.meet(origin, direction, max_m.min(FARTHEST_M)),
        }
    }
}

/// The ground of one cell along a ray, as a function of the distance from where the ray stands.
struct Crossing {
    /// Height of the ray above the ground: c + b s + a s^2.
    clearance_m: [f64; 3],
    /// Distance to the border of the cell.
    exit_m: f64,
}

impl Grid {
    /// Safe steps by the steepest slope through the air, and the root of a quadratic where the
    /// ground is near: along a straight line the height of a bilinear patch is one.
    fn meet(&self, origin: &Point3<f64>, direction: &Vector3<f64>, max_m: f64) -> Option<f64> {
        let closing = self.steepest * direction.xy().norm() - direction.z;
        let mut along_m = 0.0;
        while closing > 0.0 && along_m <= max_m {
            let crossing = self.crossing(&(origin + direction * along_m), direction);
            let clear_m = crossing.clearance_m[0];
            if clear_m <= 0.0 {
                return (along_m > 0.0).then_some(along_m);
            }
            let safe_m = clear_m / closing;
            if safe_m > crossing.exit_m {
                along_m += safe_m;
            } else if let Some(root_m) = crossing.root_m() {
                return Some(along_m + root_m).filter(|&distance_m| distance_m <= max_m);
            } else {
                along_m += crossing.exit_m + NUDGE_M;
            }
        }
        None
    }

    fn crossing(&self, from: &Point3<f64>, direction: &Vector3<f64>) -> Crossing {
        let last = (self.nodes_per_side - 1) as f64;
        let at = (from.coords.xy() - self.corner) / self.spacing_m;
        let step = direction.xy() / self.spacing_m;
        let cell = at.map(f64::floor);
        // Beyond the grid the ground goes on at the height of its rim.
        let index = |cell: f64| cell.clamp(0.0, last) as usize;
        let columns = [index(cell.x), index(cell.x + 1.0)];
        let rows = [index(cell.y), index(cell.y + 1.0)];
        let node = |column: usize, row: usize| {
            f64::from(self.heights_m[rows[row] * self.nodes_per_side + columns[column]])
        };
        let corner_m = node(0, 0);
        let (rise_x, rise_y) = (node(1, 0) - corner_m, node(0, 1) - corner_m);
        let twist = node(1, 1) - node(0, 1) - rise_x;
        let local = at - cell;
        let ground_m = corner_m + rise_x * local.x + rise_y * local.y + twist * local.x * local.y;
        let slope = Vector2::new(rise_x + twist * local.y, rise_y + twist * local.x);
        let exit = |axis: usize| {
            let border = if step[axis] > 0.0 { 1.0 } else { 0.0 };
            let exit_m = (border - local[axis]) / step[axis];
            if exit_m.is_finite() { exit_m } else { f64::MAX }
        };
        Crossing {
            clearance_m: [
                from.z - ground_m,
                direction.z - slope.dot(&step),
                -twist * step.x * step.y,
            ],
            exit_m: exit(0).min(exit(1)),
        }
    }
}

impl Crossing {
    /// The first root ahead within the cell.
    fn root_m(&self) -> Option<f64> {
        let [c, b, a] = self.clearance_m;
        let root = (b * b - 4.0 * a * c).sqrt();
        // Of the two forms of the solution, the one without cancellation.
        let distance_m = if b < 0.0 {
            2.0 * c / (root - b)
        } else {
            -(b + root) / (2.0 * a)
        };
        (distance_m > 0.0 && distance_m <= self.exit_m).then_some(distance_m)
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn hills() -> Terrain {
        Terrain::sampled(Vector2::new(3.0, -8.0), 70.0, 4.0, |p| {
            1.5 * (p.x / 9.0).sin() + 0.8 * (p.y / 7.0).cos() + 0.02 * p.x
        })
    }

    /// The first of many small steps that lies below the ground, halved to a micrometre.
    fn marched_m(terrain: &Terrain, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        let below = |along_m: f64| {
            let at = origin + direction * along_m;
            at.z <= terrain.height_m(at.coords.xy())
        };
        let steps = 0..60_000;
        let first = steps
            .map(|step| f64::from(step) * 2e-3)
            .find(|&m| below(m))?;
        let (mut above_m, mut below_m) = (first - 2e-3, first);
        while below_m - above_m > 1e-6 {
            let middle_m = (above_m + below_m) / 2.0;
            if below(middle_m) {
                below_m = middle_m;
            } else {
                above_m = middle_m;
            }
        }
        Some(below_m)
    }

    #[test]
    fn hills_are_met_where_a_fine_march_meets_them() {
        let (terrain, mut rng) = (hills(), ChaCha8Rng::seed_from_u64(5));
        let mut met = 0;
        for _ in 0..200 {
            let (x, y) = (rng.random_range(-90.0..90.0), rng.random_range(-90.0..90.0));
            let above_m = rng.random_range(0.1..4.0);
            let origin = Point3::new(x, y, terrain.height_m(Vector2::new(x, y)) + above_m);
            let (yaw, pitch) = (
                rng.random_range(-3.2..3.2_f64),
                rng.random_range(-0.5..0.2_f64),
            );
            let direction = Vector3::new(
                pitch.cos() * yaw.cos(),
                pitch.cos() * yaw.sin(),
                pitch.sin(),
            );
            let found = terrain.meet(&origin, &direction, 119.9);
            let marched = marched_m(&terrain, &origin, &direction).filter(|&m| m <= 119.9);
            match (found, marched) {
                // A march may step over a crest that it touches for less than a step.
                (Some(found_m), marched) if marched.is_none_or(|m| found_m < m - 1e-3) => {
                    let at = origin + direction * (found_m + 1e-6);
                    assert!((at.z - terrain.height_m(at.coords.xy())).abs() < 1e-5);
                }
                (Some(found_m), Some(marched_m)) => {
                    assert!((found_m - marched_m).abs() < 1e-4, "{found_m} {marched_m}");
                    met += 1;
                }
                (found, marched) => assert_eq!(found, marched),
            }
        }
        assert!(met > 100, "{met}");
    }

    #[test]
    fn a_slope_is_a_plane() {
        let terrain = Terrain::sampled(Vector2::zeros(), 100.0, 5.0, |p| 0.08 * p.x - 0.03 * p.y);
        let origin = Point3::new(-10.0, 4.0, 1.0);
        for (x, y, z) in [(1.0, 0.2, 0.02), (-0.3, 1.0, -0.2), (0.0, 0.0, -1.0)] {
            let direction = Vector3::new(x, y, z).normalize();
            let clear_m = origin.z - (0.08 * origin.x - 0.03 * origin.y);
            let closing = 0.08 * direction.x - 0.03 * direction.y - direction.z;
            let found_m = terrain.meet(&origin, &direction, 80.0).expect("the slope");
            assert!((found_m - clear_m / closing).abs() < 1e-4);
        }
        assert!(terrain.meet(&origin, &Vector3::z(), 80.0).is_none());
        assert!(terrain.meet(&origin, &-Vector3::x(), 80.0).is_none());
    }

    #[test]
    fn odd_rays_meet_nothing_and_come_to_an_end() {
        let terrain = hills();
        let (nan, eye) = (f64::NAN, Point3::new(0.0, 0.0, 30.0));
        assert!(
            terrain
                .meet(&Point3::new(0.0, 0.0, -30.0), &-Vector3::z(), 99.0)
                .is_none()
        );
        assert!(
            terrain
                .meet(&Point3::new(nan, 0.0, 9.0), &-Vector3::z(), 99.0)
                .is_none()
        );
        assert!(
            terrain
                .meet(&eye, &Vector3::new(nan, 0.0, -1.0), 99.0)
                .is_none()
        );
        assert!(terrain.meet(&eye, &Vector3::x(), f64::INFINITY).is_none());
        assert!(terrain.meet(&eye, &Vector3::x(), nan).is_none());
    }
}
