use covista_world::CameraIntrinsics;
use nalgebra::{Isometry3, Point3, Vector3};

/// The rays through an image's pixels, in the world frame.
///
/// They are not normalised: a ray times a depth along the optical axis leads from the eye to the
/// point at that depth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelRays {
    pub(crate) eye: Point3<f64>,
    corner: Vector3<f64>,
    right: Vector3<f64>,
    down: Vector3<f64>,
}

impl PixelRays {
    pub(crate) fn new(intrinsics: &CameraIntrinsics, world_from_camera: &Isometry3<f64>) -> Self {
        let through = |u: f64, v: f64| world_from_camera.rotation * intrinsics.ray(u, v);
        let corner = through(0.0, 0.0);
        Self {
            eye: Point3::from(world_from_camera.translation.vector),
            corner,
            right: through(1.0, 0.0) - corner,
            down: through(0.0, 1.0) - corner,
        }
    }

    /// The ray through pixel (u, v).
    pub(crate) fn ray(&self, u: f64, v: f64) -> Vector3<f64> {
        self.corner + self.right * u + self.down * v
    }

    /// How the ray changes from one pixel to the next to the right, and to the one below.
    pub(crate) fn steps(&self) -> [Vector3<f64>; 2] {
        [self.right, self.down]
    }

    /// The point at a depth along the ray through (u, v).
    pub(crate) fn point(&self, u: f64, v: f64, depth_m: f64) -> Point3<f64> {
        self.eye + self.ray(u, v) * depth_m
    }

    /// The reciprocal of the depth at which the ray through (u, v) meets the plane
    /// `normal . (p - anchor) = offset_m`, as the factors of u, v and 1, and how far the eye is
    /// below the plane; `None` where it lies in it.
    pub(crate) fn nearness_of_plane(
        &self,
        normal: &Vector3<f64>,
        anchor: &Point3<f64>,
        offset_m: f64,
    ) -> Option<([f64; 3], f64)> {
        let gap_m = offset_m - normal.dot(&(self.eye - anchor));
        let along = [self.right, self.down, self.corner].map(|step| normal.dot(&step) / gap_m);
        along
            .iter()
            .all(|x| x.is_finite())
            .then_some((along, gap_m))
    }
}
