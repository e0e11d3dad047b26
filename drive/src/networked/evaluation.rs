use std::ops::Range;

use nalgebra::DMatrix;

use super::{PAIRS, RingGame};

/// A discount that no sum of rewards converges with.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("a discount of {0} makes no sense; give one from 0 to below 1")]
pub struct InvalidDiscount(pub f64);

/// The values of a game under its policies, exact but for rounding.
pub struct Evaluation<'a> {
    game: &'a RingGame,
    discount: f64,
    /// V^i(s): a row for each joint state, a column for each vehicle.
    values: DMatrix<f64>,
}

impl<'a> Evaluation<'a> {
    /// Solves `V^i = r^i + discount * P V^i` on all joint states, for all vehicles i.
    ///
    /// # Errors
    /// When `discount` is not in [0, 1).
    pub fn of(game: &'a RingGame, discount: f64) -> Result<Self, InvalidDiscount> {
        if !(0.0..1.0).contains(&discount) {
            return Err(InvalidDiscount(discount));
        }
        let states = 1 << game.len();
        let system = DMatrix::identity(states, states) - transitions(game) * discount;
        let rewards = DMatrix::from_fn(states, game.len(), |state, i| {
            let (own, goes) = (state >> i & 1, game.goes(i, state));
            (1.0 - goes) * game.reward[2 * own] + goes * game.reward[2 * own + 1]
        });
        let values = system.lu().solve(&rewards);
        Ok(Self {
            game,
            discount,
            values: values.ok_or(InvalidDiscount(discount))?,
        })
    }

    /// The global Q^i(s, a) of vehicle `i` for all joint states and actions.
    ///
    /// The index has a digit of base [`PAIRS`] for each vehicle, those nearest to `i` leading
    /// ([`RingGame::by_distance`]): all (s, a) that agree within kappa hops are one run of it.
    pub fn q(&self, i: usize) -> Vec<f64> {
        let order = self.game.by_distance(i);
        let n = order.len();
        let mut expectation = Expectation {
            game: self.game,
            pairs: vec![0; n],
            tensors: (0..=n).map(|level| vec![0.0; 1 << (n - level)]).collect(),
            order,
        };
        for index in 0..1 << n {
            let state = joint(&expectation.order, |rank| index >> (n - 1 - rank) & 1);
            expectation.tensors[0][index] = self.values[(state, i)];
        }
        let mut q = Vec::with_capacity(PAIRS.pow(n as u32));
        expectation.each(0, &mut |pairs, next| {
            q.push(self.game.reward[pairs[i]] + self.discount * next);
        });
        q
    }

    /// How far `q` of vehicle `i` is from the true one at the most, by what it leaves of Bellman's
    /// equation.
    pub fn error_bound(&self, i: usize, q: &[f64]) -> f64 {
        let order = self.game.by_distance(i);
        let mut left = self.values.column(i).clone_owned();
        for (index, value) in q.iter().enumerate() {
            let pair = |rank: usize| index >> (2 * (order.len() - 1 - rank)) & 3;
            let state = joint(&order, |rank| pair(rank) >> 1);
            let action = joint(&order, |rank| pair(rank) & 1);
            left[state] -= self.game.policy(state, action) * value;
        }
        left.amax() / (1.0 - self.discount)
    }
}

/// A bit for each vehicle of `order`, by its rank there.
fn joint(order: &[usize], bit: impl Fn(usize) -> usize) -> usize {
    let bits = order.iter().enumerate();
    bits.map(|(rank, vehicle)| bit(rank) << vehicle).sum()
}

/// P(s' | s) under the policies: a row for each s, a column for each s'.
fn transitions(game: &RingGame) -> DMatrix<f64> {
    let (n, states) = (game.len(), 1 << game.len());
    let half = n / 2;
    // By columns of s, so that what belongs to one s is in one place.
    let mut transposed = DMatrix::zeros(states, states);
    let mut pairs = vec![0; n];
    let (mut first, mut last) = (Vec::with_capacity(states), Vec::with_capacity(states));
    for (state, mut column) in transposed.column_iter_mut().enumerate() {
        for action in 0..states {
            let weight = game.policy(state, action);
            if weight == 0.0 {
                continue;
            }
            for (i, pair) in pairs.iter_mut().enumerate() {
                *pair = 2 * (state >> i & 1) + (action >> i & 1);
            }
            next_states(game, &pairs, 0..half, 1.0, &mut first);
            next_states(game, &pairs, half..n, weight, &mut last);
            let runs = column.as_mut_slice().chunks_exact_mut(first.len());
            for (run, last) in runs.zip(&last) {
                for (sum, first) in run.iter_mut().zip(&first) {
                    *sum += last * first;
                }
            }
        }
    }
    transposed.transpose()
}

/// `weight` times the probability of each joint next state of `vehicles`, a bit each.
fn next_states(
    game: &RingGame,
    pairs: &[usize],
    vehicles: Range<usize>,
    weight: f64,
    next: &mut Vec<f64>,
) {
    next.clear();
    next.push(weight);
    for i in vehicles {
        let moves = game.moves(i, pairs);
        let stands = next.len();
        next.extend_from_within(..);
        let (stands, moved) = next.split_at_mut(stands);
        stands.iter_mut().for_each(|value| *value *= 1.0 - moves);
        moved.iter_mut().for_each(|value| *value *= moves);
    }
}

/// The expectation of a function of the next joint state, given all states and actions.
///
/// The next states are independent of each other, so one vehicle's is summed over as soon as its
/// neighbours' pairs are chosen; whatever is chosen afterwards shares that sum.
struct Expectation<'a> {
    game: &'a RingGame,
    order: Vec<usize>,
    /// By vehicle.
    pairs: Vec<usize>,
    /// The function with the next states of the first 0, 1, ... vehicles of `order` summed over;
    /// those left are the bits of the index, the next one leading.
    tensors: Vec<Vec<f64>>,
}

impl Expectation<'_> {
    /// Goes through the pairs of the vehicles from `rank` on and hands over all pairs with their
    /// expectation, in the order of the index of [`Evaluation::q`].
    fn each(&mut self, rank: usize, found: &mut impl FnMut(&[usize], f64)) {
        let n = self.order.len();
        if rank == n {
            (n.saturating_sub(2)..n).for_each(|level| self.sum_over(level));
            found(&self.pairs, self.tensors[n][0]);
            return;
        }
        for pair in 0..PAIRS {
            self.pairs[self.order[rank]] = pair;
            if let Some(level) = rank.checked_sub(2) {
                self.sum_over(level);
            }
            self.each(rank + 1, found);
        }
    }

    fn sum_over(&mut self, level: usize) {
        let moves = self.game.moves(self.order[level], &self.pairs);
        let (from, to) = self.tensors.split_at_mut(level + 1);
        let (stands, moved) = from[level].split_at(to[0].len());
        for ((sum, stands), moved) in to[0].iter_mut().zip(stands).zip(moved) {
            *sum = (1.0 - moves) * stands + moves * moved;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two vehicles: Q by its definition, iterated on all sixteen (s, a).
    #[test]
    fn two_vehicles_agree_with_the_definition() {
        let (game, discount) = (RingGame::traffic(2, 7), 0.9);
        let evaluation = Evaluation::of(&game, discount).expect("values");
        let split = |index: usize| [index / PAIRS, index % PAIRS];
        let mut q = [0.0; PAIRS * PAIRS];
        for _ in 0..400 {
            let value = |states: [usize; 2]| -> f64 {
                let of = |i: usize, pair: usize| {
                    let (own, other) = (states[i], states[1 - i]);
                    let goes = game.vehicles[i].goes[other][own][other];
                    match (pair / 2 == own, pair % 2 == 1) {
                        (false, _) => 0.0,
                        (true, true) => goes,
                        (true, false) => 1.0 - goes,
                    }
                };
                let all = q.iter().enumerate();
                all.map(|(index, q)| of(0, split(index)[0]) * of(1, split(index)[1]) * q)
                    .sum()
            };
            q = std::array::from_fn(|index| {
                let [first, second] = split(index);
                let p = game.vehicles[0].moves[second][first][second];
                let other = game.vehicles[1].moves[first][second][first];
                let next = (1.0 - p) * (1.0 - other) * value([0, 0])
                    + p * (1.0 - other) * value([1, 0])
                    + (1.0 - p) * other * value([0, 1])
                    + p * other * value([1, 1]);
                game.reward[first] + discount * next
            });
        }
        for (found, expected) in evaluation.q(0).iter().zip(q) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
    }

    /// A vehicle on its own road: V = r + discount * (1 - p, p) V solved by hand.
    #[test]
    fn vehicles_that_do_not_care_for_each_other_have_a_closed_form() {
        let (p, goes, discount) = ([0.3, 0.8], 0.25, 0.9);
        let vehicle = super::super::Vehicle {
            moves: [std::array::from_fn(|own| [p[own / 2]; PAIRS]); PAIRS],
            goes: [[[goes; 2]; 2]; 2],
        };
        let game = RingGame {
            vehicles: vec![vehicle; 4],
            reward: [0.0, 0.0, 1.0, 3.0],
        };
        let moving = (1.0 - goes) + 3.0 * goes;
        // V1 - V0 = moving + discount * (p1 - p0) * (V1 - V0).
        let gain = moving / (1.0 - discount * (p[1] - p[0]));
        let standing = discount * p[0] * gain / (1.0 - discount);
        let evaluation = Evaluation::of(&game, discount).expect("values");
        for i in 0..4 {
            let q = evaluation.q(i);
            for (index, q) in q.iter().enumerate() {
                let own = index / PAIRS.pow(3);
                let expected = game.reward[own] + discount * (standing + p[own / 2] * gain);
                assert!((q - expected).abs() < 1e-12, "{i} {index}: {q} {expected}");
            }
        }
    }

    #[test]
    fn what_is_left_of_bellmans_equation_is_rounding_and_tells_a_wrong_value() {
        let game = RingGame::traffic(6, 1);
        let evaluation = Evaluation::of(&game, 0.97).expect("values");
        for i in 0..6 {
            let mut q = evaluation.q(i);
            assert!(evaluation.error_bound(i, &q) < 1e-10);
            q[17] += 1e-3;
            assert!(evaluation.error_bound(i, &q) > 1e-10);
        }
    }

    #[test]
    fn without_a_future_only_the_reward_counts() {
        let game = RingGame::traffic(4, 2);
        let q = Evaluation::of(&game, 0.0).expect("values").q(3);
        for (index, q) in q.iter().enumerate() {
            assert_eq!(q.to_bits(), game.reward[index / PAIRS.pow(3)].to_bits());
        }
    }

    #[test]
    fn a_discount_of_one_is_refused() {
        let game = RingGame::relay(3);
        for discount in [1.0, -0.1, f64::NAN] {
            let error = Evaluation::of(&game, discount).err().expect("refused");
            assert!(error.to_string().contains("from 0 to below 1"), "{error}");
        }
    }
}
