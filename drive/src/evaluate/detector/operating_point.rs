use std::f64::consts::FRAC_PI_2;

use covista_perception::metrics::pair;
use covista_world::{ObjectClass, wrap_angle};
use serde::Serialize;

use super::frame::MeasuredFrame;

/// A box found on a vehicle overlaps its ground by this IoU.
const MIN_IOU: f64 = 0.5;
/// The most hidden vehicles that are to be found: KITTI's "largely occluded".
const MOST_OCCLUDED: u8 = 2;
/// Recall is told for each ten metres up to here.
const FARTHEST_M: u32 = 70;
const STEP_M: u32 = 10;

/// What a detector finds of a class at its score threshold, all around: vehicles in range with at
/// least five returns, at most largely occluded.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OperatingPoint {
    /// On the detector's card.
    pub score_threshold: f64,
    /// Vehicles found, in percent.
    pub recall: Option<f64>,
    /// Boxes that are vehicles, in percent.
    pub precision: Option<f64>,
    /// Boxes on nothing.
    pub false_per_frame: f64,
    /// Of the boxes found with theirs, in the bird's eye view, in [0, 1].
    pub mean_bev_iou: Option<f64>,
    /// Vehicles found that head more than 90 degrees elsewhere, in percent.
    pub flipped_headings: Option<f64>,
    /// By distance from the LIDAR over the ground.
    pub recall_by_distance_m: Vec<RecallBar>,
    /// By KITTI's levels of occlusion.
    pub recall_by_occlusion: Vec<RecallBar>,
}

/// Vehicles in a span of distance or at a level of occlusion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RecallBar {
    /// From this value on.
    pub from: u32,
    /// To below this one.
    pub below: u32,
    /// Vehicles there.
    pub boxes: usize,
    /// Found of them, in percent.
    pub recall: Option<f64>,
}

impl OperatingPoint {
    pub(super) fn of(
        frames: &[MeasuredFrame],
        class: ObjectClass,
        picture_only: bool,
        score_threshold: f64,
    ) -> Self {
        let (mut vehicles, mut false_boxes) = (Vec::new(), 0);
        for frame in frames {
            let mut found = frame.found_all_around(class, picture_only);
            found.retain(|found| found.score >= score_threshold);
            let truth = frame.true_boxes(class, MOST_OCCLUDED);
            let mut hits: Vec<Option<Hit>> = vec![None; truth.len()];
            for pair in pair(&found, &truth, MIN_IOU) {
                match pair.truth {
                    None => false_boxes += 1,
                    Some((index, iou)) => {
                        let turn = found[pair.found].yaw_rad - truth[index].footprint.yaw_rad;
                        let flipped = wrap_angle(turn).abs() > FRAC_PI_2;
                        hits[index] = Some(Hit { iou, flipped });
                    }
                }
            }
            let all = frame.objects.iter().zip(&truth).zip(hits);
            vehicles.extend(all.filter(|((_, truth), _)| !truth.ignored).map(
                |((object, _), hit)| Vehicle {
                    distance_m: object.distance_m(),
                    occluded: object.label.occluded,
                    hit,
                },
            ));
        }
        let hits: Vec<Hit> = vehicles.iter().filter_map(|vehicle| vehicle.hit).collect();
        let flipped = hits.iter().filter(|hit| hit.flipped).count();
        let ious = hits.iter().map(|hit| hit.iou);
        let bar = |from: u32, step: u32, value: &dyn Fn(&Vehicle) -> f64| {
            let span = f64::from(from)..f64::from(from + step);
            let inside = || vehicles.iter().filter(|of| span.contains(&value(of)));
            let found = inside().filter(|vehicle| vehicle.hit.is_some()).count();
            RecallBar {
                from,
                below: from + step,
                boxes: inside().count(),
                recall: percent(found, inside().count()),
            }
        };
        Self {
            score_threshold,
            recall: percent(hits.len(), vehicles.len()),
            precision: percent(hits.len(), hits.len() + false_boxes),
            false_per_frame: false_boxes as f64 / frames.len().max(1) as f64,
            mean_bev_iou: (!hits.is_empty()).then(|| ious.sum::<f64>() / hits.len() as f64),
            flipped_headings: percent(flipped, hits.len()),
            recall_by_distance_m: (0..FARTHEST_M / STEP_M)
                .map(|step| bar(step * STEP_M, STEP_M, &|of| of.distance_m))
                .collect(),
            recall_by_occlusion: (0..=u32::from(MOST_OCCLUDED))
                .map(|level| bar(level, 1, &|of| f64::from(of.occluded)))
                .collect(),
        }
    }
}

/// A vehicle that is to be found.
struct Vehicle {
    distance_m: f64,
    occluded: u8,
    hit: Option<Hit>,
}

/// The box found on it.
#[derive(Clone, Copy)]
struct Hit {
    iou: f64,
    flipped: bool,
}

/// `part` of `whole`, unless there is nothing.
pub(super) fn percent(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| 100.0 * part as f64 / whole as f64)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::frame::tests::{CAR, detection, frame};
    use super::*;

    #[test]
    fn recall_and_its_kin_in_closed_form() {
        let hidden = CAR.replace("Car 0 0", "Car 0 2");
        let mut turned = detection(20.27, 0.0);
        turned.yaw_rad = PI;
        let (mut beside, mut unsure) = (detection(45.0, 0.0), detection(55.0, 0.0));
        (beside.score, unsure.score) = (0.5, 0.3);
        let frames = [
            frame(&[CAR], vec![detection(20.27, 0.0), beside, unsure]),
            frame(&[&hidden], vec![turned]),
            frame(&[CAR], Vec::new()),
        ];
        let of = OperatingPoint::of(&frames, ObjectClass::Car, false, 0.4);
        assert_eq!(of.recall, Some(200.0 / 3.0));
        assert_eq!(of.precision, Some(200.0 / 3.0));
        assert_eq!(of.flipped_headings, Some(50.0));
        assert!((of.false_per_frame - 1.0 / 3.0).abs() < 1e-12);
        assert!(of.mean_bev_iou.is_some_and(|iou| iou > 0.99), "{of:?}");
        let bars = &of.recall_by_distance_m;
        assert_eq!((bars[2].from, bars[2].below, bars[2].boxes), (20, 30, 3));
        assert_eq!(bars[3].recall, None);
        let levels: Vec<_> = of
            .recall_by_occlusion
            .iter()
            .map(|bar| bar.recall)
            .collect();
        assert_eq!(levels, [Some(50.0), None, Some(100.0)]);
        let none = OperatingPoint::of(&frames, ObjectClass::Truck, false, 0.4);
        assert_eq!((none.recall, none.precision), (None, None));
    }
}
