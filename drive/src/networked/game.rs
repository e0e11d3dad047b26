/// Pairs of a vehicle's local state and its action: `2 * state + action`, where state 0 stands and
/// 1 moves, action 0 waits and 1 goes. Pair 0 is the paper's "0" of a vehicle out of sight.
pub const PAIRS: usize = 4;

/// What a vehicle does and how it fares, given those beside it.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    /// Probability that it moves next, by the pairs of the vehicle behind, of itself and of the
    /// one ahead.
    pub moves: [[[f64; PAIRS]; PAIRS]; PAIRS],
    /// Its localized policy: the probability that it goes, by the states of the same three.
    pub goes: [[[f64; 2]; 2]; 2],
}

/// Vehicles on a ring, each with one behind and one ahead, under their localized policies.
///
/// Each vehicle's next state is drawn by itself, given its 1-hop neighbourhood's states and
/// actions: the paper's Assumption 1.
#[derive(Debug, Clone, PartialEq)]
pub struct RingGame {
    /// Around the ring.
    pub vehicles: Vec<Vehicle>,
    /// r^i(s^i, a^i), by the vehicle's own pair, the same for all.
    pub reward: [f64; PAIRS],
}

impl RingGame {
    /// Vehicles on the ring, n.
    pub fn len(&self) -> usize {
        self.vehicles.len()
    }

    /// Vehicle `i` and all others by their distance from it in hops, the one ahead first: the
    /// kappa-hop neighbourhood is the first `1 + 2 * kappa` of them.
    pub fn by_distance(&self, i: usize) -> Vec<usize> {
        let n = self.len();
        let place = |rank: usize| {
            let hops = rank.div_ceil(2);
            let ahead = if rank % 2 == 1 { hops } else { n - hops };
            (i + ahead) % n
        };
        (0..n).map(place).collect()
    }

    /// Probability that vehicle `i` moves next, where `pairs` are of all vehicles.
    pub(super) fn moves(&self, i: usize, pairs: &[usize]) -> f64 {
        let [behind, ahead] = self.beside(i);
        self.vehicles[i].moves[pairs[behind]][pairs[i]][pairs[ahead]]
    }

    /// Probability that vehicle `i` goes in the joint state `states`, a bit a vehicle.
    pub(super) fn goes(&self, i: usize, states: usize) -> f64 {
        let [behind, ahead] = self.beside(i);
        let of = |vehicle: usize| states >> vehicle & 1;
        self.vehicles[i].goes[of(behind)][of(i)][of(ahead)]
    }

    /// Probability of the joint action `actions` in the joint state `states`, a bit a vehicle
    /// each.
    pub(super) fn policy(&self, states: usize, actions: usize) -> f64 {
        let of = |i: usize| match (actions >> i & 1, self.goes(i, states)) {
            (1, goes) => goes,
            (_, goes) => 1.0 - goes,
        };
        (0..self.len()).map(of).product()
    }

    fn beside(&self, i: usize) -> [usize; 2] {
        let last = self.len() - 1;
        let behind = if i == 0 { last } else { i - 1 };
        let ahead = if i == last { 0 } else { i + 1 };
        [behind, ahead]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbourhoods_grow_by_one_on_either_side() {
        let order = |n: u64, i| RingGame::traffic(n as usize, 0).by_distance(i);
        assert_eq!(order(6, 4), [4, 5, 3, 0, 2, 1]);
        assert_eq!(order(5, 0), [0, 1, 4, 2, 3]);
        assert_eq!(order(2, 1), [1, 0]);
    }

    #[test]
    fn joint_actions_have_probability_one_together() {
        let game = RingGame::traffic(5, 3);
        for states in 0..1 << 5 {
            let sum: f64 = (0..1 << 5)
                .map(|actions| game.policy(states, actions))
                .sum();
            assert!((sum - 1.0).abs() < 1e-12, "{states}: {sum}");
        }
    }
}
