use covista_world::{Action, ActionVerdict, BarrierKind};
use serde::{Deserialize, Serialize};

use crate::ActionValues;

/// What the safe action mapping made of a preference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MappedAction {
    /// The best safe action, or the emergency stop.
    pub action: Action,
    /// The better ones that were not safe, best first, each with the row that stood against it.
    pub rejected: Vec<(Action, BarrierKind)>,
}

/// The safe action mapping Phi (Alg. 1): the action of highest value for which the CBF-QP is
/// feasible, and the emergency stop where A runs out.
///
/// `verdict` is asked once for each action up to the first safe one, best first.
pub fn safe_action_mapping(
    preferences: ActionValues,
    mut verdict: impl FnMut(Action) -> ActionVerdict,
) -> MappedAction {
    let mut rejected = Vec::new();
    for action in preferences.in_order() {
        match verdict(action) {
            ActionVerdict::Safe => return MappedAction { action, rejected },
            ActionVerdict::Unsafe(barrier) => rejected.push((action, barrier)),
        }
    }
    MappedAction {
        action: Action::EmergencyStop,
        rejected,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn preferences(keep_lane: f64, change_left: f64, change_right: f64) -> ActionValues {
        ActionValues {
            keep_lane,
            change_left,
            change_right,
        }
    }

    #[test]
    fn without_a_safe_action_it_stops() {
        let mapped = safe_action_mapping(preferences(1.0, 3.0, 2.0), |_| {
            ActionVerdict::Unsafe(BarrierKind::FrontCurrent)
        });
        assert_eq!(mapped.action, Action::EmergencyStop);
        let rejected: Vec<_> = mapped.rejected.iter().map(|&(action, _)| action).collect();
        assert_eq!(
            rejected,
            [Action::ChangeLeft, Action::ChangeRight, Action::KeepLane]
        );
    }

    proptest! {
        #[test]
        fn it_takes_the_best_of_the_safe(
            values in prop::array::uniform3(-5.0..5.0_f64),
            safe in prop::array::uniform3(any::<bool>()),
        ) {
            let preferences = preferences(values[0], values[1], values[2]);
            let is_safe = |action: Action| {
                Action::ALL.iter().zip(safe).any(|(&a, safe)| a == action && safe)
            };
            let mapped = safe_action_mapping(preferences, |action| if is_safe(action) {
                ActionVerdict::Safe
            } else {
                ActionVerdict::Unsafe(BarrierKind::RearTarget)
            });
            let best = Action::ALL
                .into_iter()
                .filter(|&action| is_safe(action))
                .map(|action| preferences.get(action))
                .fold(f64::NEG_INFINITY, f64::max);
            if safe.contains(&true) {
                prop_assert!(is_safe(mapped.action));
                prop_assert!(preferences.get(mapped.action) >= best);
            } else {
                prop_assert_eq!(mapped.action, Action::EmergencyStop);
            }
            prop_assert!(mapped.rejected.iter().all(|&(action, _)| !is_safe(action)));
        }
    }
}
