use covista_traffic::Scene;
use covista_world::ObjectClass;

use crate::{ObjectRef, PointLabel};

/// SemanticKITTI's classes, as far as the simulation tells things apart.
const CAR: u32 = 10;
const TRUCK: u32 = 18;
const OTHER_GROUND: u32 = 49;
const OTHER_OBJECT: u32 = 99;

/// A SemanticKITTI `.label` file: for each point its class in the lower 16 bits and, in the upper
/// ones, 0 for the ground, 1 for the scene's first vehicle, 2 for its second and so on, and after
/// the last vehicle its scenery in the same way.
pub(super) fn point_label_bytes(scene: &Scene, objects: &[PointLabel]) -> Vec<u8> {
    objects
        .iter()
        .flat_map(|object| label(scene, *object).to_le_bytes())
        .collect()
}

fn label(scene: &Scene, object: PointLabel) -> u32 {
    match object {
        PointLabel::Ground => OTHER_GROUND,
        PointLabel::Object(ObjectRef::Scenery(index)) => {
            OTHER_OBJECT | instance(scene.vehicles.len() + index)
        }
        PointLabel::Object(ObjectRef::Vehicle(id)) => {
            let is_it = |vehicle: &covista_traffic::SceneVehicle| vehicle.id == id;
            match scene.vehicles.iter().position(is_it) {
                None => OTHER_OBJECT,
                Some(index) if scene.vehicles[index].model.class() == ObjectClass::Car => {
                    CAR | instance(index)
                }
                Some(index) => TRUCK | instance(index),
            }
        }
    }
}

fn instance(index: usize) -> u32 {
    u32::from(u16::try_from(index + 1).unwrap_or(u16::MAX)) << 16
}
