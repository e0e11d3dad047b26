use covista_world::Se2Pose;
use nalgebra::{Point3, Vector3};

use super::{DrawnBox, ErrorModel, Observer};
use crate::{Viewpoint, seen_vehicles};

/// How far before its centre a box begins to show.
const HALF_BODY_M: f32 = 2.0;

impl ErrorModel {
    /// What the networks would find from a vehicle in a scene, the surest first.
    pub fn perceive(&self, view: &Viewpoint, seed: u64) -> Vec<DrawnBox> {
        let mount = view.calibration.vehicle_from_lidar.translation.vector;
        let pose = view.ego.state.pose;
        let from = Observer {
            seed,
            ego: view.ego.id,
            time_s: view.scene.time_s,
            lidar: pose.compose(Se2Pose::new(mount.x, mount.y, 0.0)),
            road: Some(&view.scene.road),
        };
        let mut drawn = self.draw(&seen_vehicles(view, self.range_m), &from);
        drawn.retain(|drawn| drawn.of.is_some() || is_in_sight(view, drawn.detection.center_m));
        drawn
    }
}

/// Whether nothing stands between the LIDAR and a box in its frame.
fn is_in_sight(view: &Viewpoint, center_m: Vector3<f64>) -> bool {
    let eye = view.lidar_position();
    let way = (view.world_from_lidar() * Point3::from(center_m) - eye).cast::<f32>();
    let reach_m = (way.norm() - HALF_BODY_M).max(0.0);
    let eye = eye.cast::<f32>();
    !view
        .rays
        .occluded(&eye, &way.normalize(), reach_m, Some(view.ego.id))
}
