use covista_world::Action;
use serde::{Deserialize, Serialize};

/// The threshold Theta of the paper's comfort in m/s^2 (the first author's public code).
pub const COMFORT_THRESHOLD_MPS2: f64 = 2.0;

/// The paper's comfort c(dv/dt, a): 3 for keeping the lane gently, 2 for keeping it otherwise, 1
/// for a lane change, 0 for an emergency stop.
pub fn comfort(accel_mps2: f64, action: Action) -> f64 {
    match action {
        Action::KeepLane if accel_mps2.abs() < COMFORT_THRESHOLD_MPS2 => 3.0,
        Action::KeepLane => 2.0,
        Action::ChangeLeft | Action::ChangeRight => 1.0,
        Action::EmergencyStop => 0.0,
    }
}

/// The reward r = omega v + c of the paper (Section V-A), less a penalty for the emergency stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Reward {
    /// omega: what a metre a second is worth.
    pub speed_weight: f64,
    /// What the emergency stop costs: more than the best reward of a behaviour step, so that no
    /// policy gains by letting the controller brake for it.
    pub emergency_stop_penalty: f64,
    /// What touching another vehicle costs, for those who learn without the promise.
    pub collision_penalty: f64,
}

impl Default for Reward {
    fn default() -> Self {
        Self {
            speed_weight: 0.1,
            emergency_stop_penalty: 10.0,
            collision_penalty: 100.0,
        }
    }
}

impl Reward {
    /// Of one behaviour step in which `action` was taken, at `speed_mps` and `accel_mps2`.
    pub fn of(&self, speed_mps: f64, accel_mps2: f64, action: Action) -> f64 {
        let penalty = if action == Action::EmergencyStop {
            self.emergency_stop_penalty
        } else {
            0.0
        };
        self.speed_weight * speed_mps + comfort(accel_mps2, action) - penalty
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comfort_is_the_papers() {
        let cases = [
            (1.99, Action::KeepLane, 3.0),
            (-1.99, Action::KeepLane, 3.0),
            (2.0, Action::KeepLane, 2.0),
            (-8.0, Action::KeepLane, 2.0),
            (0.0, Action::ChangeLeft, 1.0),
            (-8.0, Action::ChangeRight, 1.0),
            (0.0, Action::EmergencyStop, 0.0),
        ];
        for (accel_mps2, action, expected) in cases {
            assert!((comfort(accel_mps2, action) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn no_speed_makes_up_for_an_emergency_stop() {
        let reward = Reward::default();
        let stop = reward.of(40.0, -8.0, Action::EmergencyStop);
        assert!(stop < reward.of(0.0, -8.0, Action::ChangeLeft), "{stop}");
        assert!((reward.of(10.0, 0.0, Action::KeepLane) - 4.0).abs() < 1e-12);
    }
}
