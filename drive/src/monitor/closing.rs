use covista_control::SafetySettings;
use covista_world::{Road, STEP_S};

/// How a gap closes when the vehicle behind and the one ahead both brake as hard as they can, each
/// by the explicit Euler step of the plant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Closing {
    /// Speed that the one behind loses in a step at least.
    pub behind_loss_mps: f64,
    /// Speed that the one ahead loses in a step at most.
    pub ahead_loss_mps: f64,
    /// Lane metres per metre driven, of the one behind at most.
    pub behind_rate: f64,
    /// Lane metres per metre driven, of the one ahead at least.
    pub ahead_rate: f64,
    /// What else the gap may lose in a step.
    pub noise_m: f64,
}

impl Closing {
    /// Brakings in m/s^2, without any allowance.
    pub fn plain(behind_brake_mps2: f64, ahead_brake_mps2: f64) -> Self {
        Self {
            behind_loss_mps: behind_brake_mps2 * STEP_S,
            ahead_loss_mps: ahead_brake_mps2 * STEP_S,
            behind_rate: 1.0,
            ahead_rate: 1.0,
            noise_m: 0.0,
        }
    }

    /// With all that the promise allows for: noise, and the road's curvature for vehicles within
    /// half a lane, or a lane and a half while `changing`, of the line along which gaps are
    /// measured.
    pub fn promised(settings: &SafetySettings, road: &Road, changing: bool) -> Self {
        let curvature = road.sharpest_per_m();
        let share = |lanes: f64| {
            curvature * lanes * road.lane_width_m() / (1.0 - curvature * road.mark_offset_m(0))
        };
        Self {
            behind_loss_mps: settings.brake_mps2 * STEP_S - settings.noise_speed_mps,
            ahead_loss_mps: settings.leader_brake_mps2 * STEP_S,
            behind_rate: 1.0 + share(if changing { 1.5 } else { 0.5 }),
            ahead_rate: (1.0 - share(0.5)).max(0.0),
            noise_m: settings.noise_position_m,
        }
    }

    /// D in metres: the most by which the gap shrinks.
    ///
    /// What it shrinks by in step i is linear in i while both move: the partial sums are greatest
    /// where that changes sign, or at the end. Once the one ahead stands it only shrinks, until
    /// the other stands too.
    pub fn distance_m(&self, behind_mps: f64, ahead_mps: f64) -> f64 {
        let (v, v_k) = (behind_mps.max(0.0), ahead_mps.max(0.0));
        let moving = (v / self.behind_loss_mps).ceil();
        let both = moving.min((v_k / self.ahead_loss_mps).ceil());
        let first = (self.behind_rate * v - self.ahead_rate * v_k) * STEP_S + self.noise_m;
        let change = (self.ahead_rate * self.ahead_loss_mps
            - self.behind_rate * self.behind_loss_mps)
            * STEP_S;
        let shrunk = |steps: f64| steps * (first + 0.5 * change * (steps - 1.0));
        let turn = if change < 0.0 {
            (first / -change).ceil().clamp(0.0, both)
        } else {
            0.0
        };
        let alone = moving - both;
        let mean_mps = v - both * self.behind_loss_mps - 0.5 * self.behind_loss_mps * (alone - 1.0);
        let at_stop = shrunk(both) + alone * (self.behind_rate * mean_mps * STEP_S + self.noise_m);
        shrunk(turn).max(at_stop).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closing_distance_m;

    #[test]
    fn the_closed_form_is_the_sum() {
        for (v, v_k) in (0..80).flat_map(|i| (0..80).map(move |k| (i, k))) {
            let (v, v_k) = (0.517 * f64::from(v), 0.517 * f64::from(v_k));
            for (brake, leader_brake) in [(8.0, 8.0), (8.0, 3.0), (4.0, 8.0), (6.3, 7.1)] {
                let closed = Closing::plain(brake, leader_brake).distance_m(v, v_k);
                let summed = closing_distance_m(v, v_k, brake, leader_brake);
                assert!(
                    (closed - summed).abs() < 1e-9,
                    "{v} {v_k}: {closed} {summed}"
                );
            }
        }
    }

    #[test]
    fn the_allowance_is_never_less() {
        let settings = SafetySettings::default();
        let segment = covista_world::RoadSegment::Arc {
            length_m: 100.0,
            curvature_per_m: 0.01,
        };
        let road = Road::new(Default::default(), &[segment], 3.5).expect("a road");
        let plain = Closing::plain(settings.brake_mps2, settings.leader_brake_mps2);
        let [keeping, changing] =
            [false, true].map(|changing| Closing::promised(&settings, &road, changing));
        for (v, v_k) in (0..40).flat_map(|i| (0..40).map(move |k| (i, k))) {
            let at = |closing: Closing| closing.distance_m(f64::from(v), f64::from(v_k));
            assert!(
                at(plain) <= at(keeping) && at(keeping) <= at(changing),
                "{v} {v_k}"
            );
        }
    }
}
