use covista_world::{CameraIntrinsics, FrenetPoint, Road};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};

use crate::pavement::GroundPatch;

const STEP_PX: usize = 16;
const HORIZON_M: f64 = 3000.0;

/// The ground along one image row, in road coordinates.
///
/// These are computed every few pixels and interpolated: over so short a chord even a sharp turn
/// bends by centimetres at most.
pub(crate) struct GroundRow {
    eye: Point3<f64>,
    nodes: Vec<Option<Node>>,
    center_px: f64,
    below_horizon_px: f64,
    focal_px: f64,
}

#[derive(Clone, Copy)]
struct Node {
    position: Vector2<f64>,
    frenet: FrenetPoint,
}

impl GroundRow {
    /// Prepares row `v` of a level camera.
    pub(crate) fn new(
        intrinsics: &CameraIntrinsics,
        world_from_camera: &Isometry3<f64>,
        road: &Road,
        v: f64,
    ) -> Self {
        let mut row = Self {
            eye: Point3::from(world_from_camera.translation.vector),
            nodes: Vec::new(),
            center_px: intrinsics.cx_px,
            below_horizon_px: v - intrinsics.cy_px,
            focal_px: intrinsics.fx_px,
        };
        let count = intrinsics.width_px as usize / STEP_PX + 2;
        row.nodes = (0..count)
            .map(|i| {
                let ray = intrinsics.ray((i * STEP_PX) as f64, v);
                let direction = world_from_camera.rotation * ray.normalize();
                let distance_m = row.distance_m(&direction)?;
                let position = (row.eye + direction * distance_m).xy().coords;
                Some(Node {
                    position,
                    frenet: road.to_frenet(position),
                })
            })
            .collect();
        row
    }

    /// Distance to the ground along a unit vector, where there is ground.
    pub(crate) fn distance_m(&self, direction: &Vector3<f64>) -> Option<f64> {
        let distance_m = -self.eye.z / direction.z;
        (direction.z < 0.0 && distance_m < HORIZON_M).then_some(distance_m)
    }

    /// What the pixel in `column` at `u` sees of the ground.
    pub(crate) fn patch(&self, u: f64, column: usize, road: &Road) -> Option<GroundPatch> {
        let index = column / STEP_PX;
        let (a, b) = (
            self.nodes.get(index).copied()??,
            self.nodes.get(index + 1).copied()??,
        );
        let share = (column - index * STEP_PX) as f64 / STEP_PX as f64;
        let position = a.position.lerp(&b.position, share);
        let span_m = (b.position - a.position).norm();
        let along = Vector2::new(b.frenet.s_m - a.frenet.s_m, b.frenet.d_m - a.frenet.d_m);
        let FrenetPoint { s_m, d_m } = if along.norm() < 3.0 * span_m {
            FrenetPoint {
                s_m: a.frenet.s_m + share * along.x,
                d_m: a.frenet.d_m + share * along.y,
            }
        } else {
            // The nearest point of the road jumps in between.
            road.to_frenet(position)
        };
        // A step of one pixel to the right, and one of one row up, on the ground.
        let right = along.try_normalize(1e-12).unwrap_or(-Vector2::y()) * (span_m / STEP_PX as f64);
        let ahead = Vector2::new(-right.y, right.x);
        let off_axis = (u - self.center_px) / self.focal_px;
        let up = (right * off_axis + ahead) * (self.focal_px / self.below_horizon_px);
        Some(GroundPatch {
            position,
            s_m,
            d_m,
            spread_s_m: right.x.hypot(up.x),
            spread_d_m: right.y.hypot(up.y),
        })
    }
}
