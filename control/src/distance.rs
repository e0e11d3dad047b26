use covista_world::STEP_S;

use crate::SafetySettings;
use crate::monotone::largest;

/// How two vehicles in line close in on each other when both brake as hard as they can.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closing {
    /// Speed that the ego vehicle loses in a step at least: b_e Ts - W_v.
    ego_loss_mps: f64,
    /// Speed that the leader loses in a step at most: b_l Ts.
    leader_loss_mps: f64,
    /// c_max: lane metres of the ego vehicle per metre driven.
    ego_rate: f64,
    /// c_min: lane metres of the leader per metre driven.
    leader_rate: f64,
    /// c_max W_p, the position noise in metres of the lane.
    noise_position_m: f64,
}

impl Closing {
    /// With the settings' braking and noise, and c_max and c_min for the road.
    pub fn new(settings: &SafetySettings, ego_rate: f64, leader_rate: f64) -> Self {
        Self {
            ego_loss_mps: settings.brake_mps2 * STEP_S - settings.noise_speed_mps,
            leader_loss_mps: settings.leader_brake_mps2 * STEP_S,
            ego_rate,
            leader_rate,
            noise_position_m: ego_rate * settings.noise_position_m,
        }
    }

    /// D(v, v_k) = c_max W_p + sup over n of `sum_{i<n} (c_max (v_i Ts + W_i) - c_min v_{k,i} Ts)`,
    /// in metres. W_i is W_p, but for the last step before the
    /// stop, where it counts in proportion to its speed: with the term in front this bounds the
    /// noise of all steps, and D has no jump at whole numbers of steps, which rounding could fall
    /// over. At standstill D = 0.
    ///
    /// While both move the terms are linear in i, so the partial sums are a parabola whose peak is
    /// where the terms change sign, or else largest at an end; once the leader stands every term is
    /// positive. Hence the supremum is at 0, at that place or at the ego vehicle's stop.
    pub fn distance_m(&self, speed_mps: f64, leader_mps: f64) -> f64 {
        let (v, v_k) = (speed_mps.max(0.0), leader_mps.max(0.0));
        let ego_steps = steps_to_stop(v, self.ego_loss_mps);
        if ego_steps < 1.0 {
            return 0.0;
        }
        let both_steps = ego_steps.min(steps_to_stop(v_k, self.leader_loss_mps));
        let first = self.step_m(v, v_k);
        let slope =
            (self.leader_rate * self.leader_loss_mps - self.ego_rate * self.ego_loss_mps) * STEP_S;
        let sum = |n: f64| first * n + slope * n * (n - 1.0) / 2.0;

        let last = both_steps.min(ego_steps - 1.0);
        let peak = if slope < 0.0 {
            (first / -slope).ceil().clamp(0.0, last)
        } else {
            last
        };
        let alone = ego_steps - both_steps;
        let v_alone = v - both_steps * self.ego_loss_mps;
        let stop = sum(both_steps)
            + alone * (self.ego_rate * v_alone * STEP_S + self.noise_position_m)
            - self.ego_rate * self.ego_loss_mps * STEP_S * alone * (alone - 1.0) / 2.0
            - self.noise_position_m * (ego_steps - v / self.ego_loss_mps);
        self.noise_position_m + sum(peak).max(stop).max(0.0)
    }

    /// What the gap can shrink by in one step at these speeds, in metres.
    pub fn step_m(&self, speed_mps: f64, leader_mps: f64) -> f64 {
        let noise = if speed_mps > 0.0 {
            self.noise_position_m
        } else {
            0.0
        };
        (self.ego_rate * speed_mps - self.leader_rate * leader_mps) * STEP_S + noise
    }

    /// The leader's speed after one step of its hardest braking.
    pub fn leader_after_step_mps(&self, leader_mps: f64) -> f64 {
        (leader_mps - self.leader_loss_mps).max(0.0)
    }

    /// Largest speed up to `ceiling_mps` with D(v, v_k) <= `budget_m`; `None` when there is none.
    ///
    /// D is smooth between whole numbers of steps: first these are found, downwards from the ceiling,
    /// then the speed.
    pub fn max_speed_mps(&self, budget_m: f64, leader_mps: f64, ceiling_mps: f64) -> Option<f64> {
        let margin = |v: f64| budget_m - self.distance_m(v, leader_mps);
        if margin(ceiling_mps) >= 0.0 {
            return Some(ceiling_mps);
        }
        // D(0, v_k) = 0.
        if budget_m.is_nan() || budget_m < 0.0 {
            return None;
        }
        let is_met = |steps: f64| steps <= 0.0 || margin(steps * self.ego_loss_mps) >= 0.0;
        let mut no = steps_to_stop(ceiling_mps, self.ego_loss_mps);
        let mut yes = no - 1.0;
        let mut stride = 1.0;
        while !is_met(yes) {
            stride *= 2.0;
            (yes, no) = (yes - stride, yes);
        }
        yes = yes.max(0.0);
        loop {
            let steps = (0.5 * (yes + no)).floor();
            if steps <= yes || steps >= no {
                break;
            }
            if is_met(steps) {
                yes = steps;
            } else {
                no = steps;
            }
        }
        let slowest = yes * self.ego_loss_mps;
        let fastest = (no * self.ego_loss_mps).min(ceiling_mps);
        // From where on a moving vehicle has its noise.
        largest(slowest + 2e-9 * self.ego_loss_mps, fastest, margin).or(Some(slowest))
    }
}

/// Steps until `speed - i * loss` is no longer positive. The tolerance keeps the count of a speed
/// that is a whole number of losses from flickering with rounding.
fn steps_to_stop(speed_mps: f64, loss_mps: f64) -> f64 {
    (speed_mps / loss_mps - 1e-9).ceil().max(0.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn by_sum(closing: &Closing, v: f64, v_k: f64) -> f64 {
        let (mut sum, mut sup): (f64, f64) = (0.0, 0.0);
        for i in 0..100_000 {
            let v_i = v - f64::from(i) * closing.ego_loss_mps;
            let v_ki = (v_k - f64::from(i) * closing.leader_loss_mps).max(0.0);
            if v_i <= 0.0 {
                break;
            }
            let share = (v_i / closing.ego_loss_mps).min(1.0);
            sum += (closing.ego_rate * v_i - closing.leader_rate * v_ki) * STEP_S
                + closing.noise_position_m * share;
            sup = sup.max(sum);
        }
        if v > 0.0 {
            sup + closing.noise_position_m
        } else {
            0.0
        }
    }

    proptest! {
        #[test]
        fn the_closed_form_is_the_sum(
            v in 0.0..40.0_f64, v_k in 0.0..40.0_f64,
            brake in 4.0..9.0_f64, leader_brake in 3.0..9.0_f64,
            ego_rate in 1.0..1.1_f64, leader_rate in 0.9..1.0_f64, noisy in any::<bool>(),
        ) {
            let noise = if noisy { 1.0 } else { 0.0 };
            let settings = SafetySettings {
                brake_mps2: brake,
                leader_brake_mps2: leader_brake,
                noise_position_m: 1e-3 * noise,
                noise_speed_mps: 5e-3 * noise,
                ..SafetySettings::default()
            };
            let closing = Closing::new(&settings, ego_rate, leader_rate);
            let (fast, exact) = (closing.distance_m(v, v_k), by_sum(&closing, v, v_k));
            prop_assert!((fast - exact).abs() < 1e-8, "{fast} {exact}");
        }

        #[test]
        fn one_step_of_hardest_braking_uses_up_its_own_share(
            v in 0.0..40.0_f64, v_k in 0.0..40.0_f64, brake in 4.0..9.0_f64, leader_brake in 3.0..9.0_f64,
        ) {
            let settings = SafetySettings {
                brake_mps2: brake,
                leader_brake_mps2: leader_brake,
                ..SafetySettings::default()
            };
            let closing = Closing::new(&settings, 1.02, 0.98);
            let next = closing.distance_m(v - closing.ego_loss_mps, closing.leader_after_step_mps(v_k));
            prop_assert!(closing.distance_m(v, v_k) >= closing.step_m(v, v_k) + next - 1e-9);
        }

        #[test]
        fn it_has_no_jump_where_a_step_more_begins(
            steps in 1..400_u16, v_k in 0.0..40.0_f64, ego_rate in 1.0..1.1_f64,
        ) {
            let closing = Closing::new(&SafetySettings::default(), ego_rate, 1.0);
            let v = f64::from(steps) * closing.ego_loss_mps;
            let apart = closing.distance_m(v + 1e-8, v_k) - closing.distance_m(v - 1e-8, v_k);
            prop_assert!(apart.abs() < 1e-6, "{apart}");
        }

        #[test]
        fn the_largest_speed_is_the_inverse(v in 0.1..30.0_f64, v_k in 0.0..30.0_f64) {
            let closing = Closing::new(&SafetySettings::default(), 1.0, 1.0);
            let distance = closing.distance_m(v, v_k);
            let back = closing.max_speed_mps(distance, v_k, 60.0).expect("some speed");
            prop_assert!(back >= v - 1e-9);
            prop_assert!(closing.distance_m(back, v_k) <= distance + 1e-9);
        }
    }

    proptest! {
        #[test]
        fn no_larger_speed_meets_the_budget(
            v in 0.0..30.0_f64, v_k in 0.0..30.0_f64, over_m in 0.0..0.01_f64,
            ego_rate in 1.0..1.1_f64, leader_rate in 0.9..1.0_f64,
            leader_brake in 4.0..9.0_f64, whole in any::<bool>(),
        ) {
            let settings = SafetySettings {
                leader_brake_mps2: leader_brake,
                ..SafetySettings::default()
            };
            let closing = Closing::new(&settings, ego_rate, leader_rate);
            let loss = closing.ego_loss_mps;
            // At a whole number of losses D has a kink.
            let v = if whole { (v / loss).floor() * loss } else { v };
            let budget = closing.distance_m(v, v_k) + over_m;
            for ceiling in [v + 0.035, 80.0] {
                let found = closing.max_speed_mps(budget, v_k, ceiling).expect("some speed");
                prop_assert!(closing.distance_m(found, v_k) <= budget);
                prop_assert!(found >= ceiling || closing.distance_m(found + 1e-9, v_k) > budget);
            }
        }
    }

    /// Whole steps: 100 of them from 7.5 m/s, at a loss of 0.075 m/s each, and one in front.
    #[test]
    fn noise_counts_once_a_step_and_not_at_standstill() {
        let closing = Closing::new(&SafetySettings::default(), 1.0, 1.0);
        let way_m = (7.5 * 100.0 - 0.075 * 4950.0) * STEP_S + 101.0 * 1e-3;
        let distance = closing.distance_m(7.5, 0.0);
        assert!((distance - way_m).abs() < 1e-9, "{distance} {way_m}");
        assert!((closing.step_m(7.5, 0.0) - 0.076).abs() < 1e-12);
        assert!(closing.step_m(0.0, 0.0).abs() < 1e-12);
        assert!((closing.step_m(0.0, 3.0) + 0.03).abs() < 1e-12);
        assert!(closing.distance_m(0.0, 0.0).abs() < 1e-12);
    }

    #[test]
    fn stopping_from_sixteen_takes_sixteen_metres() {
        let quiet = SafetySettings {
            noise_position_m: 0.0,
            noise_speed_mps: 0.0,
            ..SafetySettings::default()
        };
        // v^2 / (2 b) = 16 m, and half a step at v for the explicit Euler update.
        let distance = Closing::new(&quiet, 1.0, 1.0).distance_m(16.0, 0.0);
        assert!((distance - 16.08).abs() < 1e-9, "{distance}");
    }
}
