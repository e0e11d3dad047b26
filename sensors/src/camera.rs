use covista_traffic::{Material, Scene, SceneVehicle};
use covista_world::CameraImage;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;

use crate::appearance::{Light, Rgb};
use crate::caster::Hit;
use crate::exposure::{CameraSettings, Motion, Radiance};
use crate::ground::GroundRow;
use crate::noise::octaves;
use crate::pavement::Pavement;
use crate::shadow::{Contact, on_ground, shadow_line};
use crate::silhouette::Silhouette;
use crate::viewpoint::Viewpoint;

/// How far inside a crown a ray goes on that met a gap.
const INSIDE_M: f32 = 0.02;
const LEAVES_SEED: u32 = 0x1EAF;
const FAR_M: f32 = 600.0;
const SHADOW_REACH_M: f32 = 80.0;
/// The picture that the camera of `view` takes; `seed` is that of the sensor's noise.
pub fn take_picture(view: &Viewpoint, settings: &CameraSettings, seed: u64) -> CameraImage {
    let picture = Picture::new(view);
    let width = view.calibration.intrinsics.width_px as usize;
    let height = view.calibration.intrinsics.height_px as usize;
    let mut pixels = vec![Rgb::zeros(); width * height];
    let mut depth_m = vec![f32::INFINITY; width * height];
    pixels
        .par_chunks_mut(width.max(1))
        .zip(depth_m.par_chunks_mut(width.max(1)))
        .enumerate()
        .for_each(|(row, (line, depths_m))| picture.render_row(row as f64, line, depths_m));
    let radiance = Radiance {
        width,
        pixels,
        depth_m,
    };
    radiance.expose(gain(&picture.light), settings, &Motion::new(view), seed)
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
    world_from_camera: Isometry3<f64>,
    light: Light,
    pavement: Pavement,
    solids: Vec<Silhouette>,
    shadows: Vec<Silhouette>,
    contacts: Vec<(Silhouette, Contact)>,
}

impl<'a> Picture<'a> {
    fn new(view: &'a Viewpoint<'a>) -> Self {
        let scene = view.scene;
        let world_from_camera = view.world_from_camera();
        let camera_from_world = world_from_camera.inverse();
        let silhouette = |points: &[Point3<f64>]| {
            let seen: Vec<_> = points.iter().map(|p| camera_from_world * p).collect();
            Silhouette::new(&view.calibration.intrinsics, &seen)
        };
        let others = view.others().flat_map(|other| vehicle_parts(scene, other));
        let own = vehicle_parts(scene, view.ego);
        let still = scene.scenery.iter().flat_map(|body| &body.parts);
        let still = still.map(|part| part.vertices.clone());
        let parts: Vec<_> = others.chain(still).collect();
        let sun = &scene.look.sun_direction;
        let casts = scene.look.direct_light > 0.01 && sun.z > 0.0;
        let shadows = own
            .chain(parts.iter().cloned())
            .filter(|_| casts)
            .filter_map(|part| silhouette(&on_ground(&part, sun)));
        let contacts = scene.vehicles.iter().map(Contact::new);
        Self {
            view,
            world_from_camera,
            light: Light::new(&scene.look),
            pavement: Pavement::new(scene),
            shadows: shadows.collect(),
            solids: parts.iter().filter_map(|part| silhouette(part)).collect(),
            contacts: contacts
                .filter_map(|contact| Some((silhouette(&contact.corners())?, contact)))
                .collect(),
        }
    }

    fn render_row(&self, v: f64, line: &mut [Rgb], depths_m: &mut [f32]) {
        let intrinsics = &self.view.calibration.intrinsics;
        let road = &self.view.scene.road;
        let eye = Point3::from(self.world_from_camera.translation.vector).cast::<f32>();
        let solid = self.solid_pixels(v, line.len());
        let shadow = shadow_line(&self.shadows, v, line.len());
        let contacts: Vec<_> = self
            .contacts
            .iter()
            .filter_map(|(outline, contact)| Some((outline.span_within(v, 0.5)?, contact)))
            .collect();
        let ground = GroundRow::new(intrinsics, &self.world_from_camera, road, v);
        for (column, pixel) in line.iter_mut().enumerate() {
            let u = column as f64;
            let in_camera = intrinsics.ray(u, v).normalize();
            let forward = in_camera.z as f32;
            let ray = self.world_from_camera.rotation * in_camera;
            let to_ground_m = ground.distance_m(&ray).map(|distance| distance as f32);
            let ray = ray.cast::<f32>();
            let reach_m = to_ground_m.map_or(FAR_M, |distance| FAR_M.min(distance));
            let hit = solid[column].then(|| self.first_hit(&eye, &ray, reach_m));
            *pixel = if let Some(hit) = hit.flatten() {
                depths_m[column] = forward * hit.distance_m;
                let color = self.object(&hit, &(eye + ray * hit.distance_m), &ray);
                self.light.through_haze(color, hit.distance_m)
            } else if let (Some(distance_m), Some(patch)) =
                (to_ground_m, ground.patch(u, column, road))
            {
                depths_m[column] = forward * distance_m;
                let openness = contacts
                    .iter()
                    .filter(|((from, to), _)| (*from..=*to).contains(&u))
                    .map(|(_, contact)| contact.openness(patch.position))
                    .fold(1.0, f32::min);
                let sunlit = 1.0 - shadow[column];
                let color = self
                    .pavement
                    .radiance(&patch, &self.light, &ray, sunlit, openness);
                self.light.through_haze(color, distance_m)
            } else {
                self.light.sky(&ray)
            };
        }
    }

    fn object(&self, hit: &Hit, point: &Point3<f32>, ray: &Vector3<f32>) -> Rgb {
        let footprint_m = hit.distance_m / self.view.calibration.intrinsics.fx_px as f32;
        let sunlit = self.sunlit(point, &hit.normal);
        self.light
            .surface(hit.material, point, &hit.normal, ray, sunlit, footprint_m)
    }

    /// The first surface along the ray; crowns have gaps between their leaves.
    fn first_hit(&self, eye: &Point3<f32>, direction: &Vector3<f32>, reach_m: f32) -> Option<Hit> {
        let Viewpoint { rays, ego, .. } = *self.view;
        let hit = rays.cast(eye, direction, reach_m, Some(ego.id))?;
        let point = eye + direction * hit.distance_m;
        if hit.material != Material::Foliage || !is_leaf_gap(&point, &hit.normal, direction) {
            return Some(hit);
        }
        // A ray that starts inside a part looks through it.
        let passed_m = hit.distance_m + INSIDE_M;
        let inside = eye + direction * passed_m;
        let behind = rays.cast(&inside, direction, reach_m - passed_m, Some(ego.id))?;
        Some(Hit {
            distance_m: behind.distance_m + passed_m,
            ..behind
        })
    }

    /// Which pixels of the row may show a vehicle or scenery.
    fn solid_pixels(&self, v: f64, width: usize) -> Vec<bool> {
        let mut solid = vec![false; width];
        for (from, to) in self
            .solids
            .iter()
            .filter_map(|hull| hull.span_within(v, 0.5))
        {
            let (first, end) = (from.max(0.0) as usize, (to + 1.0).max(0.0) as usize);
            let end = end.min(width);
            if let Some(run) = solid.get_mut(first.min(end)..end) {
                run.fill(true);
            }
        }
        solid
    }

    fn sunlit(&self, point: &Point3<f32>, normal: &Vector3<f32>) -> f32 {
        let sun = &self.light.sun_direction;
        let lit = self.light.sun.x > 0.01
            && normal.dot(sun) > 0.0
            && !self
                .view
                .rays
                .occluded(&(point + normal * 0.02), sun, SHADOW_REACH_M, None);
        if lit { 1.0 } else { 0.0 }
    }
}

/// Whether one looks between the leaves here, as one does most at the rim of a crown.
fn is_leaf_gap(point: &Point3<f32>, normal: &Vector3<f32>, direction: &Vector3<f32>) -> bool {
    let p = point.cast::<f64>();
    let bands = [(0.9, 0.5), (0.35, 0.4), (0.12, 0.3)];
    let thickness = octaves(LEAVES_SEED, p.x + 0.7 * p.y, p.z - 0.4 * p.y, 0.01, &bands);
    thickness > 0.9 * normal.dot(direction).abs() - 0.15
}

/// The convex parts of a vehicle in the world frame.
fn vehicle_parts(scene: &Scene, vehicle: &SceneVehicle) -> impl Iterator<Item = Vec<Point3<f64>>> {
    let pose = scene.placed(vehicle);
    let in_world =
        move |p: &Point3<f64>| pose * Point3::from(p.coords.component_mul(&vehicle.scale));
    let parts = vehicle.model.body().parts.iter();
    parts.map(move |part| part.vertices.iter().map(in_world).collect())
}

#[cfg(test)]
mod tests {
    use covista_traffic::{VehicleId, VehicleModel, sample_scene};
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
            let mut line = vec![Rgb::zeros(); 1242];
            Picture::new(view).render_row(row, &mut line, &mut vec![0.0; 1242]);
            line
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
