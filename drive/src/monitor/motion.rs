use covista_control::SafetySettings;
use covista_traffic::VehicleKind;
use covista_world::{BicycleState, STEP_S, bicycle_step, wrap_angle};

use super::{CavView, MEMORY_S};
use crate::truth::TrueVehicle;

/// Slower than this for [`STUCK_S`] on end counts as stuck.
pub(super) const STUCK_MPS: f64 = 0.5;
const STUCK_S: f64 = 5.0;
/// What sums of floating-point numbers may differ by, in m, m/s and rad.
const ROUND_OFF: f64 = 1e-6;

/// When something was last seen to happen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Last(Option<f64>);

impl Last {
    pub fn note(&mut self, time_s: f64) {
        self.0 = Some(time_s);
    }

    /// Whether it may still explain what happens at `time_s`.
    pub fn explains(self, time_s: f64) -> bool {
        self.0.is_some_and(|last_s| time_s - last_s < MEMORY_S)
    }
}

/// How one vehicle moves, from step to step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Motion {
    before: Option<(f64, f64)>,
    slow_since_s: Option<f64>,
    /// Whether it was stuck at some time.
    pub stuck: bool,
    /// Acceleration along the road over the last step in m/s^2.
    pub accel_mps2: f64,
    /// It lost more than b_l of its speed along the road, or drove backwards.
    pub braked_too_hard: Last,
    /// It gained more than a_b.
    pub accelerated_too_hard: Last,
}

impl Motion {
    pub fn step(&mut self, time_s: f64, vehicle: &TrueVehicle, settings: &SafetySettings) {
        if vehicle.kind == VehicleKind::Obstacle {
            return;
        }
        self.note_standstill(time_s, vehicle);
        let along_mps = vehicle.along_mps();
        if along_mps < -ROUND_OFF {
            self.braked_too_hard.note(time_s);
        }
        let before = self.before.replace((time_s, along_mps));
        let Some((dt_s, change_mps)) = before
            .map(|(before_s, before_mps)| (time_s - before_s, along_mps - before_mps))
            .filter(|(dt_s, _)| *dt_s > 0.0)
        else {
            return;
        };
        self.accel_mps2 = change_mps / dt_s;
        let braked_mps = settings.leader_brake_mps2 * dt_s + ROUND_OFF;
        if change_mps < -braked_mps {
            self.braked_too_hard.note(time_s);
        }
        if change_mps > settings.follower_accel_mps2 * dt_s + ROUND_OFF {
            self.accelerated_too_hard.note(time_s);
        }
    }

    fn note_standstill(&mut self, time_s: f64, vehicle: &TrueVehicle) {
        if vehicle.speed_mps >= STUCK_MPS {
            self.slow_since_s = None;
            return;
        }
        let since_s = *self.slow_since_s.get_or_insert(time_s);
        self.stuck |= time_s - since_s >= STUCK_S;
    }
}

/// Whether a CAV moves as its input says.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plant {
    /// Where the last input should have led by now, and from where.
    expected: Option<Expected>,
    /// It did not move as its input says.
    pub strayed: Last,
}

#[derive(Debug, Clone, Copy)]
struct Expected {
    time_s: f64,
    from: BicycleState,
    to: BicycleState,
}

impl Plant {
    pub fn step(&mut self, time_s: f64, view: &CavView<'_>, settings: &SafetySettings) {
        let next = view.input.map(|input| Expected {
            time_s: time_s + STEP_S,
            from: view.state,
            to: bicycle_step(view.state, input, view.wheelbase_m),
        });
        let expected = std::mem::replace(&mut self.expected, next);
        if expected.is_some_and(|expected| {
            (time_s - expected.time_s).abs() < STEP_S / 2.0
                && !expected.allows(&view.state, settings)
        }) {
            self.strayed.note(time_s);
        }
    }
}

impl Expected {
    /// Whether the bounds on noise allow `now`: along the heading, in speed, across the heading
    /// and in the angle turned; none of them at standstill.
    fn allows(&self, now: &BicycleState, settings: &SafetySettings) -> bool {
        let moving = f64::from(u8::from(
            self.from.speed_mps > 0.0 || self.to.speed_mps > 0.0,
        ));
        let driven_m = self.from.speed_mps * STEP_S;
        let moved = now.pose.position() - self.from.pose.position();
        let forward = self.from.pose.forward();
        let along_m = moved.dot(&forward) - driven_m;
        let across_m = forward.perp(&moved);
        let turned_rad = wrap_angle(now.pose.yaw_rad - self.to.pose.yaw_rad);
        let gained_mps = now.speed_mps - self.to.speed_mps;

        let position_m = settings.noise_position_m * moving;
        let errors = [
            (along_m, position_m),
            (
                across_m,
                (driven_m + position_m) * settings.noise_slip_rad.tan(),
            ),
            (turned_rad, driven_m * settings.noise_curvature_per_m),
            (gained_mps, settings.noise_speed_mps * moving),
        ];
        errors
            .iter()
            .all(|(error, bound)| error.abs() <= bound + ROUND_OFF)
    }
}
