use covista_traffic::{Material, Scene, SceneVehicle, VehicleId};
use covista_world::{CameraImage, Se2Pose};
use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use rayon::prelude::*;

use crate::appearance::{Light, Rgb};
use crate::caster::Hit;
use crate::exposure::Radiance;
use crate::ground::GroundRow;
use crate::noise::{octaves, uniform};
use crate::pavement::Pavement;
use crate::silhouette::Silhouette;
use crate::viewpoint::Viewpoint;

/// How far inside a crown a ray goes on that met a gap.
const INSIDE_M: f32 = 0.02;
const LEAVES_SEED: u32 = 0x1EAF;
const FAR_M: f32 = 600.0;
const SHADOW_REACH_M: f32 = 80.0;
/// The lowest sun whose shadows are drawn at full length.
const LOWEST_SUN: f64 = 0.1;
/// How far from a vehicle the ground is visibly darker.
const CONTACT_REACH_M: f64 = 1.0;
/// Image rows between the rows of a pixel at which the edges of shadows are sampled.
const SUB_ROWS: [f64; 3] = [-0.33, 0.0, 0.33];

/// The picture that the camera of `view` takes; `seed` is that of the sensor's noise.
pub fn take_picture(view: &Viewpoint, seed: u64) -> CameraImage {
    let picture = Picture::new(view);
    let width = view.calibration.intrinsics.width_px as usize;
    let height = view.calibration.intrinsics.height_px as usize;
    let mut pixels = vec![Rgb::zeros(); width * height];
    pixels
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(row, line)| picture.render_row(row as f64, line));
    let gain = gain(&picture.light, view.scene.look.texture_seed);
    Radiance { width, pixels }.expose(gain, seed)
}

/// Exposure and white balance: set for the open road, a little off as automatics are.
fn gain(light: &Light, texture_seed: u64) -> Rgb {
    let open = light.open_ground().sum() / 3.0;
    let draw = |index: i32| uniform(texture_seed as u32 ^ 0xE4B0, index, 3) - 0.5;
    let balance = Rgb::new(
        1.0 + 0.10 * draw(1),
        1.0,
        1.0 - 0.10 * draw(1) + 0.05 * draw(2),
    );
    balance * (0.9 * (0.7 * draw(0)).exp2() / open.max(0.05))
}

/// A scene made ready for one picture.
struct Picture<'a> {
    view: &'a Viewpoint<'a>,
    world_from_camera: Isometry3<f64>,
    light: Light,
    pavement: Pavement,
    solids: Vec<Silhouette>,
    shadows: Vec<Silhouette>,
    contacts: Vec<Contact>,
}

/// The darker ground about a vehicle.
struct Contact {
    hull: Silhouette,
    center: Se2Pose,
    half_size_m: Vector2<f64>,
}

impl<'a> Picture<'a> {
    fn new(view: &'a Viewpoint<'a>) -> Self {
        let (scene, ego) = (view.scene, view.ego.id);
        let intrinsics = view.calibration.intrinsics;
        let world_from_camera = view.world_from_camera();
        let camera_from_world = world_from_camera.inverse();
        let silhouette_of = |points: &[Point3<f64>]| {
            let seen: Vec<_> = points.iter().map(|p| camera_from_world * p).collect();
            Silhouette::new(&intrinsics, &seen)
        };
        let parts: Vec<(bool, Vec<Point3<f64>>)> = world_parts(scene, ego).collect();
        let solids = parts
            .iter()
            .filter(|(is_ego, _)| !is_ego)
            .filter_map(|(_, part)| silhouette_of(part))
            .collect();
        let sun = scene.look.sun_direction;
        let casts = scene.look.direct_light > 0.01 && sun.z > 0.0;
        let on_ground = |p: &Point3<f64>| p - sun * (p.z.max(0.0) / sun.z.max(LOWEST_SUN));
        let shadows = parts
            .iter()
            .filter(|_| casts)
            .filter_map(|(_, part)| silhouette_of(&part.iter().map(on_ground).collect::<Vec<_>>()))
            .collect();
        let contacts = scene
            .vehicles
            .iter()
            .filter_map(|vehicle| {
                let (center, half_size_m, corners) = contact_patch(vehicle);
                silhouette_of(&corners).map(|hull| Contact {
                    hull,
                    center,
                    half_size_m,
                })
            })
            .collect();
        Self {
            view,
            world_from_camera,
            light: Light::new(&scene.look),
            pavement: Pavement::new(&scene.road, &scene.look),
            solids,
            shadows,
            contacts,
        }
    }

    fn render_row(&self, v: f64, line: &mut [Rgb]) {
        let Viewpoint {
            scene,
            rays,
            ego,
            calibration,
        } = *self.view;
        let intrinsics = calibration.intrinsics;
        let eye = Point3::from(self.world_from_camera.translation.vector);
        let eye32 = eye.cast::<f32>();
        let solid = self.solid_pixels(v, line.len());
        let shadow = self.shadow_line(v, line.len());
        let contacts: Vec<_> = self
            .contacts
            .iter()
            .filter_map(|contact| contact.hull.span_within(v, 0.5).map(|span| (span, contact)))
            .collect();
        let ground = GroundRow::new(&intrinsics, &self.world_from_camera, &scene.road, v);
        for (column, pixel) in line.iter_mut().enumerate() {
            let u = column as f64;
            let direction = self.world_from_camera.rotation * intrinsics.ray(u, v).normalize();
            let direction32 = direction.cast::<f32>();
            let to_ground_m = ground.distance_m(&direction);
            let reach_m = to_ground_m.map_or(FAR_M, |distance| FAR_M.min(distance as f32));
            let hit = solid[column]
                .then(|| self.first_hit(&eye32, &direction32, reach_m))
                .flatten();
            *pixel = if let Some(hit) = hit {
                let point = eye32 + direction32 * hit.distance_m;
                let footprint_m = hit.distance_m / intrinsics.fx_px as f32;
                let sunlit = self.sunlit(&point, &hit.normal);
                let color = self.light.surface(
                    hit.material,
                    &point,
                    &hit.normal,
                    &direction32,
                    sunlit,
                    footprint_m,
                );
                self.light.through_haze(color, hit.distance_m)
            } else if let (Some(distance_m), Some(patch)) =
                (to_ground_m, ground.patch(u, column, &scene.road))
            {
                let dark = contacts
                    .iter()
                    .filter(|((from, to), _)| u >= *from && u <= *to)
                    .map(|(_, contact)| contact.openness(patch.position))
                    .fold(1.0, f32::min);
                let light = self.light.sun * (self.light.sun_direction.z * (1.0 - shadow[column]))
                    + self.light.sky * dark;
                let color = self.pavement.albedo(&patch).component_mul(&light);
                self.light.through_haze(color, distance_m as f32)
            } else {
                self.light.sky(&direction32)
            };
        }
    }

    /// The first surface along the ray; crowns have gaps between their leaves.
    fn first_hit(
        &self,
        eye: &Point3<f32>,
        direction: &Vector3<f32>,
        reach_m: f32,
    ) -> Option<Hit> {
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

    /// Share of each pixel of the row that lies in shadow, were it ground.
    fn shadow_line(&self, v: f64, width: usize) -> Vec<f32> {
        let mut line = vec![0.0; width];
        let mut sub_row = vec![0.0_f32; width];
        for offset in SUB_ROWS {
            sub_row.fill(0.0);
            for (from, to) in self.shadows.iter().filter_map(|hull| hull.span(v + offset)) {
                let first = (from - 0.5).max(0.0) as usize;
                let end = ((to + 1.5).max(0.0) as usize).min(width);
                for (column, share) in sub_row.iter_mut().enumerate().take(end).skip(first) {
                    let u = column as f64;
                    let overlap = to.min(u + 0.5) - from.max(u - 0.5);
                    *share += overlap.clamp(0.0, 1.0) as f32;
                }
            }
            for (sum, share) in line.iter_mut().zip(&sub_row) {
                *sum += share.min(1.0) / SUB_ROWS.len() as f32;
            }
        }
        line
    }

    fn sunlit(&self, point: &Point3<f32>, normal: &Vector3<f32>) -> f32 {
        let sun = &self.light.sun_direction;
        let lit = self.light.sun.x > 0.01
            && normal.dot(sun) > 0.0
            && !self.view.rays.occluded(&(point + normal * 0.02), sun, SHADOW_REACH_M, None);
        if lit { 1.0 } else { 0.0 }
    }
}

/// Whether one looks between the leaves here, as one does most at the rim of a crown.
fn is_leaf_gap(point: &Point3<f32>, normal: &Vector3<f32>, direction: &Vector3<f32>) -> bool {
    let p = point.cast::<f64>();
    let bands = [(0.9, 0.5), (0.35, 0.4), (0.12, 0.3)];
    let thickness = octaves(LEAVES_SEED, p.x + 0.7 * p.y, p.z - 0.4 * p.y, 0.01, &bands);
    thickness > 0.15 + 1.2 * normal.dot(direction).abs()
}

impl Contact {
    /// Share of the sky that the ground at `position` sees.
    fn openness(&self, position: Vector2<f64>) -> f32 {
        let local = self.center.inverse_transform(position);
        let outside = (local.abs() - self.half_size_m)
            .sup(&Vector2::zeros())
            .norm();
        let inside = (self.half_size_m - local.abs()).min().clamp(0.0, 0.5);
        let fade = (1.0 - outside / CONTACT_REACH_M).max(0.0);
        (1.0 - 0.6 * fade * fade - 0.7 * inside) as f32
    }
}

/// All convex parts of the scene in the world frame, with whether they are the ego vehicle's.
fn world_parts(scene: &Scene, ego: VehicleId) -> impl Iterator<Item = (bool, Vec<Point3<f64>>)> {
    let vehicles = scene.vehicles.iter().flat_map(move |vehicle| {
        let pose = vehicle.state.pose.to_isometry();
        vehicle.model.body().parts.iter().map(move |part| {
            let vertices = part.vertices.iter().map(|p| pose * p).collect();
            (vehicle.id == ego, vertices)
        })
    });
    let scenery = scene
        .scenery
        .iter()
        .flat_map(|body| &body.parts)
        .map(|part| (false, part.vertices.clone()));
    vehicles.chain(scenery)
}

/// A vehicle's centre, half its size, and the corners of the ground about it in the world.
fn contact_patch(vehicle: &SceneVehicle) -> (Se2Pose, Vector2<f64>, [Point3<f64>; 4]) {
    let dimensions = vehicle.dimensions();
    let center = dimensions.center_pose(vehicle.state.pose);
    let half = Vector2::new(dimensions.length_m, dimensions.width_m) / 2.0;
    let reach = half.add_scalar(CONTACT_REACH_M);
    let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)].map(|(x, y)| {
        let corner = center.transform(Vector2::new(x * reach.x, y * reach.y));
        Point3::new(corner.x, corner.y, 0.0)
    });
    (center, half, corners)
}
