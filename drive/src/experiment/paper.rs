//! What the paper found. Its traffic is CARLA's on another road, so that the figures stand beside
//! ours for their course, not for their size.

use super::Behaviour;

/// Table "system efficiency comparison under different CAV ratios": velocity in mph and comfort of
/// 0, 5, ..., 30 CAVs among 30 vehicles.
const OURS_BY_RATIO: [[f64; 2]; 7] = [
    [60.06, 2.61],
    [61.82, 2.64],
    [64.70, 2.68],
    [65.14, 2.72],
    [65.18, 2.74],
    [65.53, 2.77],
    [66.15, 2.81],
];
const MADDPG_MAPPED_BY_RATIO: [[f64; 2]; 7] = [
    [60.06, 2.61],
    [62.80, 2.65],
    [66.19, 2.72],
    [67.71, 2.83],
    [67.80, 2.83],
    [69.31, 2.85],
    [70.34, 2.89],
];

/// Table "total number of unsafe actions", of MADDPG at the densities 0.1 to 0.9; ours has none.
const MADDPG_UNSAFE_ACTIONS: [f64; 9] = [
    4416.0, 9510.0, 21897.0, 43491.0, 61689.0, 91154.0, 133_135.0, 191_404.0, 242_976.0,
];

/// Velocity in mph and comfort of all traffic at the `index`-th CAV ratio.
pub(super) fn by_ratio(behaviour: Behaviour, index: usize) -> Option<[f64; 2]> {
    match behaviour {
        Behaviour::Ours => OURS_BY_RATIO.get(index).copied(),
        Behaviour::MaddpgMapped => MADDPG_MAPPED_BY_RATIO.get(index).copied(),
        _ => None,
    }
}

/// Unsafe actions of an episode at the `index`-th density.
pub(super) fn unsafe_actions(behaviour: Behaviour, index: usize) -> Option<f64> {
    match behaviour {
        Behaviour::Ours => Some(0.0),
        Behaviour::Maddpg => MADDPG_UNSAFE_ACTIONS.get(index).copied(),
        _ => None,
    }
}

/// Least headway in metres (Fig. "headway"); of MADDPG the paper only says that it is negative.
pub(super) fn min_headway_m(behaviour: Behaviour) -> Option<f64> {
    (behaviour == Behaviour::Ours).then_some(18.5)
}

/// Largest total reward of an episode, and the episode that first reached it (Fig. "episode
/// reward").
pub(super) fn largest_reward(behaviour: Behaviour) -> [Option<f64>; 2] {
    match behaviour {
        Behaviour::Ours => [Some(1940.0), Some(20.0)],
        Behaviour::Maddpg => [Some(7.0), None],
        _ => [None, None],
    }
}
