use std::sync::Arc;

use covista_world::{BicycleState, Road, VehicleDimensions};
use nalgebra::{Isometry3, Vector3};

use crate::{Body, RoadMarkings, Terrain, VehicleModel};

/// The simulator's name for a vehicle; a CAV's is also its station id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VehicleId(pub u32);

/// The truth at one instant, as the sensors measure it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Time in seconds.
    pub time_s: f64,
    /// The road, seen from above.
    pub road: Arc<Road>,
    /// Its paint.
    pub markings: RoadMarkings,
    /// How high the ground lies.
    pub terrain: Arc<Terrain>,
    /// All vehicles.
    pub vehicles: Vec<SceneVehicle>,
    /// Everything that stands still and is no vehicle, in the world frame.
    pub scenery: Arc<Vec<Body>>,
    /// Light and surface.
    pub look: SceneLook,
}

impl Scene {
    /// Vehicle frame to world frame of a vehicle, on the ground.
    pub fn placed(&self, vehicle: &SceneVehicle) -> Isometry3<f64> {
        self.terrain.place(vehicle.state.pose, vehicle.dimensions())
    }
}

/// A vehicle in a [`Scene`].
#[derive(Debug, Clone)]
pub struct SceneVehicle {
    /// Its name.
    pub id: VehicleId,
    /// Its model: class, dimensions, body.
    pub model: VehicleModel,
    /// Colour of the coated parts (replaces the model's `CarPaint`).
    pub paint: [u8; 3],
    /// Its length, width and height as multiples of the model's.
    pub scale: Vector3<f64>,
    /// Rear-axle pose and speed.
    pub state: BicycleState,
}

impl SceneVehicle {
    /// Its dimensions.
    pub fn dimensions(&self) -> VehicleDimensions {
        let model = self.model.dimensions();
        VehicleDimensions {
            length_m: model.length_m * self.scale.x,
            width_m: model.width_m * self.scale.y,
            height_m: model.height_m * self.scale.z,
            wheelbase_m: model.wheelbase_m * self.scale.x,
            rear_overhang_m: model.rear_overhang_m * self.scale.x,
        }
    }
}

/// How a scene looks to the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneLook {
    /// Unit vector towards the sun, in the world frame.
    pub sun_direction: Vector3<f64>,
    /// Share of direct sunlight in [0, 1]; 0 is overcast.
    pub direct_light: f64,
    /// Share of the lane paint that is worn off, in [0, 1].
    pub paint_wear: f64,
    /// Overall brightness of the asphalt, about 0.15 to 0.5.
    pub asphalt_albedo: f64,
    /// Haze: extinction per metre, 0 to about 0.01.
    pub haze_per_m: f64,
    /// How wet the road is, in [0, 1]: 0 is dry, 1 a mirroring film of water.
    pub wetness: f64,
    /// How many cracks and patches the asphalt has, in [0, 1].
    pub damage: f64,
    /// Seed of textures (asphalt grain, wear), the same for all frames of a scene.
    pub texture_seed: u64,
}
