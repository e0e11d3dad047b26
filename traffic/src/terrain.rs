mod blocks;
mod ray;

use covista_world::{Se2Pose, VehicleDimensions};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};

use self::blocks::Blocks;

/// Height of the ground above the plane z = 0, in the world frame.
///
/// Flat, or bilinear between the nodes of a square grid; beyond the grid the ground goes on at the
/// height of the nearest node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Terrain {
    grid: Option<Grid>,
}

#[derive(Debug, Clone, PartialEq)]
struct Grid {
    corner: Vector2<f64>,
    spacing_m: f64,
    nodes_per_side: usize,
    heights_m: Vec<f32>,
    steepest: f64,
    blocks: Blocks,
}

impl Terrain {
    /// The plane z = 0.
    pub const FLAT: Self = Self { grid: None };

    /// The ground about `center`, `reach_m` to each side, with nodes every `spacing_m` at
    /// `height_m`.
    pub fn sampled(
        center: Vector2<f64>,
        reach_m: f64,
        spacing_m: f64,
        mut height_m: impl FnMut(Vector2<f64>) -> f64,
    ) -> Self {
        let cells_to_a_side = (reach_m / spacing_m).ceil().max(1.0);
        let corner = center.add_scalar(-cells_to_a_side * spacing_m);
        let nodes_per_side = 2 * cells_to_a_side as usize + 1;
        let node = |index: usize| {
            let (column, row) = (index % nodes_per_side, index / nodes_per_side);
            corner + Vector2::new(column as f64, row as f64) * spacing_m
        };
        let heights_m: Vec<f32> = (0..nodes_per_side * nodes_per_side)
            .map(|index| height_m(node(index)) as f32)
            .collect();
        let rise = |a: usize, b: usize| f64::from((heights_m[a] - heights_m[b]).abs());
        let steepest = (0..heights_m.len())
            .map(|index| {
                let last_column = index % nodes_per_side + 1 == nodes_per_side;
                let last_row = index + nodes_per_side >= heights_m.len();
                let right = if last_column {
                    0.0
                } else {
                    rise(index, index + 1)
                };
                let up = if last_row {
                    0.0
                } else {
                    rise(index, index + nodes_per_side)
                };
                (right, up)
            })
            .fold((0.0_f64, 0.0_f64), |(x, y), (right, up)| {
                (x.max(right), y.max(up))
            });
        let steepest = steepest.0.hypot(steepest.1) / spacing_m;
        Self {
            grid: Some(Grid {
                corner,
                spacing_m,
                nodes_per_side,
                blocks: Blocks::new(&heights_m, nodes_per_side),
                heights_m,
                steepest,
            }),
        }
    }

    /// Whether the ground is the plane z = 0.
    pub fn is_flat(&self) -> bool {
        self.grid.is_none()
    }

    /// Height of the ground in metres at a position in the world.
    pub fn height_m(&self, position: Vector2<f64>) -> f64 {
        self.grid
            .as_ref()
            .map_or(0.0, |grid| grid.height_m(position))
    }

    /// A bound on the ground's slope: no two points differ in height by more than this times
    /// their horizontal distance.
    pub fn steepest(&self) -> f64 {
        self.grid.as_ref().map_or(0.0, |grid| grid.steepest)
    }

    /// Vehicle frame to world frame of a vehicle that stands on the ground: its axes' heights and
    /// its tilt from the ground below its four wheels.
    pub fn place(&self, rear_axle: Se2Pose, dimensions: VehicleDimensions) -> Isometry3<f64> {
        if self.is_flat() {
            return rear_axle.to_isometry();
        }
        let half_track_m = dimensions.width_m / 2.0;
        let height = |x: f64, y: f64| self.height_m(rear_axle.transform(Vector2::new(x, y)));
        let wheels = |x: f64| [height(x, half_track_m), height(x, -half_track_m)];
        let ([rear_left, rear_right], [front_left, front_right]) =
            (wheels(0.0), wheels(dimensions.wheelbase_m));
        let (rear_m, front_m) = (
            (rear_left + rear_right) / 2.0,
            (front_left + front_right) / 2.0,
        );
        let climb = (front_m - rear_m) / dimensions.wheelbase_m;
        let bank = (rear_left + front_left - rear_right - front_right) / (4.0 * half_track_m);
        let forward = Vector3::new(1.0, 0.0, climb).normalize();
        let up = forward.cross(&Vector3::new(0.0, 1.0, bank)).normalize();
        let tilt = Rotation3::from_basis_unchecked(&[forward, up.cross(&forward), up]);
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rear_axle.yaw_rad);
        Isometry3::from_parts(
            Translation3::new(rear_axle.x_m, rear_axle.y_m, rear_m),
            heading * UnitQuaternion::from_rotation_matrix(&tilt),
        )
    }
}

impl Grid {
    fn height_m(&self, position: Vector2<f64>) -> f64 {
        let last = (self.nodes_per_side - 1) as f64;
        let at = (position - self.corner) / self.spacing_m;
        let (x, y) = (at.x.clamp(0.0, last), at.y.clamp(0.0, last));
        let (column, row) = (
            (x as usize).min(self.nodes_per_side - 2),
            (y as usize).min(self.nodes_per_side - 2),
        );
        let (x, y) = (x - column as f64, y - row as f64);
        let node = |dx: usize, dy: usize| {
            f64::from(self.heights_m[(row + dy) * self.nodes_per_side + column + dx])
        };
        let lower = node(0, 0) + x * (node(1, 0) - node(0, 0));
        let upper = node(0, 1) + x * (node(1, 1) - node(0, 1));
        lower + y * (upper - lower)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VehicleModel;

    fn slope() -> Terrain {
        Terrain::sampled(Vector2::new(10.0, -5.0), 60.0, 4.0, |p| {
            0.05 * p.x - 0.02 * p.y
        })
    }

    #[test]
    fn a_plane_is_met_exactly_and_its_slope_is_known() {
        let terrain = slope();
        for (x, y) in [(0.0, 0.0), (13.3, -7.7), (-31.0, 22.0)] {
            let height_m = terrain.height_m(Vector2::new(x, y));
            assert!((height_m - (0.05 * x - 0.02 * y)).abs() < 1e-6);
        }
        assert!((terrain.steepest() - 0.05_f64.hypot(0.02)).abs() < 1e-5);
        let far_m = terrain.height_m(Vector2::new(1e4, -5.0));
        assert!((far_m - (0.05 * 70.0 + 0.1)).abs() < 1e-5);
    }

    #[test]
    fn a_vehicle_stands_on_its_wheels() {
        let (terrain, size) = (slope(), VehicleModel::Sedan.dimensions());
        let pose = Se2Pose::new(4.0, 3.0, 0.8);
        let placed = terrain.place(pose, size);
        for (x, y) in [(0.0, 0.9), (0.0, -0.9), (2.51, 0.9), (2.51, -0.9)] {
            let wheel = placed * nalgebra::Point3::new(x, y, 0.0);
            let ground_m = terrain.height_m(wheel.xy().coords);
            assert!((wheel.z - ground_m).abs() < 5e-3, "{wheel} {ground_m}");
        }
        assert_eq!(Terrain::FLAT.place(pose, size), pose.to_isometry());
    }
}
