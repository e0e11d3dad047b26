use serde::{Deserialize, Serialize};

use super::PAIRS;

/// What truncating the global Q^i to the kappa-hop neighbourhood costs, over all (s, a).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TruncationErrors {
    /// Hops.
    pub kappa: usize,
    /// Largest |truncated - global| where all others stand and wait: the paper's definition, with
    /// its "0".
    pub zeros_largest: f64,
    /// The same, mean over all (s, a).
    pub zeros_mean: f64,
    /// Largest, where the truncated value is the mean over the others' states and actions.
    pub uniform_largest: f64,
    /// The same, mean over all (s, a).
    pub uniform_mean: f64,
    /// Largest with the worst weights of the others' states and actions: what the exponential
    /// decay property bounds.
    pub worst_largest: f64,
    /// Share of (s, a) of the others in which the better own action by the truncated value (zeros)
    /// is not the better one by the global.
    pub greedy_wrong: f64,
    /// What that costs of the global value at the most.
    pub greedy_loss_largest: f64,
    /// The same, mean over all.
    pub greedy_loss_mean: f64,
}

/// The errors of one vehicle's `q`, as [`super::Evaluation::q`] orders it, among `n` vehicles.
pub fn truncation_errors(q: &[f64], n: usize, kappa: usize) -> TruncationErrors {
    let inside = n.min(1 + 2 * kappa);
    let alike = PAIRS.pow((n - inside) as u32);
    let mut errors = TruncationErrors {
        kappa,
        zeros_largest: 0.0,
        zeros_mean: 0.0,
        uniform_largest: 0.0,
        uniform_mean: 0.0,
        worst_largest: 0.0,
        greedy_wrong: 0.0,
        greedy_loss_largest: 0.0,
        greedy_loss_mean: 0.0,
    };
    for global in q.chunks(alike) {
        let uniform = global.iter().sum::<f64>() / alike as f64;
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for &value in global {
            least = least.min(value);
            most = most.max(value);
            let (zeros, uniform) = ((global[0] - value).abs(), (uniform - value).abs());
            errors.zeros_largest = errors.zeros_largest.max(zeros);
            errors.zeros_mean += zeros / q.len() as f64;
            errors.uniform_largest = errors.uniform_largest.max(uniform);
            errors.uniform_mean += uniform / q.len() as f64;
        }
        errors.worst_largest = errors.worst_largest.max(most - least);
    }
    errors.look_for_greedy(q, alike);
    errors
}

impl TruncationErrors {
    /// The own pair is the leading digit of the index, the own action its last bit.
    fn look_for_greedy(&mut self, q: &[f64], alike: usize) {
        let others = q.len() / PAIRS;
        // A power of two.
        let truncated = |index: usize| q[index & !(alike - 1)];
        for (state, of_state) in q.chunks(2 * others).enumerate() {
            let first = state * 2 * others;
            for rest in 0..others {
                let (waits, goes) = (of_state[rest], of_state[others + rest]);
                let prefers_going = truncated(first + others + rest) > truncated(first + rest);
                let loss = waits.max(goes) - if prefers_going { goes } else { waits };
                let share = 1.0 / (2 * others) as f64;
                self.greedy_wrong += share * f64::from(u8::from(loss > 0.0));
                self.greedy_loss_largest = self.greedy_loss_largest.max(loss);
                self.greedy_loss_mean += share * loss;
            }
        }
    }

    /// Of several vehicles: the largest of what is largest, the mean of what is a mean.
    pub fn merged(all: &[Self]) -> Option<Self> {
        let kappa = all.first()?.kappa;
        let largest = |of: fn(&Self) -> f64| all.iter().map(of).fold(0.0, f64::max);
        let mean = |of: fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        Some(Self {
            kappa,
            zeros_largest: largest(|of| of.zeros_largest),
            zeros_mean: mean(|of| of.zeros_mean),
            uniform_largest: largest(|of| of.uniform_largest),
            uniform_mean: mean(|of| of.uniform_mean),
            worst_largest: largest(|of| of.worst_largest),
            greedy_wrong: mean(|of| of.greedy_wrong),
            greedy_loss_largest: largest(|of| of.greedy_loss_largest),
            greedy_loss_mean: mean(|of| of.greedy_loss_mean),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::networked::{Evaluation, RingGame};

    fn all(game: &RingGame, discount: f64, kappa: usize) -> Vec<TruncationErrors> {
        let evaluation = Evaluation::of(game, discount).expect("values");
        (0..game.len())
            .map(|i| truncation_errors(&evaluation.q(i), game.len(), kappa))
            .collect()
    }

    /// The global Q in a plain order of vehicles, truncated by the definition.
    #[test]
    fn errors_are_those_of_the_definition() {
        let (game, n, kappa) = (RingGame::traffic(5, 11), 5, 1);
        let (i, order) = (3, game.by_distance(3));
        let q = Evaluation::of(&game, 0.8).expect("values").q(i);
        let index = |pairs: &[usize]| order.iter().fold(0, |index, &j| index * PAIRS + pairs[j]);
        let pairs = |mut number: usize| -> Vec<usize> {
            let mut pairs = vec![0; n];
            for pair in &mut pairs {
                *pair = number % PAIRS;
                number /= PAIRS;
            }
            pairs
        };
        let (mut largest, mut sum) = (0.0_f64, 0.0);
        for number in 0..q.len() {
            let global = pairs(number);
            let mut zeros = global.clone();
            (zeros[0], zeros[1]) = (0, 0);
            let error = (q[index(&zeros)] - q[index(&global)]).abs();
            largest = largest.max(error);
            sum += error;
        }
        let found = truncation_errors(&q, n, kappa);
        assert!(largest > 0.01 && (found.zeros_largest - largest).abs() < 1e-15);
        assert!((found.zeros_mean - sum / q.len() as f64).abs() < 1e-12);
        assert!(found.worst_largest >= found.zeros_largest.max(found.uniform_largest));
    }

    #[test]
    fn nothing_is_lost_when_everybody_is_inside() {
        for (n, kappa) in [(6, 3), (7, 3), (2, 1), (5, 9)] {
            for errors in all(&RingGame::traffic(n, 5), 0.9, kappa) {
                assert_eq!(errors.worst_largest.to_bits(), 0, "{errors:?}");
                assert_eq!(errors.zeros_largest.to_bits(), 0, "{errors:?}");
                assert!(errors.uniform_largest.to_bits() == 0 && errors.greedy_loss_largest == 0.0);
            }
        }
    }

    #[test]
    fn without_a_future_nobody_else_matters() {
        for errors in all(&RingGame::traffic(5, 5), 0.0, 0) {
            assert_eq!(errors.worst_largest.to_bits(), 0, "{errors:?}");
        }
    }

    /// No game of the theorem's can lose more than gamma^(floor(kappa / 2) + 1) / (1 - gamma) of
    /// the rewards' span, and the relay loses all of that.
    #[test]
    fn the_relay_loses_all_that_can_be_lost() {
        for (n, discount) in [(8, 0.9), (7, 0.5)] {
            for kappa in 0..n / 2 {
                let steps = kappa as i32 / 2 + 1;
                let bound = f64::powi(discount, steps) / (1.0 - discount);
                for errors in all(&RingGame::relay(n), discount, kappa) {
                    assert!(
                        (errors.zeros_largest / bound - 1.0).abs() < 1e-12,
                        "{n} {kappa}"
                    );
                    assert!((errors.worst_largest / bound - 1.0).abs() < 1e-12);
                }
            }
        }
    }

    /// An upper bound of the rewards alone is no condition: here it is 0, and the errors are not.
    #[test]
    fn rewards_below_zero_break_the_bound_as_the_paper_words_it() {
        let mut game = RingGame::relay(6);
        game.reward = game.reward.map(|reward| reward - 1.0);
        let most = game.reward.into_iter().fold(f64::NEG_INFINITY, f64::max);
        assert!(most == 0.0 && all(&game, 0.9, 2)[0].zeros_largest > 8.0);
    }

    #[test]
    fn a_wrong_greedy_action_costs_what_the_better_one_is_worth() {
        // Standing: going is better by 1 unless the other one moves or goes; truncated, always.
        let q = [
            [0.0, 2.0, 2.0, 2.0],
            [1.0, 1.0, 1.0, 1.0],
            [0.0; 4],
            [0.0; 4],
        ];
        let errors = truncation_errors(q.as_flattened(), 2, 0);
        assert!((errors.greedy_wrong - 3.0 / 8.0).abs() < 1e-15);
        assert!((errors.greedy_loss_mean - 3.0 / 8.0).abs() < 1e-15);
        assert!((errors.greedy_loss_largest - 1.0).abs() < 1e-15);
    }
}
