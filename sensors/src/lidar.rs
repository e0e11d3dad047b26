//! A rotating LIDAR: one ray per beam and column, a return where enough light comes back.

use covista_traffic::Material;
use covista_world::PointCloud;
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::prelude::*;

use crate::Viewpoint;
use crate::caster::Hit;
use crate::pavement::{GroundPatch, Pavement};

/// Weakest return, as reflectance per square metre of range, that the receiver tells from noise:
/// asphalt is seen to about 60 m and a dark car to about 80 m.
const WEAKEST_RETURN: f32 = 1.6e-5;
/// Share of pulses lost whatever they hit.
const RANDOM_LOSS: f32 = 0.015;
/// Shares of pulses that a pane reflects, and that pass it once.
const GLASS_REFLECTED: f32 = 0.12;
const GLASS_PASSED: f32 = 0.45;
/// Returns nearer than this are blanked.
const BLANK_M: f32 = 0.9;
/// Beyond the edge line the ground is grass from here on.
const PAVED_SHOULDER_M: f64 = 2.0;
/// Diameter of a beam's spot on the ground.
const SPOT_M: f64 = 0.1;

/// A rotating multi-beam LIDAR.
#[derive(Debug, Clone, PartialEq)]
pub struct Lidar {
    /// Elevation of each beam in radians, from the highest to the lowest.
    pub elevations_rad: Vec<f64>,
    /// Firings in a turn.
    pub columns: u32,
    /// Maximum range in metres.
    pub range_m: f64,
    /// Standard deviation of the range in metres.
    pub range_std_m: f64,
}

/// A surface as a pulse finds it.
struct Return {
    distance_m: f32,
    /// Share of the light that comes back to the sensor.
    intensity: f32,
    /// What the sensor reports, in [0, 1].
    reflectance: f32,
}

impl Lidar {
    /// KITTI's Velodyne HDL-64E: 32 beams from +2 to -8.33 degrees, 32 from -8.83 to -24.33.
    pub fn hdl64e() -> Self {
        let upper = (0..32).map(|beam| 2.0 - f64::from(beam) / 3.0);
        let lower = (0..32).map(|beam| -8.83 - f64::from(beam) / 2.0);
        Self {
            elevations_rad: upper.chain(lower).map(f64::to_radians).collect(),
            columns: 2083,
            range_m: 120.0,
            range_std_m: 0.02,
        }
    }

    /// One turn, frozen at the scene's time: the returns in the LIDAR frame, column by column.
    ///
    /// The same seed gives the same cloud whatever the number of threads.
    pub fn sweep(&self, view: &Viewpoint, seed: u64) -> PointCloud {
        let pavement = Pavement::new(view.scene);
        let world_from_lidar = view.world_from_lidar();
        let own_s_m = view
            .scene
            .road
            .to_frenet(view.ego.state.pose.position())
            .s_m;
        let turn = Turn {
            lidar: self,
            view,
            pavement: &pavement,
            world_from_lidar,
            own_s_m,
        };
        let columns = (0..self.columns).into_par_iter().map(|column| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            rng.set_stream(u64::from(column));
            turn.column(column, &mut rng)
        });
        PointCloud {
            points: columns.collect::<Vec<_>>().concat(),
        }
    }
}

/// One turn of a LIDAR in a scene.
struct Turn<'a> {
    lidar: &'a Lidar,
    view: &'a Viewpoint<'a>,
    pavement: &'a Pavement,
    world_from_lidar: Isometry3<f64>,
    own_s_m: f64,
}

impl Turn<'_> {
    fn column(&self, column: u32, rng: &mut ChaCha8Rng) -> Vec<[f32; 4]> {
        let azimuth = -std::f64::consts::TAU * f64::from(column) / f64::from(self.lidar.columns);
        let origin = Point3::from(self.world_from_lidar.translation.vector.cast::<f32>());
        // From the lowest beam up, so that each ground point is the next one's Frenet guess.
        let mut s_hint_m = self.own_s_m;
        let mut points = Vec::with_capacity(self.lidar.elevations_rad.len());
        for elevation in self.lidar.elevations_rad.iter().rev() {
            let (sin, cos) = elevation.sin_cos();
            let local = Vector3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin);
            let direction = (self.world_from_lidar * local).cast::<f32>();
            let Some(found) = self.pulse(&origin, &direction, &mut s_hint_m, rng) else {
                continue;
            };
            let noise: f64 = StandardNormal.sample(rng);
            let range_m = f64::from(found.distance_m) + self.lidar.range_std_m * noise;
            if self.is_received(&found, rng) {
                let point = (local * range_m).cast::<f32>();
                points.push([point.x, point.y, point.z, found.reflectance]);
            }
        }
        points
    }

    fn is_received(&self, found: &Return, rng: &mut ChaCha8Rng) -> bool {
        let log_gain: f32 = StandardNormal.sample(rng);
        let signal = found.intensity * (0.25 * log_gain).exp() / found.distance_m.powi(2);
        let lost = rng.random::<f32>() < RANDOM_LOSS;
        !lost && found.distance_m > BLANK_M && signal > WEAKEST_RETURN
    }

    /// What one pulse meets first, through glass where it passes.
    fn pulse(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        s_hint_m: &mut f64,
        rng: &mut ChaCha8Rng,
    ) -> Option<Return> {
        let max_m = self.lidar.range_m as f32;
        let own = Some(self.view.ego.id);
        let ground_m = self.view.rays.ground_hit(origin, direction, max_m);
        let mut passed_m = 0.0;
        let mut transmission = 1.0;
        // At most two panes: a window and the one behind it.
        for _ in 0..3 {
            let from = origin + direction * passed_m;
            let reach_m = ground_m.unwrap_or(max_m) - passed_m;
            let Some(hit) = self.view.rays.cast(&from, direction, reach_m, own) else {
                let distance_m = ground_m?;
                let at = origin + direction * distance_m;
                let reflectance = self.ground_reflectance(&at, s_hint_m, rng);
                return Some(Return {
                    distance_m,
                    intensity: transmission * reflectance * flattened(-direction.z),
                    reflectance,
                });
            };
            let distance_m = passed_m + hit.distance_m;
            let fate: f32 = rng.random();
            if hit.material != Material::Glass || fate < GLASS_REFLECTED {
                return Some(surface_return(
                    distance_m,
                    &hit,
                    direction,
                    transmission,
                    rng,
                ));
            }
            if fate > GLASS_REFLECTED + GLASS_PASSED {
                return None;
            }
            transmission *= 0.7;
            passed_m = distance_m + 0.01;
        }
        None
    }

    fn ground_reflectance(
        &self,
        at: &Point3<f32>,
        s_hint_m: &mut f64,
        rng: &mut ChaCha8Rng,
    ) -> f32 {
        let road = &self.view.scene.road;
        let position = at.coords.xy().cast::<f64>();
        let frenet = road.to_frenet_near(position, *s_hint_m);
        *s_hint_m = frenet.s_m;
        let grain: f32 = StandardNormal.sample(rng);
        let paved_m = road.mark_offset_m(0) + PAVED_SHOULDER_M;
        if frenet.d_m.abs() > paved_m {
            return (0.38 + 0.06 * grain).clamp(0.05, 1.0);
        }
        // Red is the nearest to the laser's infrared.
        let red = self.pavement.albedo(&GroundPatch {
            position,
            s_m: frenet.s_m,
            d_m: frenet.d_m,
            spread_s_m: SPOT_M,
            spread_d_m: SPOT_M,
        })[0];
        (0.08 + red + 0.03 * grain).clamp(0.02, 1.0)
    }
}

/// Loss of light by incidence, flatter than Lambert's cosine as real receivers adapt.
fn flattened(cos_incidence: f32) -> f32 {
    0.3 + 0.7 * cos_incidence.clamp(0.0, 1.0)
}

fn surface_return(
    distance_m: f32,
    hit: &Hit,
    direction: &Vector3<f32>,
    transmission: f32,
    rng: &mut ChaCha8Rng,
) -> Return {
    let (albedo, depth_m) = match hit.material {
        Material::CarPaint(rgb) => (0.08 + 0.55 * luma(rgb), 0.0),
        Material::Glass => (0.10, 0.0),
        Material::Rubber => (0.06, 0.0),
        Material::Reflector(_) => (0.98, 0.0),
        Material::Metal => (0.35, 0.0),
        Material::Concrete => (0.36, 0.0),
        Material::Plaster(rgb) => (0.2 + 0.4 * luma(rgb), 0.0),
        Material::Cloth(rgb) => (0.15 + 0.4 * luma(rgb), 0.0),
        // Leaves are rough: a pulse goes some way in.
        Material::Foliage => (0.42, 0.15),
    };
    let facing = if matches!(hit.material, Material::Reflector(_)) {
        1.0
    } else {
        flattened(-hit.normal.dot(direction))
    };
    let grain: f32 = StandardNormal.sample(rng);
    let depth: f32 = rng.random();
    Return {
        distance_m: distance_m + depth_m * depth,
        intensity: transmission * albedo * facing,
        reflectance: (albedo * (0.4 + 0.6 * facing) + 0.02 * grain).clamp(0.0, 1.0),
    }
}

/// Brightness of a colour in [0, 1], linear.
fn luma(rgb: [u8; 3]) -> f32 {
    let linear = rgb.map(|channel| (f32::from(channel) / 255.0).powf(2.2));
    0.3 * linear[0] + 0.6 * linear[1] + 0.1 * linear[2]
}

#[cfg(test)]
mod tests {
    use covista_traffic::Scene;
    use covista_world::Calibration;

    use super::*;
    use crate::RayScene;
    use crate::testing::{EGO, block, empty_road};

    fn sweep(scene: &Scene, seed: u64) -> PointCloud {
        let (rays, calibration) = (RayScene::new(scene), Calibration::kitti());
        let view = Viewpoint::new(scene, &rays, EGO, &calibration).expect("the ego");
        Lidar::hdl64e().sweep(&view, seed)
    }

    #[test]
    fn it_has_the_beams_of_an_hdl_64e() {
        let beams = Lidar::hdl64e().elevations_rad;
        assert_eq!(beams.len(), 64);
        assert!((beams[0].to_degrees() - 2.0).abs() < 1e-9);
        assert!((beams[63].to_degrees() + 24.33).abs() < 1e-9);
        assert!(beams.windows(2).all(|pair| pair[1] < pair[0]));
    }

    #[test]
    fn a_wall_is_measured_at_its_distance_with_two_centimetres_of_noise() {
        let mut scene = empty_road();
        // The LIDAR stands at x = 0.9 m, the wall's face 20 m ahead of it.
        scene.scenery = vec![block([20.9, -30.0, 0.0], [21.9, 30.0, 4.0])].into();
        let cloud = sweep(&scene, 1);
        let errors: Vec<f64> = cloud
            .points
            .iter()
            .filter(|[x, y, z, _]| *x > 15.0 && y.abs() < 5.0 && *z > -1.2)
            .map(|&[x, y, z, _]| {
                let range = Vector3::new(x, y, z).cast::<f64>().norm();
                range - 20.0 * range / f64::from(x)
            })
            .collect();
        let count = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
        // 28 degrees at 0.1728 degrees, some 17 beams between +2 and -3.4 degrees.
        assert!((2400.0..2900.0).contains(&count), "{count}");
        assert!(mean.abs() < 2e-3, "{mean}");
        assert!((deviation - 0.02).abs() < 2e-3, "{deviation}");
    }

    #[test]
    fn paint_shines_and_the_ground_lies_at_the_mounting_height() {
        let cloud = sweep(&empty_road(), 2);
        let near = || {
            let points = cloud.points.iter();
            points.filter(|[x, y, _, _]| x.abs() < 12.0 && y.abs() < 8.0)
        };
        assert!(near().all(|[_, _, z, _]| (z + 1.73).abs() < 0.06));
        let mean = |low: f32, high: f32| {
            let picked: Vec<f32> = near()
                .filter(|[_, y, _, _]| (low..high).contains(y))
                .map(|point| point[3])
                .collect();
            assert!(picked.len() > 100);
            picked.iter().sum::<f32>() / picked.len() as f32
        };
        // The left edge line is at 5.25 m, the middle lane is bare asphalt.
        assert!(mean(5.20, 5.30) > 0.6, "{}", mean(5.20, 5.30));
        let asphalt = mean(-1.5, 1.5);
        assert!((0.15..0.35).contains(&asphalt), "{asphalt}");
    }

    #[test]
    fn the_number_of_threads_changes_nothing_but_the_seed_does() {
        let scene = empty_road();
        let with_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            pool.expect("a pool").install(|| sweep(&scene, 3))
        };
        let one = with_threads(1);
        assert!(one.points.len() > 50_000);
        assert_eq!(one, with_threads(3));
        assert_ne!(one, sweep(&scene, 4));
    }
}
