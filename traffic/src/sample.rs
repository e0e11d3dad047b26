//! Domain-randomised snapshots: every frame its own road, traffic, roadside and light.

mod fleet;
mod look;
mod mix;
mod roadside;

use std::sync::Arc;

use covista_world::{Road, RoadSegment, Se2Pose};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{RoadMarkings, Scene, VehicleId};

pub(crate) use fleet::{draw_model, draw_paint};

/// A random scene and the vehicle whose sensors look at it.
#[derive(Debug, Clone)]
pub struct SampledScene {
    /// The truth.
    pub scene: Scene,
    /// The vehicle that carries the sensors, a sedan or an SUV.
    pub ego: VehicleId,
}

/// The scene with number `index` of the data set `seed`, reproducible from these two alone.
pub fn sample_scene(seed: u64, index: u64) -> SampledScene {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    let road = draw_road(&mut rng);
    let ego_s_m = rng.random_range(20.0..road.length_m() - 20.0);
    let vehicles = fleet::draw(&mut rng, &road, ego_s_m);
    let scenery = roadside::draw(&mut rng, &road, ego_s_m);
    let look = look::draw(&mut rng);
    SampledScene {
        scene: Scene {
            time_s: 0.0,
            road: Arc::new(road),
            markings: RoadMarkings::default(),
            terrain: Arc::default(),
            vehicles,
            scenery: Arc::new(scenery),
            look,
        },
        ego: fleet::EGO,
    }
}

/// Half of the roads are straight; the others have one or two bends between clothoids.
fn draw_road(rng: &mut impl Rng) -> Road {
    loop {
        let mut segments = vec![straight(rng, 20.0..120.0)];
        if rng.random_bool(0.5) {
            let bends = rng.random_range(1..=2);
            for _ in 0..bends {
                segments.extend(draw_bend(rng));
                segments.push(straight(rng, 10.0..100.0));
            }
        } else {
            segments.push(straight(rng, 100.0..200.0));
        }
        let start = Se2Pose::new(
            rng.random_range(-200.0..200.0),
            rng.random_range(-200.0..200.0),
            rng.random_range(-std::f64::consts::PI..std::f64::consts::PI),
        );
        let lane_width_m = rng.random_range(3.3..3.75);
        // Radii from 50 m up are never too tight, so this is the first turn of the loop.
        if let Ok(road) = Road::new(start, &segments, lane_width_m) {
            return road;
        }
    }
}

fn straight(rng: &mut impl Rng, length_m: std::ops::Range<f64>) -> RoadSegment {
    RoadSegment::Straight {
        length_m: rng.random_range(length_m),
    }
}

/// Clothoid, arc, clothoid; at most a right angle in all.
fn draw_bend(rng: &mut impl Rng) -> [RoadSegment; 3] {
    let radius_m = 50.0 * (12.0_f64).powf(rng.random_range(0.0..1.0));
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let curvature_per_m = side / radius_m;
    let clothoid_m = rng.random_range(20.0..50.0);
    let arc_max_m = (1.5 * radius_m - clothoid_m).clamp(15.0, 140.0);
    [
        RoadSegment::Clothoid {
            length_m: clothoid_m,
            from_per_m: 0.0,
            to_per_m: curvature_per_m,
        },
        RoadSegment::Arc {
            length_m: rng.random_range(10.0..arc_max_m),
            curvature_per_m,
        },
        RoadSegment::Clothoid {
            length_m: clothoid_m,
            from_per_m: curvature_per_m,
            to_per_m: 0.0,
        },
    ]
}

#[cfg(test)]
mod tests {
    use covista_world::ObjectClass;

    use super::*;
    use crate::Footprint;

    #[test]
    fn the_same_index_gives_the_same_scene_and_another_another() {
        let text = |index| format!("{:?}", sample_scene(7, index));
        assert_eq!(text(3), text(3));
        assert_ne!(text(3), text(4));
        assert_ne!(format!("{:?}", sample_scene(8, 3)), text(3));
    }

    #[test]
    fn vehicles_never_overlap_and_the_ego_is_there() {
        for index in 0..200 {
            let SampledScene { scene, ego } = sample_scene(1, index);
            let prints: Vec<_> = scene
                .vehicles
                .iter()
                .map(|vehicle| Footprint::new(vehicle.state.pose, vehicle.dimensions(), 0.0))
                .collect();
            for (i, one) in prints.iter().enumerate() {
                assert!(
                    !prints[..i].iter().any(|other| one.overlaps(other)),
                    "{index}"
                );
            }
            assert!(
                (4..=26).contains(&prints.len()),
                "{index}: {}",
                prints.len()
            );
            assert_eq!(scene.vehicles.iter().filter(|v| v.id == ego).count(), 1);
        }
    }

    #[test]
    fn nothing_of_the_roadside_stands_on_the_road() {
        for index in 0..60 {
            let SampledScene { scene, .. } = sample_scene(2, index);
            let edge_m = scene.road.mark_offset_m(0);
            for vertex in scene
                .scenery
                .iter()
                .flat_map(|body| &body.parts)
                .flat_map(|part| &part.vertices)
                .filter(|vertex| vertex.z < 3.0)
            {
                let d_m = scene.road.to_frenet(vertex.xy().coords).d_m;
                assert!(d_m.abs() > edge_m + 0.3, "scene {index}: d = {d_m}");
            }
        }
    }

    #[test]
    fn the_mix_is_what_it_should_be() {
        let scenes: Vec<_> = (0..200).map(|index| sample_scene(3, index).scene).collect();
        let curved = scenes
            .iter()
            .filter(|scene| scene.road.max_abs_curvature(0.0, 2000.0) > 1e-6)
            .count();
        assert!((70..130).contains(&curved), "{curved}");
        let models: Vec<_> = scenes
            .iter()
            .flat_map(|scene| &scene.vehicles)
            .map(|vehicle| vehicle.model)
            .collect();
        let large = models
            .iter()
            .filter(|model| model.class() == ObjectClass::Truck)
            .count() as f64;
        let share = large / models.len() as f64;
        assert!((0.08..0.20).contains(&share), "{share}");
    }
}
