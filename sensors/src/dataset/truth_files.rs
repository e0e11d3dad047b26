use std::collections::BTreeSet;

use covista_traffic::Scene;
use covista_world::ObjectClass;
use image::codecs::png::PngEncoder;
use image::{ImageBuffer, ImageError, Luma};

use super::TruthFile;
use crate::{
    LabelledCloud, ObjectRef, PointLabel, TruthImages, Viewpoint, instance_number,
    take_truth_images,
};

/// SemanticKITTI's classes, as far as the simulation tells things apart.
const CAR: u32 = 10;
const TRUCK: u32 = 18;
const OTHER_GROUND: u32 = 49;
const OTHER_OBJECT: u32 = 99;
/// KITTI's unit of depth is a 256th of a metre; 16 bits of them reach to 256 m.
const DEPTHS_PER_M: f32 = 256.0;

/// The truth that is asked for, each with the content of its file.
pub(super) fn truth_files(
    view: &Viewpoint,
    swept: &LabelledCloud,
    asked: &BTreeSet<TruthFile>,
) -> Result<Vec<(TruthFile, Vec<u8>)>, ImageError> {
    let pictured = [TruthFile::Depth, TruthFile::Instance];
    let images = pictured.iter().any(|truth| asked.contains(truth));
    let images = images.then(|| take_truth_images(view));
    let files = asked.iter().filter_map(|&truth| match (truth, &images) {
        (TruthFile::Points, _) => {
            let content = point_label_bytes(view.scene, &swept.objects);
            Some(Ok((truth, content)))
        }
        (TruthFile::Depth, Some(images)) => {
            let depths = images.depth_m.iter().copied().map(depth_value);
            let content = png_16_bits(images, depths.collect());
            Some(content.map(|content| (truth, content)))
        }
        (TruthFile::Instance, Some(images)) => {
            let content = png_16_bits(images, images.instance.clone());
            Some(content.map(|content| (truth, content)))
        }
        (TruthFile::Depth | TruthFile::Instance, None) => None,
    });
    files.collect()
}

/// A depth as it is written; 0, which is unknown, for the sky and what 16 bits can't hold.
fn depth_value(depth_m: f32) -> u16 {
    match (depth_m * DEPTHS_PER_M).round() {
        value if value <= f32::from(u16::MAX) => value as u16,
        _ => 0,
    }
}

fn png_16_bits(images: &TruthImages, values: Vec<u16>) -> Result<Vec<u8>, ImageError> {
    let mut bytes = Vec::new();
    let picture = ImageBuffer::<Luma<u16>, _>::from_raw(images.width_px, images.height_px, values);
    picture
        .unwrap_or_default()
        .write_with_encoder(PngEncoder::new(&mut bytes))?;
    Ok(bytes)
}

/// A SemanticKITTI `.label` file: for each point its class in the lower 16 bits and, in the upper
/// ones its [`instance_number`], 0 for the ground.
fn point_label_bytes(scene: &Scene, objects: &[PointLabel]) -> Vec<u8> {
    objects
        .iter()
        .flat_map(|object| label(scene, *object).to_le_bytes())
        .collect()
}

fn label(scene: &Scene, label: PointLabel) -> u32 {
    let PointLabel::Object(object) = label else {
        return OTHER_GROUND;
    };
    let class = match object {
        ObjectRef::Scenery(_) => OTHER_OBJECT,
        ObjectRef::Vehicle(id) => {
            let vehicle = scene.vehicles.iter().find(|vehicle| vehicle.id == id);
            match vehicle.map(|vehicle| vehicle.model.class()) {
                Some(ObjectClass::Car) => CAR,
                _ => TRUCK,
            }
        }
    };
    class | u32::from(instance_number(scene, object)) << 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_that_16_bits_cannot_hold_are_unknown() {
        assert_eq!(depth_value(10.0), 2560);
        assert_eq!(depth_value(255.995), 65_535);
        for unknown in [256.0, 400.0, f32::INFINITY, f32::NAN, 0.0] {
            assert_eq!(depth_value(unknown), 0, "{unknown}");
        }
    }
}
