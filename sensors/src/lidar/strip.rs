//! The road about a LIDAR as a chain of short arcs: which paint a spot on the ground lies on.

use covista_traffic::{MarkStyle, Scene};
use nalgebra::{Vector2, Vector3};

use crate::carriageway::{Carriageway, texture_seed};
use crate::noise::value_noise;

const SPACING_M: f32 = 2.0;

/// What the ground is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Ground {
    /// Asphalt with this reflectance.
    Asphalt(f32),
    /// Lane paint with this reflectance.
    Paint(f32),
    /// Grass and weeds beside the road.
    Grass,
}

/// A painted line: from and to where it reaches across the road.
struct Stripe {
    from_m: f32,
    to_m: f32,
    dashed: bool,
}

struct Node {
    position: Vector2<f32>,
    forward: Vector2<f32>,
    curvature_per_m: f32,
}

/// The road within a LIDAR's range.
pub(super) struct RoadStrip {
    first_s_m: f32,
    nodes: Vec<Node>,
    stripes: Vec<Stripe>,
    /// Left and right end of the pavement.
    paved_m: [f32; 2],
    dash_m: f32,
    dash_period_m: f32,
    dash_offset_m: f32,
    asphalt: f32,
    paint: f32,
    seed: u32,
}

impl RoadStrip {
    pub(super) fn new(scene: &Scene, around: Vector2<f64>, reach_m: f64) -> Self {
        let (road, look) = (&scene.road, &scene.look);
        let carriageway = Carriageway::new(scene);
        let middle_s_m = road.to_frenet(around).s_m;
        let steps = (reach_m / f64::from(SPACING_M)).ceil();
        let first_s_m = middle_s_m - steps * f64::from(SPACING_M);
        let nodes = (0..=2 * steps as usize).map(|index| {
            let (pose, curvature) = road.reference(first_s_m + index as f64 * f64::from(SPACING_M));
            let (sin, cos) = pose.yaw_rad.sin_cos();
            Node {
                position: pose.position().cast(),
                forward: Vector2::new(cos, sin).cast(),
                curvature_per_m: curvature as f32,
            }
        });
        Self {
            first_s_m: first_s_m as f32,
            nodes: nodes.collect(),
            stripes: stripes(&carriageway),
            paved_m: carriageway.edges_m.map(|edge_m| edge_m as f32),
            dash_m: carriageway.dash_m as f32,
            dash_period_m: carriageway.dash_period_m as f32,
            dash_offset_m: carriageway.dash_offset_m as f32,
            asphalt: 0.23 + 0.3 * look.asphalt_albedo.clamp(0.0, 1.0) as f32,
            paint: 0.80 - 0.4 * look.paint_wear.clamp(0.0, 1.0) as f32,
            seed: texture_seed(look),
        }
    }

    /// The node beside the LIDAR.
    pub(super) fn middle(&self) -> usize {
        self.nodes.len() / 2
    }

    /// What lies at `position`, whose node `near` was of the spot before.
    pub(super) fn at(&self, position: Vector2<f32>, near: &mut usize) -> Ground {
        let (s_m, d_m) = self.frenet(position, near);
        let [left_m, right_m] = self.paved_m;
        if d_m > left_m || d_m < right_m {
            return Ground::Grass;
        }
        let painted = self.stripes.iter().any(|stripe| {
            (stripe.from_m..stripe.to_m).contains(&d_m) && (!stripe.dashed || self.in_dash(s_m))
        });
        if painted {
            return Ground::Paint(self.paint);
        }
        let patch = value_noise(
            self.seed ^ 61,
            f64::from(position.x) / 3.0,
            f64::from(position.y) / 3.0,
        );
        Ground::Asphalt(self.asphalt * (1.0 + 0.1 * patch))
    }

    /// Position along and across the road, to centimetres.
    fn frenet(&self, position: Vector2<f32>, near: &mut usize) -> (f32, f32) {
        let last = self.nodes.len() - 1;
        let mut found = (0.0, 0.0);
        for _ in 0..8 {
            let node = &self.nodes[*near];
            let gap = position - node.position;
            let (x, y) = (node.forward.dot(&gap), node.forward.perp(&gap));
            let bend = (1.0 - node.curvature_per_m * y).max(0.2);
            let along_m = x / bend;
            found = (
                self.first_s_m + *near as f32 * SPACING_M + along_m,
                y - 0.5 * node.curvature_per_m * x * x / bend,
            );
            let next = (*near as f32 + along_m / SPACING_M + 0.5).max(0.0) as usize;
            let next = next.min(last);
            if next == *near {
                break;
            }
            *near = next;
        }
        found
    }

    fn in_dash(&self, s_m: f32) -> bool {
        let periods = (s_m - self.dash_offset_m) / self.dash_period_m;
        (periods - periods.floor()) * self.dash_period_m < self.dash_m
    }
}

/// Paint of all lanes of the carriageway.
fn stripes(road: &Carriageway) -> Vec<Stripe> {
    let half_m = road.paint_width_m / 2.0;
    let marks = road.styles.iter().enumerate();
    let stripes = marks.flat_map(|(mark, &style)| {
        let lines = road.lines_m(style);
        lines.map(move |line_m| {
            let center_m = road.mark_m(mark) + line_m;
            Stripe {
                from_m: (center_m - half_m) as f32,
                to_m: (center_m + half_m) as f32,
                dashed: style == MarkStyle::Dashed,
            }
        })
    });
    stripes.collect()
}

/// Where the ground lies `direction` away, seen from above.
pub(super) fn spot(
    origin: &Vector3<f32>,
    direction: &Vector3<f32>,
    distance_m: f32,
) -> Vector2<f32> {
    (origin + direction * distance_m).xy()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use covista_world::{FrenetPoint, Road, RoadSegment, Se2Pose};
    use proptest::prelude::*;

    use super::*;
    use crate::testing::empty_road;

    /// A bend of 80 m radius behind a transition.
    fn bend() -> Scene {
        let segments = [
            RoadSegment::Straight { length_m: 60.0 },
            RoadSegment::Clothoid {
                length_m: 30.0,
                from_per_m: 0.0,
                to_per_m: -1.0 / 80.0,
            },
            RoadSegment::Arc {
                length_m: 60.0,
                curvature_per_m: -1.0 / 80.0,
            },
        ];
        let start = Se2Pose::new(200.0, -100.0, 0.4);
        Scene {
            road: Arc::new(Road::new(start, &segments, 3.5).expect("a road")),
            ..empty_road()
        }
    }

    proptest! {
        #[test]
        fn the_strip_agrees_with_the_road(s_m in 0.0..150.0_f64, d_m in -12.0..12.0_f64, guess in 0_usize..100) {
            let scene = bend();
            let at = |s_m, d_m| scene.road.from_frenet(FrenetPoint { s_m, d_m });
            let strip = RoadStrip::new(&scene, at(75.0, 0.0), 100.0);
            let (s, d) = strip.frenet(at(s_m, d_m).cast(), &mut { guess });
            prop_assert!((f64::from(d) - d_m).abs() < 0.01, "{d} {d_m}");
            prop_assert!((f64::from(s) - s_m).abs() < 0.02, "{s} {s_m}");
        }
    }

    #[test]
    fn marks_are_painted_as_the_scene_says() {
        let mut scene = bend();
        scene.markings.styles = [
            MarkStyle::Double,
            MarkStyle::None,
            MarkStyle::Dashed,
            MarkStyle::Solid,
        ];
        scene.markings.lanes_beyond = [0, 1];
        let around = scene.road.from_frenet(FrenetPoint {
            s_m: 75.0,
            d_m: 0.0,
        });
        let strip = RoadStrip::new(&scene, around, 100.0);
        let share = |d_m: f64| {
            let painted = (0..600).filter(|step| {
                let s_m = 20.0 + 0.2 * f64::from(*step);
                let position = scene.road.from_frenet(FrenetPoint { s_m, d_m });
                matches!(strip.at(position.cast(), &mut 0), Ground::Paint(_))
            });
            painted.count() as f64 / 600.0
        };
        let close = |found: f64, expected: f64| assert!((found - expected).abs() < 0.02, "{found}");
        close(share(5.25), 0.0);
        close(share(5.25 + 0.15), 1.0);
        close(share(5.25 - 0.15), 1.0);
        close(share(1.75), 0.0);
        close(share(-1.75), 0.25);
        close(share(-5.25), 1.0);
        close(share(-8.75), 1.0);
        assert_eq!(
            strip.at(
                scene
                    .road
                    .from_frenet(FrenetPoint {
                        s_m: 50.0,
                        d_m: -11.0
                    })
                    .cast(),
                &mut 0
            ),
            Ground::Grass
        );
    }
}
