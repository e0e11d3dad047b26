//! Overlap of upright boxes, and non-maximum suppression by that seen from above.

use std::cmp::Ordering;

use covista_world::Detection3d;
use nalgebra::Vector2;

/// Boxes, best first, without those whose BEV IoU with a better one is above `max_iou`, whatever
/// their classes: two vehicles never share their ground.
pub fn suppress(mut boxes: Vec<Detection3d>, max_iou: f64) -> Vec<Detection3d> {
    boxes.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Detection3d> = Vec::new();
    for candidate in boxes {
        if kept
            .iter()
            .all(|better| bev_iou(better, &candidate) <= max_iou)
        {
            kept.push(candidate);
        }
    }
    kept
}

/// Intersection over union of the boxes' footprints, in [0, 1].
pub fn bev_iou(a: &Detection3d, b: &Detection3d) -> f64 {
    let area_m2 = |of: &Detection3d| of.size_m.x * of.size_m.y;
    over_union(shared_ground_m2(a, b), area_m2(a), area_m2(b))
}

/// Intersection over union of the boxes' volumes, in [0, 1]; both stand upright.
pub fn iou_3d(a: &Detection3d, b: &Detection3d) -> f64 {
    let apart_m = (a.center_m.z - b.center_m.z).abs();
    let mean_height_m = (a.size_m.z + b.size_m.z) / 2.0;
    if apart_m.partial_cmp(&mean_height_m) != Some(Ordering::Less) {
        return 0.0;
    }
    let shared_height_m = (mean_height_m - apart_m).min(a.size_m.z).min(b.size_m.z);
    let shared_m3 = shared_ground_m2(a, b) * shared_height_m;
    over_union(shared_m3, a.size_m.product(), b.size_m.product())
}

/// `shared` over what `a` and `b` cover together.
fn over_union(shared: f64, a: f64, b: f64) -> f64 {
    if shared > 0.0 {
        (shared / (a + b - shared)).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// Area of the ground under both boxes; 0 where a number is not finite.
fn shared_ground_m2(a: &Detection3d, b: &Detection3d) -> f64 {
    let reach = (a.size_m.xy().norm() + b.size_m.xy().norm()) / 2.0;
    let apart = (a.center_m.xy() - b.center_m.xy()).norm();
    if apart.partial_cmp(&reach) != Some(Ordering::Less) {
        return 0.0;
    }
    intersection_m2(&footprint(a), &footprint(b))
}

/// Corners of a box seen from above, counter-clockwise.
fn footprint(of: &Detection3d) -> [Vector2<f64>; 4] {
    let (sin, cos) = of.yaw_rad.sin_cos();
    let along = Vector2::new(cos, sin) * of.size_m.x / 2.0;
    let across = Vector2::new(-sin, cos) * of.size_m.y / 2.0;
    let center = of.center_m.xy();
    [
        center + along + across,
        center - along + across,
        center - along - across,
        center + along - across,
    ]
}

/// Area shared by two counter-clockwise rectangles: Sutherland-Hodgman clipping of one by the
/// sides of the other.
fn intersection_m2(subject: &[Vector2<f64>; 4], clip: &[Vector2<f64>; 4]) -> f64 {
    let mut polygon = subject.to_vec();
    let mut clipped = Vec::with_capacity(8);
    for i in 0..4 {
        let (from, side) = (clip[i], clip[(i + 1) % 4] - clip[i]);
        let depth = |point: &Vector2<f64>| side.perp(&(point - from));
        clipped.clear();
        for (j, point) in polygon.iter().enumerate() {
            let next = &polygon[(j + 1) % polygon.len()];
            let (here, there) = (depth(point), depth(next));
            if here >= 0.0 {
                clipped.push(*point);
            }
            if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                clipped.push(point + (next - point) * (here / (here - there)));
            }
        }
        std::mem::swap(&mut polygon, &mut clipped);
    }
    let twice: f64 = (0..polygon.len())
        .map(|i| polygon[i].perp(&polygon[(i + 1) % polygon.len()]))
        .sum();
    twice.max(0.0) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::ObjectClass;
    use nalgebra::Vector3;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    fn rectangle(x: f64, y: f64, length: f64, width: f64, yaw_rad: f64, score: f64) -> Detection3d {
        Detection3d {
            center_m: Vector3::new(x, y, 0.0),
            size_m: Vector3::new(length, width, 1.5),
            yaw_rad,
            class: ObjectClass::Car,
            score,
        }
    }

    fn iou(b: Detection3d) -> f64 {
        bev_iou(&rectangle(3.0, -2.0, 4.0, 2.0, 0.0, 1.0), &b)
    }

    #[test]
    fn closed_forms() {
        let near = |value: f64, expected: f64| assert!((value - expected).abs() < 1e-12, "{value}");
        near(iou(rectangle(3.0, -2.0, 4.0, 2.0, 0.0, 1.0)), 1.0);
        near(iou(rectangle(5.0, -2.0, 4.0, 2.0, 0.0, 1.0)), 1.0 / 3.0);
        near(
            iou(rectangle(3.0, -2.0, 4.0, 2.0, FRAC_PI_2, 1.0)),
            4.0 / 12.0,
        );
        near(
            iou(rectangle(3.0, -2.0, 4.0, 2.0, 2.0 * FRAC_PI_2, 1.0)),
            1.0,
        );
        near(iou(rectangle(7.0, -2.0, 4.0, 2.0, 0.0, 1.0)), 0.0);
        // A square and itself turned by 45 degrees share a regular octagon.
        let octagon = 8.0 * (2f64.sqrt() - 1.0);
        let square = |yaw| rectangle(0.0, 0.0, 2.0, 2.0, yaw, 1.0);
        near(
            bev_iou(&square(0.0), &square(FRAC_PI_4)),
            octagon / (8.0 - octagon),
        );
        near(iou(rectangle(f64::NAN, -2.0, 4.0, 2.0, 0.0, 1.0)), 0.0);
    }

    #[test]
    fn the_better_of_two_that_overlap_survives() {
        let boxes = vec![
            rectangle(0.5, 0.0, 4.0, 2.0, 0.0, 0.6),
            rectangle(0.0, 0.0, 4.0, 2.0, 0.1, 0.9),
            rectangle(0.0, 3.5, 4.0, 2.0, 0.0, 0.3),
        ];
        let kept: Vec<_> = suppress(boxes, 0.2).iter().map(|kept| kept.score).collect();
        assert_eq!(kept, [0.9, 0.3]);
    }

    #[test]
    fn volumes_in_closed_form() {
        let at = |z: f64, height: f64| Detection3d {
            center_m: Vector3::new(3.0, -2.0, z),
            size_m: Vector3::new(4.0, 2.0, height),
            ..rectangle(0.0, 0.0, 1.0, 1.0, 0.3, 1.0)
        };
        let near = |a, b, expected: f64| {
            let iou = iou_3d(&a, &b);
            assert!((iou - expected).abs() < 1e-12, "{iou}");
        };
        near(at(0.0, 1.5), at(0.0, 1.5), 1.0);
        near(at(0.0, 1.5), at(0.5, 1.5), 1.0 / 2.0);
        near(at(0.0, 1.0), at(0.0, 2.0), 1.0 / 2.0);
        near(at(0.0, 1.5), at(1.5, 1.5), 0.0);
        near(at(0.0, 1.5), at(f64::NAN, 1.5), 0.0);
        // Shifted by a quarter of its length and by a third of its height.
        let moved = Detection3d {
            center_m: Vector3::new(1.0, 0.0, 0.5),
            ..rectangle(0.0, 0.0, 4.0, 2.0, 0.0, 1.0)
        };
        let shared = 3.0 * 2.0 * 1.0;
        near(
            rectangle(0.0, 0.0, 4.0, 2.0, 0.0, 1.0),
            moved,
            shared / (24.0 - shared),
        );
    }

    proptest! {
        #[test]
        fn volumes_overlap_like_footprints_times_heights(
            a in [-3f64..3.0, -3f64..3.0, 1f64..8.0, 1f64..3.0, -4f64..4.0],
            b in [-3f64..3.0, -3f64..3.0, 1f64..8.0, 1f64..3.0, -4f64..4.0],
            z in -2f64..2.0,
            heights in [0.5f64..3.0, 0.5f64..3.0],
        ) {
            let make = |[x, y, length, width, yaw]: [f64; 5], z, height| {
                let mut made = rectangle(x, y, length, width, yaw, 1.0);
                made.center_m.z = z;
                made.size_m.z = height;
                made
            };
            let (a, b) = (make(a, 0.0, heights[0]), make(b, z, heights[1]));
            let iou = iou_3d(&a, &b);
            prop_assert!((iou - iou_3d(&b, &a)).abs() < 1e-9);
            prop_assert!((0.0..=1.0).contains(&iou));
            prop_assert!((iou_3d(&a, &a) - 1.0).abs() < 1e-9);
            // Of equal heights at one level it is that of the footprints; else it is less.
            let level = make([b.center_m.x, b.center_m.y, b.size_m.x, b.size_m.y, b.yaw_rad], 0.0, heights[0]);
            prop_assert!((iou_3d(&a, &level) - bev_iou(&a, &b)).abs() < 1e-9);
            prop_assert!(iou <= bev_iou(&a, &b) + 1e-9);
        }

        #[test]
        fn iou_is_symmetric_and_moves_with_its_boxes(
            a in [-3f64..3.0, -3f64..3.0, 1f64..8.0, 1f64..3.0, -4f64..4.0],
            b in [-3f64..3.0, -3f64..3.0, 1f64..8.0, 1f64..3.0, -4f64..4.0],
            turn in -4f64..4.0,
        ) {
            let make = |[x, y, length, width, yaw]: [f64; 5], turn: f64| {
                let (sin, cos) = turn.sin_cos();
                rectangle(cos * x - sin * y + 9.0, sin * x + cos * y, length, width, yaw + turn, 1.0)
            };
            let before = bev_iou(&make(a, 0.0), &make(b, 0.0));
            let after = bev_iou(&make(b, turn), &make(a, turn));
            prop_assert!((before - after).abs() < 1e-9);
        }
    }
}
