use std::collections::BTreeMap;

use covista_perception::metrics::{
    BenchmarkFrame, Difficulty, FoundBox, KittiPrecision, LabelledBox, Overlap,
};
use covista_world::ObjectClass;

use super::frame::MeasuredFrame;

/// KITTI's figures for a class: labels that count by difficulty, and average precisions in
/// percent, by their names in the JSON.
pub(super) fn figures(
    frames: &[MeasuredFrame],
    class: ObjectClass,
) -> (BTreeMap<String, usize>, BTreeMap<String, Option<f64>>) {
    let frames: Vec<BenchmarkFrame> = frames.iter().map(|frame| of_class(frame, class)).collect();
    let class = match class {
        ObjectClass::Car => "car",
        ObjectClass::Truck => "truck",
    };
    let (mut boxes, mut figures) = (BTreeMap::new(), BTreeMap::new());
    for (view, overlap) in [("bev", Overlap::Ground), ("3d", Overlap::Volume)] {
        for (suffix, min_iou) in [("", 0.7), ("_iou50", 0.5)] {
            for (level, difficulty) in ["easy", "moderate", "hard"].iter().zip(Difficulty::ALL) {
                let of = KittiPrecision::over(&frames, difficulty, overlap, min_iou);
                boxes.insert(format!("boxes_{level}"), of.map_or(0, |of| of.boxes));
                for (samples, value) in [(11, of.map(|of| of.r11)), (40, of.map(|of| of.r40))] {
                    figures.insert(
                        format!("ap_{view}_{class}_{level}_r{samples}{suffix}"),
                        value.map(|value| 100.0 * value),
                    );
                }
            }
        }
    }
    (boxes, figures)
}

/// A frame as KITTI's development kit reads it. Vans are neighbours of cars; here they are of the
/// class of trucks. Labels outside of the picture have no height there, so they are ignored; boxes
/// found outside of it are left out.
fn of_class(frame: &MeasuredFrame, class: ObjectClass) -> BenchmarkFrame {
    let labelled = frame.objects.iter().filter_map(|object| {
        let is_neighbour = !object.is_of(class);
        let is_van = object.label.kind == "Van" && class == ObjectClass::Car;
        (!is_neighbour || is_van).then(|| LabelledBox {
            shape: object.shape,
            is_neighbour,
            height_px: object.height_px(),
            occluded: object.label.occluded,
            truncated: object.label.truncated,
        })
    });
    let found = frame.found.iter().filter_map(|found| {
        Some(FoundBox {
            shape: *found,
            is_of_class: found.class == class,
            height_px: frame.height_px(found)?,
        })
    });
    BenchmarkFrame::new(labelled.collect(), found.collect())
}

#[cfg(test)]
mod tests {
    use super::super::frame::tests::{CAR, detection, frame};
    use super::*;

    #[test]
    fn one_frame_by_kittis_rules() {
        let van = CAR
            .replace("Car", "Van")
            .replace(" 0.0 1.65 20.0", " 5.0 1.65 20.0");
        let behind = CAR
            .replace("600 150 650 200", "0 0 0 0")
            .replace("20.0", "-20.0");
        let truck = CAR.replace("Car", "Truck").replace("20.0", "40.0");
        let found = vec![
            detection(20.27, 0.0),
            detection(20.27, -5.0),
            detection(-19.73, 0.0),
            detection(-30.0, 0.0),
        ];
        let measured = frame(&[CAR, &van, &behind, &truck], found);
        let cars = [of_class(&measured, ObjectClass::Car)];
        let of = KittiPrecision::over(&cars, Difficulty::Easy, Overlap::Volume, 0.7);
        // One car counts; the boxes on it and on the van are no mistakes. With a single label only
        // the sample at recall 0 is reached.
        let of = of.expect("a label");
        assert_eq!(of.boxes, 1);
        assert!((of.r11 - 1.0 / 11.0).abs() < 1e-12, "{of:?}");
        let (boxes, figures) = figures(&[measured], ObjectClass::Truck);
        assert_eq!(boxes["boxes_easy"], 2);
        assert_eq!(figures["ap_3d_truck_easy_r40"], Some(0.0));
        assert_eq!(figures.len(), 24);
    }
}
