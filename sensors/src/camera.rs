use covista_world::CameraImage;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::Viewpoint;
use crate::appearance::{Light, Rgb};
use crate::exposure::{CameraSettings, Motion, Radiance};
use crate::pavement::Pavement;
use crate::shadow::{Contact, ShadowRow, ShadowSpan, on_ground, shaded_share};
use crate::sight::{Run, Seen, Sight};
use crate::silhouette::Silhouette;
use crate::solids::Face;
use crate::sunlight::Sunlight;

/// A ray to the sun starts this far before the surface.
const CLEARANCE_M: f32 = 0.02;

/// The picture that the camera of `view` takes; `seed` is that of the sensor's noise.
pub fn take_picture(view: &Viewpoint, settings: &CameraSettings, seed: u64) -> CameraImage {
    let picture = Picture::new(view);
    let gain = gain(&picture.light);
    picture
        .radiance()
        .expose(gain, settings, &Motion::new(view), seed)
}

/// Automatic exposure for the open road, and half of what would make it grey.
fn gain(light: &Light) -> Rgb {
    let open = light.open_ground();
    let mean = (open.sum() / 3.0).max(0.05);
    open.map(|channel| 0.9 / mean * (mean / channel.max(0.02)).sqrt())
}

/// A scene made ready for one picture.
struct Picture<'a> {
    view: &'a Viewpoint<'a>,
    sight: Sight<'a>,
    light: Light,
    /// Absent where the sun does not shine.
    sunlight: Option<Sunlight<'a>>,
    pavement: Pavement,
    shadows: Vec<Silhouette>,
    contacts: Vec<(Silhouette, Contact)>,
}

/// What darkens the ground along one row.
struct Dark<'p> {
    shadows: ShadowRow,
    contacts: Vec<([f64; 2], &'p Contact)>,
}

impl<'a> Picture<'a> {
    fn new(view: &'a Viewpoint<'a>) -> Self {
        let Viewpoint { scene, rays, .. } = *view;
        let camera_from_world = view.world_from_camera().inverse();
        let silhouette = |points: &[Point3<f64>]| {
            let seen: Vec<_> = points.iter().map(|p| camera_from_world * p).collect();
            Silhouette::new(&view.calibration.intrinsics, &seen)
        };
        let sun = &scene.look.sun_direction;
        let casts = scene.look.direct_light > 0.01 && sun.z > 0.0;
        let shadows = rays
            .solids()
            .filter(|_| casts)
            .filter_map(|solid| silhouette(&on_ground(&scene.terrain, solid.vertices, sun)));
        let contacts = scene
            .vehicles
            .iter()
            .map(Contact::new)
            .filter_map(|contact| Some((silhouette(&contact.corners(&scene.terrain))?, contact)));
        let light = Light::new(&scene.look);
        Self {
            view,
            sight: Sight::new(view),
            sunlight: (light.sun.x > 0.01).then(|| Sunlight::new(rays, &light.sun_direction)),
            light,
            pavement: Pavement::new(scene),
            shadows: shadows.collect(),
            contacts: contacts.collect(),
        }
    }

    fn radiance(&self) -> Radiance {
        let intrinsics = &self.view.calibration.intrinsics;
        let width = intrinsics.width_px as usize;
        let count = width * intrinsics.height_px as usize;
        let (mut pixels, mut depth_m) = (vec![Rgb::zeros(); count], vec![f32::INFINITY; count]);
        let band_len = (width * Sight::BAND_ROWS).max(1);
        pixels
            .par_chunks_mut(band_len)
            .zip(depth_m.par_chunks_mut(band_len))
            .enumerate()
            .for_each(|(band, (pixels, depth_m))| self.paint_band(band, pixels, depth_m));
        Radiance {
            width,
            pixels,
            depth_m,
        }
    }

    fn paint_band(&self, band: usize, pixels: &mut [Rgb], depth_m: &mut [f32]) {
        let width = self.view.calibration.intrinsics.width_px as usize;
        let first_row = band * Sight::BAND_ROWS;
        let last_row = first_row + pixels.len() / width - 1;
        let shadows: Vec<_> = self
            .shadows
            .iter()
            .filter(|shadow| shadow.reaches(first_row as f64 - 0.5, last_row as f64 + 0.5))
            .collect();
        let dark: Vec<_> = (first_row..=last_row)
            .map(|row| self.dark(row as f64, &shadows))
            .collect();
        let mut spans = Vec::new();
        self.sight.look(band, |run| {
            let row = run.row - first_row;
            let start = row * width + run.column;
            let place = start..start + run.len;
            for (depth_m, seen) in depth_m[place.clone()].iter_mut().zip(&run.seen) {
                *depth_m = seen.depth_m();
            }
            self.paint_run(run, &dark[row], &mut spans, &mut pixels[place]);
        });
    }

    fn dark(&self, v: f64, shadows: &[&Silhouette]) -> Dark<'_> {
        let contacts = self.contacts.iter().filter_map(|(outline, contact)| {
            let (from, to) = outline.span_within(v, 0.5)?;
            Some(([from, to], contact))
        });
        Dark {
            shadows: ShadowRow::new(shadows, v),
            contacts: contacts.collect(),
        }
    }

    fn paint_run(&self, run: &Run, dark: &Dark, spans: &mut Vec<ShadowSpan>, line: &mut [Rgb]) {
        dark.shadows.among(run.column, run.column + run.len, spans);
        for (column, (pixel, seen)) in (run.column..).zip(line.iter_mut().zip(&run.seen)) {
            let u = column as f64;
            let ray = self.sight.rays.ray(u, run.row as f64).cast::<f32>();
            let length = ray.norm();
            let direction = ray / length;
            *pixel = match seen {
                Seen::Sky => self.light.sky(&direction),
                Seen::Ground(ground) => {
                    let depth_m = ground.depth_m as f32;
                    let shaded = shaded_share(spans, u as f32, depth_m);
                    let position = ground.patch.position;
                    let openness = dark
                        .contacts
                        .iter()
                        .filter(|([from, to], _)| (*from..=*to).contains(&u))
                        .map(|(_, contact)| contact.openness(position))
                        .fold(1.0, f32::min);
                    let color = self.pavement.radiance(
                        &ground.patch,
                        &self.light,
                        &direction,
                        1.0 - shaded,
                        openness,
                    );
                    self.light.through_haze(color, depth_m * length)
                }
                Seen::Solid(face, depth_m) => {
                    let point = self.sight.rays.eye.cast::<f32>() + ray * *depth_m;
                    let color = self.solid(face, &point, &direction, *depth_m);
                    self.light.through_haze(color, depth_m * length)
                }
            };
        }
    }

    fn solid(&self, face: &Face, point: &Point3<f32>, ray: &Vector3<f32>, depth_m: f32) -> Rgb {
        let footprint_m = depth_m / self.view.calibration.intrinsics.fx_px as f32;
        let sunlit = self.sunlit(point, &face.normal);
        self.light
            .surface(face.material, point, &face.normal, ray, sunlit, footprint_m)
    }

    fn sunlit(&self, point: &Point3<f32>, normal: &Vector3<f32>) -> f32 {
        let outside = point + normal * CLEARANCE_M;
        let lit = normal.dot(&self.light.sun_direction) > 0.0
            && self
                .sunlight
                .as_ref()
                .is_some_and(|sunlight| !sunlight.is_shaded(&outside));
        if lit { 1.0 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests;
