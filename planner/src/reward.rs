use covista_world::Action;

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
}
