use covista_world::{Road, RoadError, RoadSegment, Se2Pose};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Sharpest and widest radius of a drawn curve, in metres.
const RADIUS_M: [f64; 2] = [40.0, 1000.0];
/// Angle by which one curve turns at most, in radians: a road must not meet itself.
const TURN_RAD: f64 = 2.4;
/// Straight road behind every curve.
const RUN_OUT_M: f64 = 400.0;
const LANE_WIDTHS_M: [f64; 2] = [3.25, 3.75];

/// The shape of a road.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    Straight,
    /// Constant curvature that begins at once, without a clothoid.
    Arc,
    /// Clothoid, arc, clothoid.
    Curve,
    /// Two curves, the second the other way.
    SCurve,
}

const SHAPES: [Shape; 4] = [Shape::Straight, Shape::Arc, Shape::Curve, Shape::SCurve];

/// A road drawn at random: straight, an arc, a curve between clothoids or an S, to the left or to
/// the right, with radii from 40 m to 1 km.
pub(super) fn draw_road(dice: &mut ChaCha8Rng) -> Result<Road, RoadError> {
    let shape = SHAPES[dice.random_range(0..SHAPES.len())];
    let radius_m = log_uniform(dice, RADIUS_M);
    let curvature = if dice.random() { 1.0 } else { -1.0 } / radius_m;
    let lead_in = RoadSegment::Straight {
        length_m: dice.random_range(30.0..150.0),
    };
    let run_out = RoadSegment::Straight {
        length_m: RUN_OUT_M,
    };
    let mut segments = vec![lead_in];
    match shape {
        Shape::Straight => {}
        Shape::Arc => segments.push(RoadSegment::Arc {
            length_m: dice.random_range(50.0..600.0_f64).min(TURN_RAD * radius_m),
            curvature_per_m: curvature,
        }),
        Shape::Curve => segments.extend(curve(dice, curvature)),
        Shape::SCurve => {
            segments.extend(curve(dice, curvature));
            if dice.random() {
                segments.push(lead_in);
            }
            let back = -curvature.signum() / log_uniform(dice, RADIUS_M);
            segments.extend(curve(dice, back));
        }
    }
    segments.push(run_out);
    let start = Se2Pose::new(
        dice.random_range(-500.0..500.0),
        dice.random_range(-500.0..500.0),
        dice.random_range(-3.0..3.0),
    );
    Road::new(
        start,
        &segments,
        dice.random_range(LANE_WIDTHS_M[0]..LANE_WIDTHS_M[1]),
    )
}

/// Clothoid, arc, clothoid, which together turn by at most [`TURN_RAD`].
fn curve(dice: &mut ChaCha8Rng, curvature_per_m: f64) -> [RoadSegment; 3] {
    let clothoid_m = dice.random_range(15.0..90.0_f64);
    let left_m = (TURN_RAD / curvature_per_m.abs() - clothoid_m).max(5.0);
    let arc_m = dice.random_range(5.0..300.0_f64).min(left_m);
    [
        RoadSegment::Clothoid {
            length_m: clothoid_m,
            from_per_m: 0.0,
            to_per_m: curvature_per_m,
        },
        RoadSegment::Arc {
            length_m: arc_m,
            curvature_per_m,
        },
        RoadSegment::Clothoid {
            length_m: clothoid_m,
            from_per_m: curvature_per_m,
            to_per_m: 0.0,
        },
    ]
}

fn log_uniform(dice: &mut ChaCha8Rng, [low, high]: [f64; 2]) -> f64 {
    dice.random_range(low.ln()..high.ln()).exp()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn every_road_can_be_built_and_both_ways_are_drawn() {
        let mut dice = ChaCha8Rng::seed_from_u64(1);
        let (mut left, mut right) = (0, 0);
        for _ in 0..500 {
            let road = draw_road(&mut dice).expect("a road");
            assert!(road.length_m() > RUN_OUT_M);
            let at = |i: i32| road.curvature(0.01 * f64::from(i) * road.length_m());
            left += usize::from((0..100).any(|i| at(i) > 1e-4));
            right += usize::from((0..100).any(|i| at(i) < -1e-4));
        }
        assert!(left > 100 && right > 100, "{left} {right}");
    }
}
