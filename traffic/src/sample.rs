//! Domain-randomised snapshots: every frame its own road, traffic, roadside and light.

mod course;
mod fleet;
mod freeway;
mod ground;
mod look;
mod mix;
mod plots;
mod roadside;
mod sidewalk;
mod site;
mod street;
mod traffic;

use std::sync::Arc;

use course::Course;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::{Body, RoadMarkings, Scene, SceneVehicle, Terrain, VehicleId};

pub(crate) use fleet::{draw_model, draw_paint};

/// Share of the scenes that are freeways.
const FREEWAYS: f64 = 0.55;
/// The vehicle with the sensors: the first that is placed.
const EGO: VehicleId = VehicleId(0);

/// What kind of place a sampled scene is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SceneKind {
    /// A carriageway of three to five lanes.
    Freeway,
    /// A narrow street between houses, with parked cars.
    Street,
}

/// A random scene and the vehicle whose sensors look at it.
#[derive(Debug, Clone)]
pub struct SampledScene {
    /// The truth.
    pub scene: Scene,
    /// The vehicle that carries the sensors, a sedan or an SUV.
    pub ego: VehicleId,
    /// What kind of place it is.
    pub kind: SceneKind,
}

/// A scene but for its light.
struct Draft {
    course: Course,
    markings: RoadMarkings,
    terrain: Terrain,
    vehicles: Vec<SceneVehicle>,
    scenery: Vec<Body>,
}

/// The scene with number `index` of the data set `seed`, reproducible from these two alone.
///
/// What is drawn, and from which distributions, is in `docs/randomisation.md`.
pub fn sample_scene(seed: u64, index: u64) -> SampledScene {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    let (kind, draft) = if rng.random_bool(FREEWAYS) {
        (SceneKind::Freeway, freeway::draw(&mut rng))
    } else {
        (SceneKind::Street, street::draw(&mut rng))
    };
    let ahead_rad = draft.course.road.reference(draft.course.ego_s_m).0.yaw_rad;
    let look = look::draw(&mut rng, ahead_rad);
    SampledScene {
        scene: Scene {
            time_s: 0.0,
            road: Arc::new(draft.course.road),
            markings: draft.markings,
            terrain: Arc::new(draft.terrain),
            vehicles: draft.vehicles,
            scenery: Arc::new(draft.scenery),
            look,
        },
        ego: EGO,
        kind,
    }
}

#[cfg(test)]
mod tests;
