use covista_traffic::{Scene, SceneVehicle, VehicleId};
use covista_world::Calibration;
use nalgebra::{Isometry3, Point3};

use crate::RayScene;

/// A vehicle with sensors in a scene: where measurements are taken from.
#[derive(Debug, Clone, Copy)]
pub struct Viewpoint<'a> {
    /// The truth.
    pub scene: &'a Scene,
    /// The same truth, made ready for rays.
    pub rays: &'a RayScene,
    /// The vehicle that carries the sensors.
    pub ego: &'a SceneVehicle,
    /// Where it carries them.
    pub calibration: &'a Calibration,
}

impl<'a> Viewpoint<'a> {
    /// The view of vehicle `ego`, or `None` where the scene has no such vehicle.
    pub fn new(
        scene: &'a Scene,
        rays: &'a RayScene,
        ego: VehicleId,
        calibration: &'a Calibration,
    ) -> Option<Self> {
        let ego = scene.vehicles.iter().find(|vehicle| vehicle.id == ego)?;
        Some(Self {
            scene,
            rays,
            ego,
            calibration,
        })
    }

    /// LIDAR frame to world frame.
    pub fn world_from_lidar(&self) -> Isometry3<f64> {
        self.scene.placed(self.ego) * self.calibration.vehicle_from_lidar
    }

    /// Camera frame to world frame.
    pub fn world_from_camera(&self) -> Isometry3<f64> {
        self.scene.placed(self.ego) * self.calibration.vehicle_from_camera
    }

    /// Position of the LIDAR in the world frame.
    pub fn lidar_position(&self) -> Point3<f64> {
        Point3::from(self.world_from_lidar().translation.vector)
    }

    /// Position of the camera in the world frame.
    pub fn camera_position(&self) -> Point3<f64> {
        Point3::from(self.world_from_camera().translation.vector)
    }

    /// All other vehicles.
    pub fn others(&self) -> impl Iterator<Item = &'a SceneVehicle> {
        let own = self.ego.id;
        self.scene
            .vehicles
            .iter()
            .filter(move |vehicle| vehicle.id != own)
    }
}
