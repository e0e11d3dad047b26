use std::sync::Arc;

use covista_traffic::{
    Body, ConvexPart, Material, RoadMarkings, Scene, SceneLook, SceneVehicle, VehicleId,
    VehicleModel,
};
use covista_world::{BicycleState, Road, RoadSegment, Se2Pose};
use nalgebra::{Point3, Vector3};

use crate::light::Light;

/// The vehicle with the sensors in these scenes, at the world's origin.
pub(crate) const EGO: VehicleId = VehicleId(0);

/// A straight road along x, the ego on its middle lane, and nothing else.
pub(crate) fn empty_road() -> Scene {
    let straight = RoadSegment::Straight { length_m: 400.0 };
    let start = Se2Pose::new(-200.0, 0.0, 0.0);
    Scene {
        time_s: 0.0,
        road: Arc::new(Road::new(start, &[straight], 3.5).expect("a road")),
        markings: RoadMarkings::default(),
        terrain: Arc::default(),
        vehicles: vec![vehicle(EGO, VehicleModel::Sedan, Se2Pose::default())],
        scenery: Arc::default(),
        look: SceneLook {
            sun_direction: Vector3::new(0.5, 0.3, 0.8).normalize(),
            direct_light: 0.7,
            paint_wear: 0.1,
            asphalt_albedo: 0.3,
            haze_per_m: 0.001,
            wetness: 0.0,
            damage: 0.0,
            texture_seed: 5,
        },
    }
}

pub(crate) fn vehicle(id: VehicleId, model: VehicleModel, pose: Se2Pose) -> SceneVehicle {
    SceneVehicle {
        id,
        model,
        paint: [200, 200, 200],
        scale: Vector3::repeat(1.0),
        state: BicycleState {
            pose,
            speed_mps: 0.0,
        },
    }
}

/// A concrete block between two opposite corners.
pub(crate) fn block(low: [f64; 3], high: [f64; 3]) -> Body {
    let pick = |bit: usize, axis: usize| if bit == 0 { low[axis] } else { high[axis] };
    let vertices = (0..8)
        .map(|i| Point3::new(pick(i & 1, 0), pick(i >> 1 & 1, 1), pick(i >> 2, 2)))
        .collect();
    Body {
        parts: vec![ConvexPart {
            vertices,
            material: Material::Concrete,
        }],
    }
}

/// The light of a clear day, as far as `direct` says so.
pub(crate) fn light(direct: f64) -> Light {
    Light::new(&SceneLook {
        sun_direction: Vector3::new(0.5, 0.3, 0.8),
        direct_light: direct,
        paint_wear: 0.2,
        asphalt_albedo: 0.3,
        haze_per_m: 0.002,
        wetness: 0.0,
        damage: 0.0,
        texture_seed: 5,
    })
}
