use covista_world::{ControlInput, STEP_S};

use crate::SafetySettings;
use crate::barriers::bounds::Bounds;

/// Share of a bound by which rounding may exceed it.
const ROUNDING: f64 = 1e-9;

/// The last look at an input before it is applied. It trusts nothing before it: it takes the
/// settings and the vehicle's own speed, and computes the bounds anew.
///
/// An input counts when it is finite, within the actuators' bounds, within the lateral
/// acceleration, and does not make the vehicle reverse.
pub fn is_valid(
    u: ControlInput,
    speed_mps: f64,
    wheelbase_m: f64,
    safety: &SafetySettings,
) -> bool {
    let roughly = |bound: f64| bound + ROUNDING * (1.0 + bound.abs());
    let lateral_accel = speed_mps * speed_mps * u.tan_delta / wheelbase_m;
    // A NaN fails every comparison.
    u.tan_delta.abs() <= roughly(safety.tan_delta_max)
        && lateral_accel.abs() <= roughly(safety.lateral_accel_max_mps2)
        && u.accel_mps2 <= roughly(safety.accel_max_mps2)
        && u.accel_mps2 >= -roughly(safety.brake_mps2)
        && speed_mps + u.accel_mps2 * STEP_S >= -ROUNDING
}

/// Hardest braking, with the steering held as far as the tyres allow: also for a speed that is no
/// number, which is taken for any.
pub fn backup(
    speed_mps: f64,
    wheelbase_m: f64,
    last_tan_delta: f64,
    safety: &SafetySettings,
) -> ControlInput {
    let known = speed_mps.is_finite() && speed_mps >= 0.0 && wheelbase_m > 0.0;
    let held = if last_tan_delta.is_finite() {
        last_tan_delta
    } else {
        0.0
    };
    if !known {
        return ControlInput {
            tan_delta: held.clamp(-safety.tan_delta_max, safety.tan_delta_max),
            accel_mps2: -safety.brake_mps2,
        };
    }
    Bounds::new(speed_mps, wheelbase_m, safety).clamp(ControlInput {
        tan_delta: held,
        accel_mps2: -safety.brake_mps2,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHEELBASE_M: f64 = 2.51;

    fn judged(tan_delta: f64, accel_mps2: f64, speed_mps: f64) -> bool {
        let u = ControlInput {
            tan_delta,
            accel_mps2,
        };
        is_valid(u, speed_mps, WHEELBASE_M, &SafetySettings::default())
    }

    #[test]
    fn only_what_the_vehicle_can_do_is_valid() {
        assert!(judged(0.6, 3.0, 1.0) && judged(-0.6, -8.0, 1.0));
        assert!(!judged(0.61, 0.0, 1.0) && !judged(-0.61, 0.0, 1.0));
        assert!(!judged(0.0, 3.01, 10.0) && !judged(0.0, -8.01, 10.0));
        // 4 m/s^2 at 20 m/s: tan(delta) = 4 * 2.51 / 400.
        assert!(judged(0.0250, 0.0, 20.0) && judged(-0.0250, 0.0, 20.0));
        assert!(!judged(0.0252, 0.0, 20.0) && !judged(-0.0252, 0.0, 20.0));
        assert!(judged(0.0, -5.0, 0.05) && !judged(0.0, -5.1, 0.05));
        // But for rounding: 1e-9 of 1 and the bound together.
        assert!(judged(0.0, -8.0 - 8.5e-9, 10.0) && !judged(0.0, -8.0 - 9.5e-9, 10.0));
        assert!(judged(0.0, 3.0 + 3.5e-9, 10.0) && !judged(0.0, 3.0 + 4.5e-9, 10.0));
        assert!(judged(0.6 + 1.5e-9, 0.0, 1.0) && !judged(0.6 + 1.7e-9, 0.0, 1.0));
        assert!(judged(0.0, -1.0 - 5e-8, 0.01) && !judged(0.0, -1.0 - 2e-7, 0.01));
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(!judged(bad, 0.0, 10.0) && !judged(0.0, bad, 10.0) && !judged(0.0, 0.0, bad));
        }
    }

    #[test]
    fn the_backup_is_valid_at_every_speed() {
        let safety = SafetySettings::default();
        for speed_mps in [0.0, 0.03, 3.0, 14.0, 40.0] {
            for last in [-2.0, 0.0, 0.4, f64::NAN, f64::INFINITY] {
                let u = backup(speed_mps, WHEELBASE_M, last, &safety);
                assert!(is_valid(u, speed_mps, WHEELBASE_M, &safety), "{u:?}");
                let hardest = (-8.0_f64).max(-speed_mps / STEP_S);
                assert!((u.accel_mps2 - hardest).abs() < 1e-12, "{u:?}");
            }
        }
        for (speed_mps, wheelbase_m) in [
            (f64::NAN, 2.5),
            (f64::INFINITY, 2.5),
            (-1.0, 2.5),
            (9.0, f64::NAN),
            (9.0, -2.5),
            (9.0, 0.0),
        ] {
            let u = backup(speed_mps, wheelbase_m, 0.9, &safety);
            assert!((u.accel_mps2 + 8.0).abs() < 1e-12 && (u.tan_delta - 0.6).abs() < 1e-12);
            let held = backup(speed_mps, wheelbase_m, -0.1, &safety);
            assert!((held.tan_delta + 0.1).abs() < 1e-12);
            let right = backup(speed_mps, wheelbase_m, -0.9, &safety);
            assert!((right.tan_delta + 0.6).abs() < 1e-12);
        }
    }
}
