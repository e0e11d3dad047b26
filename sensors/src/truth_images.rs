use covista_traffic::Scene;
use rayon::prelude::*;

use crate::sight::{Seen, Sight};
use crate::{ObjectRef, Viewpoint};

/// Depth and object of every pixel of a camera image, row by row from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct TruthImages {
    /// Pixels across.
    pub width_px: u32,
    /// Pixels down.
    pub height_px: u32,
    /// z in the camera frame in metres; infinite in the sky.
    pub depth_m: Vec<f32>,
    /// What is seen, numbered as by [`instance_number`]; 0 is the ground or the sky.
    pub instance: Vec<u16>,
}

/// The number of an object in instance images: 1 for the scene's first vehicle, 2 for its second
/// and so on, and after the last vehicle its scenery in the same way. 65535 stands for all beyond,
/// 0 for a vehicle that the scene lacks.
pub fn instance_number(scene: &Scene, object: ObjectRef) -> u16 {
    let index = match object {
        ObjectRef::Vehicle(id) => scene.vehicles.iter().position(|vehicle| vehicle.id == id),
        ObjectRef::Scenery(index) => Some(scene.vehicles.len().saturating_add(index)),
    };
    let number = index.map_or(0, |index| index.saturating_add(1));
    u16::try_from(number).unwrap_or(u16::MAX)
}

/// What the camera of `view` looks at, pixel for pixel as in [`crate::take_picture`].
pub fn take_truth_images(view: &Viewpoint) -> TruthImages {
    let intrinsics = &view.calibration.intrinsics;
    let (width_px, height_px) = (intrinsics.width_px, intrinsics.height_px);
    let width = width_px as usize;
    let count = width * height_px as usize;
    let (mut depth_m, mut instance) = (vec![f32::INFINITY; count], vec![0; count]);
    let sight = Sight::new(view);
    let band_len = (width * Sight::BAND_ROWS).max(1);
    depth_m
        .par_chunks_mut(band_len)
        .zip(instance.par_chunks_mut(band_len))
        .enumerate()
        .for_each(|(band, (depth_m, instance))| {
            sight.look(band, |run| {
                let start = run.row % Sight::BAND_ROWS * width + run.column;
                for (pixel, seen) in (start..start + run.len).zip(&run.seen) {
                    depth_m[pixel] = seen.depth_m();
                    if let Seen::Solid(face, _) = seen {
                        instance[pixel] = instance_number(view.scene, face.object);
                    }
                }
            });
        });
    TruthImages {
        width_px,
        height_px,
        depth_m,
        instance,
    }
}

#[cfg(test)]
mod tests;
