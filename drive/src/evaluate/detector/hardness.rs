use covista_world::ObjectClass;
use serde::Serialize;

use super::frame::{MeasuredFrame, Object};
use super::operating_point::percent;

/// Lower ends of the bars; the last one is open.
const DISTANCES_M: [u32; 8] = [0, 10, 20, 30, 40, 50, 60, 70];
const OCCLUSIONS: [u32; 4] = [0, 1, 2, 3];
const POINTS: [u32; 6] = [0, 1, 5, 20, 100, 500];

/// How hard the labels of a class in the picture are, whatever their difficulty: what KITTI's own
/// label files would hold.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hardness {
    /// Labels in the picture.
    pub labelled: usize,
    /// By distance from the LIDAR over the ground.
    pub labelled_by_distance_m: Vec<Bar>,
    /// By KITTI's levels of occlusion; 3 is unknown.
    pub labelled_by_occlusion: Vec<Bar>,
    /// By points of the sweep in the box.
    pub labelled_by_points: Vec<Bar>,
}

/// A bar of a histogram.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bar {
    /// From this value on.
    pub from: u32,
    /// To below this one, or without an end.
    pub below: Option<u32>,
    /// Labels there.
    pub boxes: usize,
    /// Of all labels.
    pub percent: Option<f64>,
}

impl Hardness {
    pub(super) fn of(frames: &[MeasuredFrame], class: ObjectClass) -> Self {
        let objects: Vec<&Object> = frames
            .iter()
            .flat_map(|frame| &frame.objects)
            .filter(|object| object.is_of(class) && object.is_in_picture())
            .collect();
        let histogram = |edges: &[u32], value: &dyn Fn(&Object) -> f64| {
            let bars = edges.iter().enumerate().map(|(index, &from)| {
                let below = edges.get(index + 1).copied();
                let is_inside = |value: f64| {
                    value >= f64::from(from) && below.is_none_or(|end| value < f64::from(end))
                };
                let boxes = objects.iter().filter(|of| is_inside(value(of))).count();
                Bar {
                    from,
                    below,
                    boxes,
                    percent: percent(boxes, objects.len()),
                }
            });
            bars.collect()
        };
        Self {
            labelled: objects.len(),
            labelled_by_distance_m: histogram(&DISTANCES_M, &Object::distance_m),
            labelled_by_occlusion: histogram(&OCCLUSIONS, &|of| f64::from(of.label.occluded)),
            labelled_by_points: histogram(&POINTS, &|of| of.returns as f64),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::tests::{CAR, frame};
    use super::*;

    #[test]
    fn bars_hold_every_label_in_the_picture_once() {
        let behind = CAR
            .replace("600 150 650 200", "0 0 0 0")
            .replace("20.0", "-20.0");
        let far = CAR.replace("Car 0 0", "Car 0 2").replace("20.0", "80.0");
        let frames = [frame(&[CAR, &behind, &far], Vec::new())];
        let of = Hardness::of(&frames, ObjectClass::Car);
        assert_eq!(of.labelled, 2);
        let boxes = |bars: &[Bar]| bars.iter().map(|bar| bar.boxes).collect::<Vec<_>>();
        assert_eq!(boxes(&of.labelled_by_distance_m), [0, 0, 1, 0, 0, 0, 0, 1]);
        assert_eq!(boxes(&of.labelled_by_occlusion), [1, 0, 1, 0]);
        assert_eq!(boxes(&of.labelled_by_points), [1, 0, 1, 0, 0, 0]);
        assert_eq!(of.labelled_by_points[0].percent, Some(50.0));
    }
}
