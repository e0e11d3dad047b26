use nalgebra::{Point3, Vector3};

use super::blocks::Blocks;
use super::{Grid, Terrain};

/// No ray is followed beyond this.
const FARTHEST_M: f64 = 10_000.0;

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
            Some(grid) => Ray::over(grid, origin, direction).meet(max_m.min(FARTHEST_M)),
        }
    }
}

/// A ray above a grid, its horizontal coordinates in cells from the grid's corner.
struct Ray<'a> {
    grid: &'a Grid,
    from: [f64; 2],
    /// Cells per metre along the ray, and the reverse.
    step: [f64; 2],
    cell_m: [f64; 2],
    height_m: f64,
    climb: f64,
}

impl<'a> Ray<'a> {
    fn over(grid: &'a Grid, origin: &Point3<f64>, direction: &Vector3<f64>) -> Self {
        let per_m = 1.0 / grid.spacing_m;
        let step = [direction.x * per_m, direction.y * per_m];
        Self {
            grid,
            from: [
                (origin.x - grid.corner.x) * per_m,
                (origin.y - grid.corner.y) * per_m,
            ],
            step,
            cell_m: step.map(|step| 1.0 / step),
            height_m: origin.z,
            climb: direction.z,
        }
    }

    /// Passes over the blocks of cells that it stays above, and looks at the cells of the others
    /// where it is below the plane that covers the block.
    fn meet(&self, max_m: f64) -> Option<f64> {
        if self.rises() {
            return None;
        }
        let blocks = &self.grid.blocks;
        let scale = 1.0 / Blocks::CELLS as f64;
        let mut walk = Walk::new(
            self.from.map(|from| from * scale),
            self.step.map(|step| step * scale),
            self.cell_m.map(|cell_m| cell_m * Blocks::CELLS as f64),
            0.0,
            blocks.to_a_side,
        );
        let mut along_m = 0.0;
        while along_m < max_m {
            let exit_m = walk.exit_m().min(max_m);
            if let Some([near_m, far_m]) = self.below(blocks.cover(walk.cell), [along_m, exit_m])
                && let Some(distance_m) = self.meet_cell(near_m, far_m)
            {
                return (distance_m > 0.0).then_some(distance_m);
            }
            along_m = exit_m;
            walk.advance();
        }
        None
    }

    /// Whether the ray rises at least as steeply as the steepest ground.
    fn rises(&self) -> bool {
        let [x, y] = self
            .step
            .map(|step| step * self.grid.spacing_m * self.grid.steepest);
        self.climb >= 0.0 && self.climb * self.climb >= x * x + y * y
    }

    /// From where to where between two distances the ray is below a plane.
    fn below(&self, plane: [f64; 3], [near_m, far_m]: [f64; 2]) -> Option<[f64; 2]> {
        let [height_m, per_x, per_y] = plane;
        let above_m = self.height_m - height_m - per_x * self.from[0] - per_y * self.from[1];
        let closing = per_x * self.step[0] + per_y * self.step[1] - self.climb;
        let (enters, leaves) = (above_m > closing * near_m, above_m > closing * far_m);
        match (enters, leaves) {
            (true, true) => None,
            (true, false) => Some([above_m / closing, far_m]),
            (false, true) => Some([near_m, above_m / closing]),
            (false, false) => Some([near_m, far_m]),
        }
    }

    /// The first point from `near_m` to `far_m` below the ground, cell by cell.
    fn meet_cell(&self, near_m: f64, far_m: f64) -> Option<f64> {
        let mut walk = self.walk(near_m);
        let mut along_m = near_m;
        while along_m < far_m {
            let exit_m = walk.exit_m();
            let clearance_m = self.clearance(&self.patch(walk.cell), along_m);
            let end_m = exit_m.min(far_m);
            if let Some(root_m) = first_root(clearance_m, end_m - along_m) {
                return Some(along_m + root_m);
            }
            along_m = exit_m;
            walk.advance();
        }
        None
    }

    fn at(&self, along_m: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.from[axis] + self.step[axis] * along_m)
    }

    /// The way over the cells from `along_m` on.
    fn walk(&self, along_m: f64) -> Walk {
        let cells_to_a_side = self.grid.nodes_per_side - 1;
        Walk::new(
            self.at(along_m),
            self.step,
            self.cell_m,
            along_m,
            cells_to_a_side,
        )
    }

    /// The ground of a cell: its height is `corner + rise . (x, y) + twist x y`, with (x, y) from
    /// the grid's corner.
    fn patch(&self, cell: [usize; 2]) -> Patch {
        let last = self.grid.nodes_per_side - 1;
        // Beyond the grid the ground goes on at the height of its rim.
        let [columns, rows] = cell.map(|index| [index.saturating_sub(1), index.min(last)]);
        let node = |column: usize, row: usize| {
            f64::from(self.grid.heights_m[rows[row] * self.grid.nodes_per_side + columns[column]])
        };
        let corner_m = node(0, 0);
        let (rise_x, rise_y) = (node(1, 0) - corner_m, node(0, 1) - corner_m);
        Patch {
            corner: cell.map(|index| index as f64 - 1.0),
            corner_m,
            rise: [rise_x, rise_y],
            twist: node(1, 1) - node(0, 1) - rise_x,
        }
    }

    /// Height of the ray above a cell's ground `s` beyond `along_m`, as c + b s + a s^2.
    fn clearance(&self, patch: &Patch, along_m: f64) -> [f64; 3] {
        let at = self.at(along_m);
        let (x, y) = (at[0] - patch.corner[0], at[1] - patch.corner[1]);
        let ([rise_x, rise_y], twist) = (patch.rise, patch.twist);
        let ground_m = patch.corner_m + rise_x * x + rise_y * y + twist * x * y;
        let [step_x, step_y] = self.step;
        let climb = (rise_x + twist * y) * step_x + (rise_y + twist * x) * step_y;
        [
            self.height_m + self.climb * along_m - ground_m,
            self.climb - climb,
            -twist * step_x * step_y,
        ]
    }
}

/// The bilinear ground of one cell.
struct Patch {
    corner: [f64; 2],
    corner_m: f64,
    rise: [f64; 2],
    twist: f64,
}

/// The first `s` from 0 to `reach_m` at which c + b s + a s^2 is not positive.
fn first_root([c, b, a]: [f64; 3], reach_m: f64) -> Option<f64> {
    if c <= 0.0 {
        return Some(0.0);
    }
    // Of the two forms of the solution, the one without cancellation.
    let root = (b * b - 4.0 * a * c).sqrt();
    let distance_m = if b < 0.0 {
        2.0 * c / (root - b)
    } else {
        -(b + root) / (2.0 * a)
    };
    (distance_m > 0.0 && distance_m <= reach_m).then_some(distance_m)
}

/// A straight way over a square of cells, about which lie others without end. These are column 0
/// and the last one, row 0 and the last one.
struct Walk {
    cell: [usize; 2],
    last: usize,
    /// Distance at which the way leaves its column, and its row.
    exits_m: [f64; 2],
    /// From border to border.
    pitch_m: [f64; 2],
    upwards: [bool; 2],
}

impl Walk {
    fn new(
        at: [f64; 2],
        step: [f64; 2],
        pitch_m: [f64; 2],
        along_m: f64,
        cells_to_a_side: usize,
    ) -> Self {
        let last = cells_to_a_side + 1;
        let cell = at.map(|at| (at + 1.0).clamp(0.0, last as f64) as usize);
        let exit_m = |axis: usize| {
            let (cell, at, pitch_m) = (cell[axis], at[axis], pitch_m[axis]);
            if step[axis] > 0.0 && cell < last {
                along_m + (cell as f64 - at) * pitch_m
            } else if step[axis] < 0.0 && cell > 0 {
                along_m + ((cell - 1) as f64 - at) * pitch_m
            } else {
                f64::INFINITY
            }
        };
        Self {
            cell,
            last,
            exits_m: [exit_m(0), exit_m(1)],
            pitch_m: pitch_m.map(f64::abs),
            upwards: step.map(|step| step > 0.0),
        }
    }

    /// Distance at which the way leaves its cell.
    fn exit_m(&self) -> f64 {
        self.exits_m[0].min(self.exits_m[1])
    }

    /// On to the next cell.
    fn advance(&mut self) {
        let axis = usize::from(self.exits_m[1] < self.exits_m[0]);
        let cell = &mut self.cell[axis];
        *cell = if self.upwards[axis] {
            *cell + 1
        } else {
            cell.saturating_sub(1)
        };
        let is_outermost = *cell == 0 || *cell >= self.last;
        *cell = (*cell).min(self.last);
        self.exits_m[axis] += self.pitch_m[axis];
        if is_outermost {
            self.exits_m[axis] = f64::INFINITY;
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;
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
