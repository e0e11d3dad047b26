use covista_world::Action;
use serde::{Deserialize, Serialize};

/// The value of each action of the paper's set A.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ActionValues {
    /// Value of keep lane.
    pub keep_lane: f64,
    /// Value of change left.
    pub change_left: f64,
    /// Value of change right.
    pub change_right: f64,
}

impl ActionValues {
    /// The value of `action`; the emergency stop is outside A and worth nothing to anybody.
    pub fn get(&self, action: Action) -> f64 {
        match action {
            Action::KeepLane => self.keep_lane,
            Action::ChangeLeft => self.change_left,
            Action::ChangeRight => self.change_right,
            Action::EmergencyStop => f64::NEG_INFINITY,
        }
    }

    /// The actions by descending value; equals in the order of [`Action::ALL`], NaN last.
    pub fn in_order(&self) -> [Action; 3] {
        let rank = |action: Action| {
            let value = self.get(action);
            if value.is_nan() {
                f64::NEG_INFINITY
            } else {
                value
            }
        };
        let mut actions = Action::ALL;
        actions.sort_by(|&a, &b| rank(b).total_cmp(&rank(a)));
        actions
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Action::{ChangeLeft, ChangeRight, KeepLane};

    fn order(keep_lane: f64, change_left: f64, change_right: f64) -> [Action; 3] {
        ActionValues {
            keep_lane,
            change_left,
            change_right,
        }
        .in_order()
    }

    #[test]
    fn the_best_comes_first() {
        assert_eq!(order(1.0, 3.0, 2.0), [ChangeLeft, ChangeRight, KeepLane]);
        assert_eq!(order(0.0, 0.0, 0.0), [KeepLane, ChangeLeft, ChangeRight]);
        assert_eq!(
            order(-1.0, f64::NAN, 0.0),
            [ChangeRight, KeepLane, ChangeLeft]
        );
    }
}
