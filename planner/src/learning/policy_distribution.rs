use rand::Rng;

use covista_world::Action;

use super::{ACTIONS, ActionSet, CHOICES, action_index};

/// Phi(pi): the softmax of the logits over the safe actions alone; all on the emergency stop where
/// there is none.
pub(super) fn mapped_distribution(logits: &[f32], safe: ActionSet) -> [f32; ACTIONS] {
    let mut shares = [0.0; ACTIONS];
    let best = safe
        .iter()
        .map(|action| logits[action_index(action)])
        .fold(f32::NEG_INFINITY, f32::max);
    let mut sum = 0.0;
    for action in safe.iter() {
        let index = action_index(action);
        shares[index] = (logits[index] - best).exp();
        sum += shares[index];
    }
    if safe.is_empty() {
        shares[action_index(Action::EmergencyStop)] = 1.0;
    } else {
        shares.iter_mut().for_each(|share| *share /= sum);
    }
    shares
}

/// Phi(a) of Alg. 1 for the actor's best action: of the safe ones the one of highest logit, the emergency stop
/// where none is safe.
///
/// # Panics
/// With fewer logits than [`super::CHOICES`].
pub fn mapped_best(logits: &[f32], safe: ActionSet) -> Action {
    safe.iter()
        .reduce(|best, action| {
            let is_better = logits[action_index(action)] > logits[action_index(best)];
            if is_better { action } else { best }
        })
        .unwrap_or(Action::EmergencyStop)
}

/// A safe action at random, each as likely; the emergency stop where none is safe.
pub fn any_of(safe: ActionSet, rng: &mut impl Rng) -> Action {
    match safe.len() {
        0 => Action::EmergencyStop,
        len => safe
            .iter()
            .nth(rng.random_range(0..len))
            .unwrap_or(Action::EmergencyStop),
    }
}

/// The gradient by the logits of J = sum_a p_a Q_a + `entropy_weight` H(p), p = Phi(pi).
pub(super) fn objective_gradient(
    shares: &[f32; ACTIONS],
    values: &[f32],
    entropy_weight: f32,
) -> [f32; CHOICES] {
    let worth: [f32; CHOICES] = std::array::from_fn(|index| {
        let surprise = -shares[index].max(f32::MIN_POSITIVE).ln();
        values[index] + entropy_weight * surprise
    });
    let mean: f32 = worth
        .iter()
        .zip(shares)
        .map(|(worth, share)| worth * share)
        .sum();
    std::array::from_fn(|index| shares[index] * (worth[index] - mean))
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // these numbers are exact
mod tests {
    use super::*;
    use Action::{ChangeLeft, ChangeRight, EmergencyStop, KeepLane};

    fn set(actions: &[Action]) -> ActionSet {
        actions.iter().copied().collect()
    }

    #[test]
    fn nothing_unsafe_has_a_share() {
        let shares = mapped_distribution(&[100.0, 1.0, 0.0], set(&[ChangeLeft, ChangeRight]));
        assert_eq!((shares[0], shares[3]), (0.0, 0.0));
        let e = std::f32::consts::E;
        assert!((shares[1] - e / (1.0 + e)).abs() < 1e-6);
        let stopped = mapped_distribution(&[1.0, 2.0, 3.0], ActionSet::EMPTY);
        assert_eq!(stopped, [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn the_best_safe_action_is_taken() {
        let logits = [1.0, 5.0, 2.0];
        assert_eq!(mapped_best(&logits, ActionSet::ALL), ChangeLeft);
        assert_eq!(
            mapped_best(&logits, set(&[KeepLane, ChangeRight])),
            ChangeRight
        );
        assert_eq!(mapped_best(&logits, ActionSet::EMPTY), EmergencyStop);
    }

    #[test]
    fn the_gradient_is_that_of_the_objective() {
        let (logits, values, weight) = ([0.3_f32, -0.8, 0.9], [1.0_f32, 4.0, -2.0, 9.0], 0.7);
        let objective = |logits: &[f32; 3], safe| {
            let shares = mapped_distribution(logits, safe);
            shares
                .iter()
                .zip(values)
                .map(|(&p, q)| {
                    f64::from(p * q) - f64::from(weight * if p > 0.0 { p * p.ln() } else { 0.0 })
                })
                .sum::<f64>()
        };
        for safe in [
            ActionSet::ALL,
            set(&[KeepLane, ChangeRight]),
            set(&[ChangeLeft]),
            ActionSet::EMPTY,
        ] {
            let gradient = objective_gradient(&mapped_distribution(&logits, safe), &values, weight);
            for index in 0..3 {
                let moved = |by: f32| {
                    let mut logits = logits;
                    logits[index] += by;
                    objective(&logits, safe)
                };
                let slope = (moved(1e-2) - moved(-1e-2)) / 2e-2;
                assert!(
                    (slope - f64::from(gradient[index])).abs() < 1e-3,
                    "{safe:?} {index}"
                );
            }
        }
    }
}
