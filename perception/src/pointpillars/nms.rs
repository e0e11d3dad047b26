//! Overlap of upright boxes, and non-maximum suppression by that seen from above.

use std::cmp::Ordering;

use covista_world::Detection3d;
use nalgebra::Vector2;

/// Non-maximum suppression: boxes are added, the best first; one whose BEV IoU with a better one is
/// too great is dropped, whatever their classes: two vehicles never share their ground.
#[derive(Debug)]
pub struct Suppression {
    max_iou: f64,
    max_boxes: usize,
    kept: Vec<Detection3d>,
    footprints: Vec<[Vector2<f64>; 4]>,
}

impl Suppression {
    /// Boxes that overlap by more than `max_iou` suppress each other; at most `max_boxes` are kept.
    pub fn new(max_iou: f64, max_boxes: usize) -> Self {
        Self {
            max_iou,
            max_boxes,
            kept: Vec::new(),
            footprints: Vec::new(),
        }
    }

    /// Forgets all boxes.
    pub fn clear(&mut self) {
        self.kept.clear();
        self.footprints.clear();
    }

    /// Keeps a box unless there is no room for it or one that was added before overlaps it.
    pub fn add(&mut self, candidate: Detection3d) -> &Self {
        let ground = footprint(&candidate);
        let mut kept = self.kept.iter().zip(&self.footprints);
        let overlaps = |(better, of_better): (&Detection3d, &[Vector2<f64>; 4])| {
            are_close(better, &candidate)
                && over_union(
                    intersection_m2(of_better, &ground),
                    area_m2(better),
                    area_m2(&candidate),
                ) > self.max_iou
        };
        if !self.is_full() && !kept.any(overlaps) {
            self.kept.push(candidate);
            self.footprints.push(ground);
        }
        self
    }

    /// Whether no more boxes are kept.
    pub fn is_full(&self) -> bool {
        self.kept.len() >= self.max_boxes
    }

    /// The boxes that are left, in the order in which they were added.
    pub fn kept(&self) -> &[Detection3d] {
        &self.kept
    }
}

/// Intersection over union of the boxes' footprints, in [0, 1].
pub fn bev_iou(a: &Detection3d, b: &Detection3d) -> f64 {
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

/// Area of the footprint.
fn area_m2(of: &Detection3d) -> f64 {
    of.size_m.x * of.size_m.y
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
    if are_close(a, b) {
        intersection_m2(&footprint(a), &footprint(b))
    } else {
        0.0
    }
}

/// Whether the circles about the footprints overlap; never where a number is not finite.
fn are_close(a: &Detection3d, b: &Detection3d) -> bool {
    let reach = (a.size_m.xy().norm() + b.size_m.xy().norm()) / 2.0;
    (a.center_m.xy() - b.center_m.xy()).norm() < reach
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

/// A polygon of few corners that needs no heap.
struct Polygon {
    corners: [Vector2<f64>; 16],
    count: usize,
}

impl Polygon {
    fn new(corners: &[Vector2<f64>]) -> Self {
        let mut polygon = Self {
            corners: [Vector2::zeros(); 16],
            count: 0,
        };
        corners.iter().for_each(|corner| polygon.push(*corner));
        polygon
    }

    /// Four cuts of a rectangle leave eight corners, with rounding errors twelve at most.
    fn push(&mut self, corner: Vector2<f64>) {
        if let Some(place) = self.corners.get_mut(self.count) {
            *place = corner;
            self.count += 1;
        }
    }

    /// Each side's ends, counter-clockwise.
    fn sides(&self) -> impl Iterator<Item = (&Vector2<f64>, &Vector2<f64>)> {
        let corners = &self.corners[..self.count];
        corners.iter().zip(corners.iter().cycle().skip(1))
    }
}

/// Area shared by two counter-clockwise rectangles: Sutherland-Hodgman clipping of one by the
/// sides of the other.
fn intersection_m2(subject: &[Vector2<f64>; 4], clip: &[Vector2<f64>; 4]) -> f64 {
    let mut polygon = Polygon::new(subject);
    for (from, to) in Polygon::new(clip).sides() {
        let depth = |point: &Vector2<f64>| (to - from).perp(&(point - from));
        let mut clipped = Polygon::new(&[]);
        for (point, next) in polygon.sides() {
            let (here, there) = (depth(point), depth(next));
            if here >= 0.0 {
                clipped.push(*point);
            }
            if (here > 0.0 && there < 0.0) || (here < 0.0 && there > 0.0) {
                clipped.push(point + (next - point) * (here / (here - there)));
            }
        }
        polygon = clipped;
    }
    let twice: f64 = polygon.sides().map(|(a, b)| a.perp(b)).sum();
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
        let boxes = [
            rectangle(0.0, 0.0, 4.0, 2.0, 0.1, 0.9),
            rectangle(0.5, 0.0, 4.0, 2.0, 0.0, 0.6),
            rectangle(0.0, 3.5, 4.0, 2.0, 0.0, 0.3),
        ];
        let kept = |max_boxes: usize| {
            let mut suppression = Suppression::new(0.2, max_boxes);
            for candidate in &boxes {
                suppression.add(*candidate);
            }
            let scores = suppression.kept().iter().map(|kept| kept.score);
            scores.collect::<Vec<_>>()
        };
        assert_eq!(kept(9), [0.9, 0.3]);
        assert_eq!(kept(1), [0.9]);
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
