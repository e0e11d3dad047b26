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

const SHADOW_REACH_M: f32 = 80.0;
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
        Self {
            view,
            sight: Sight::new(view),
            light: Light::new(&scene.look),
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
        let sun = &self.light.sun_direction;
        let outside = point + normal * CLEARANCE_M;
        let lit = self.light.sun.x > 0.01
            && normal.dot(sun) > 0.0
            && !self.view.rays.occluded(&outside, sun, SHADOW_REACH_M, None);
        if lit { 1.0 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use covista_traffic::{Scene, VehicleId, VehicleModel, sample_scene};
    use covista_world::{Calibration, ROW_ANCHORS, Se2Pose};

    use super::*;
    use crate::testing::{EGO, empty_road, vehicle};
    use crate::{RayScene, true_marks};

    fn with_view<T>(scene: &Scene, ego: VehicleId, look: impl FnOnce(&Viewpoint) -> T) -> T {
        let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
        look(&Viewpoint::new(scene, &rays, ego, &calibration).expect("the ego"))
    }

    fn radiance(scene: &Scene, ego: VehicleId, row: f64) -> Vec<Rgb> {
        with_view(scene, ego, |view| {
            let picture = Picture::new(view).radiance();
            picture.pixels[row as usize * 1242..][..1242].to_vec()
        })
    }

    #[test]
    fn edge_lines_are_painted_where_the_labels_are() {
        let mut scene = empty_road();
        scene.look.paint_wear = 0.0;
        let marks = with_view(&scene, EGO, true_marks);
        let mut compared = 0;
        for (anchor, v) in ROW_ANCHORS.iter().enumerate().map(|(i, row)| (i, row.0)) {
            let line = radiance(&scene, EGO, f64::from(v));
            for mark in [0, 3] {
                let Some(u) = marks.pixels[mark][anchor] else {
                    continue;
                };
                // Half as wide again as the paint, so that its ends are bare asphalt.
                let reach = 3 + (v as i32 - 172) / 14;
                let around = u.round() as i32 - reach..=u.round() as i32 + reach;
                if *around.start() < 0 || *around.end() >= line.len() as i32 {
                    continue;
                }
                let light = |i: i32| f64::from(line[i as usize].x);
                let bare = light(*around.start()).max(light(*around.end()));
                let weight = |i: i32| (light(i) - bare).max(0.0);
                let sum: f64 = around.clone().map(weight).sum();
                let center = around.map(|i| weight(i) * f64::from(i)).sum::<f64>() / sum;
                assert!(
                    (center - f64::from(u)).abs() < 0.6,
                    "{mark} {v}: {center} {u}"
                );
                compared += 1;
            }
        }
        assert!(compared > 25, "{compared}");
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
        let sample = sample_scene(3, 1);
        let on_threads = |count, seed| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
            pool.expect("a pool").install(|| {
                with_view(&sample.scene, sample.ego, |view| {
                    take_picture(view, &CameraSettings::default(), seed)
                })
            })
        };
        let picture = on_threads(1, 8);
        assert_eq!(picture.rgb.len(), 3 * 1242 * 375);
        assert!(picture == on_threads(2, 8));
        assert!(picture != on_threads(2, 9));
    }

    #[test]
    fn no_light_gives_a_colour_that_is_no_number() {
        for (index, (height, haze)) in [(0.0, 0.0), (-0.2, 0.01), (1.0, 0.0)].iter().enumerate() {
            let mut sample = sample_scene(4, index as u64);
            sample.scene.look.sun_direction = Vector3::new(0.3, 0.1, *height);
            sample.scene.look.haze_per_m = *haze;
            for row in [0, 150, 172, 173, 200, 374] {
                let line = radiance(&sample.scene, sample.ego, f64::from(row));
                let sane = |color: &Rgb| color.iter().all(|x| x.is_finite() && *x >= 0.0);
                assert!(line.iter().all(sane), "{index} {row}");
            }
        }
    }

    #[test]
    fn a_vehicle_ahead_throws_its_shadow_away_from_the_sun() {
        let mut scene = empty_road();
        scene.look.sun_direction = Vector3::new(0.0, -1.0, 1.0).normalize();
        let bare = radiance(&scene, EGO, 230.0);
        // The row sees the ground 20.8 m ahead of the camera.
        let pose = Se2Pose::new(20.7, 0.0, 0.0);
        scene
            .vehicles
            .push(vehicle(VehicleId(1), VehicleModel::Van, pose));
        let line = radiance(&scene, EGO, 230.0);
        let column = |left_m: f64| (609.56 - left_m * 721.54 / 20.83) as usize;
        let kept = |left_m: f64| line[column(left_m)].x / bare[column(left_m)].x;
        assert!(kept(2.2) < 0.6, "{}", kept(2.2));
        assert!((kept(-2.2) - 1.0).abs() < 1e-6 && (kept(5.0) - 1.0).abs() < 1e-6);
    }
}
