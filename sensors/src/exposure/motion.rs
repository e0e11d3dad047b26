use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::Radiance;
use crate::Viewpoint;
use crate::appearance::Rgb;

/// Shorter movements leave the pixel as it is.
const LEAST_PX: f32 = 0.5;
const MOST_TAPS: usize = 8;

/// How a camera moves through a world that stands still.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Motion {
    /// In the camera frame: to the right, down, ahead.
    velocity_mps: Vector3<f32>,
    focal_px: Vector2<f32>,
    center_px: Vector2<f32>,
}

impl Motion {
    pub(crate) fn new(view: &Viewpoint) -> Self {
        let camera = &view.calibration.intrinsics;
        let forward = Vector3::x() * view.ego.state.speed_mps;
        let camera_from_vehicle = view.calibration.vehicle_from_camera.rotation.inverse();
        Self {
            velocity_mps: (camera_from_vehicle * forward).cast(),
            focal_px: Vector2::new(camera.fx_px, camera.fy_px).cast(),
            center_px: Vector2::new(camera.cx_px, camera.cy_px).cast(),
        }
    }

    /// How far the picture of a point at this depth moves in `time_s`, in pixels.
    fn shift_px(&self, u: f32, v: f32, depth_m: f32, time_s: f32) -> Vector2<f32> {
        let moved = self.velocity_mps * (time_s / depth_m.max(0.1));
        let from_center = Vector2::new(u, v) - self.center_px;
        from_center * moved.z - moved.xy().component_mul(&self.focal_px)
    }
}

impl Radiance {
    /// The pixels as the moving camera sees them in `time_s`.
    pub(super) fn blurred(&self, motion: &Motion, time_s: f32) -> Vec<Rgb> {
        let mut blurred = vec![Rgb::zeros(); self.pixels.len()];
        let lines = blurred.par_chunks_mut(self.width.max(1)).enumerate();
        lines.for_each(|(row, line)| {
            for (column, pixel) in line.iter_mut().enumerate() {
                *pixel = self.moved(row, column, motion, time_s);
            }
        });
        blurred
    }

    /// Mean of the pixels that pass by this one.
    fn moved(&self, row: usize, column: usize, motion: &Motion, time_s: f32) -> Rgb {
        let here = row * self.width + column;
        let depth_m = self.depth_m.get(here).copied().unwrap_or(f32::INFINITY);
        let shift = motion.shift_px(column as f32, row as f32, depth_m, time_s);
        let length_px = shift.amax();
        if length_px.is_nan() || length_px <= LEAST_PX {
            return self.pixels[here];
        }
        let taps = (length_px as usize + 2).min(MOST_TAPS);
        let mut sum = Rgb::zeros();
        for tap in 0..taps {
            let along = (tap as f32 + 0.5) / taps as f32 - 0.5;
            let at =
                |start: usize, step: f32| (start as f32 + along * step + 0.5).max(0.0) as usize;
            let x = at(column, shift.x).min(self.width - 1);
            let y = at(row, shift.y).min(self.height() - 1);
            sum += self.pixels[y * self.width + x];
        }
        sum / taps as f32
    }
}
