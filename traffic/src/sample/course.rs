use std::f64::consts::PI;
use std::ops::Range;

use covista_world::{Road, RoadSegment, Se2Pose};
use rand::Rng;

/// The road of a scene and where on it the ego is.
pub(super) struct Course {
    pub road: Road,
    pub ego_s_m: f64,
}

impl Course {
    /// Half of the roads are straight; the others have one or two bends between clothoids.
    pub(super) fn draw(rng: &mut impl Rng, lane_width_m: Range<f64>) -> Self {
        loop {
            let mut segments = vec![straight(rng, 20.0..120.0)];
            if rng.random_bool(0.5) {
                let bends = rng.random_range(1..=2);
                for _ in 0..bends {
                    segments.extend(draw_bend(rng));
                    segments.push(straight(rng, 10.0..100.0));
                }
            } else {
                segments.push(straight(rng, 100.0..200.0));
            }
            let start = Se2Pose::new(
                rng.random_range(-200.0..200.0),
                rng.random_range(-200.0..200.0),
                rng.random_range(-PI..PI),
            );
            // Radii from 50 m up are never too tight, so this is the first turn of the loop.
            let lane_width_m = rng.random_range(lane_width_m.clone());
            if let Ok(road) = Road::new(start, &segments, lane_width_m) {
                let ego_s_m = rng.random_range(20.0..road.length_m() - 20.0);
                return Self { road, ego_s_m };
            }
        }
    }
}

fn straight(rng: &mut impl Rng, length_m: Range<f64>) -> RoadSegment {
    RoadSegment::Straight {
        length_m: rng.random_range(length_m),
    }
}

/// Clothoid, arc, clothoid; at most a right angle in all.
fn draw_bend(rng: &mut impl Rng) -> [RoadSegment; 3] {
    let radius_m = 50.0 * (16.0_f64).powf(rng.random_range(0.0..1.0));
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let curvature_per_m = side / radius_m;
    let clothoid_m = rng.random_range(20.0..50.0);
    let arc_max_m = (1.5 * radius_m - clothoid_m).clamp(15.0, 140.0);
    [
        RoadSegment::Clothoid {
            length_m: clothoid_m,
            from_per_m: 0.0,
            to_per_m: curvature_per_m,
        },
        RoadSegment::Arc {
            length_m: rng.random_range(10.0..arc_max_m),
            curvature_per_m,
        },
        RoadSegment::Clothoid {
            length_m: clothoid_m,
            from_per_m: curvature_per_m,
            to_per_m: 0.0,
        },
    ]
}
