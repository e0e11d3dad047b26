use super::{ExperimentError, NetworkedGame, TruncationCase, TruncationFigures};
use crate::networked::{Evaluation, RingGame, TruncationErrors, truncation_errors};

/// Computes the global Q of every vehicle and truncates it to every kappa up to the whole ring.
pub(super) fn drive(case: &TruncationCase) -> Result<TruncationFigures, ExperimentError> {
    let n = case.vehicles;
    let game = match case.game {
        NetworkedGame::Traffic { seed } => RingGame::traffic(n, seed),
        NetworkedGame::Relay => RingGame::relay(n),
    };
    let evaluation = Evaluation::of(&game, case.discount)?;
    let mut q_error = 0.0_f64;
    let mut by_vehicle: Vec<Vec<TruncationErrors>> = vec![Vec::new(); 1 + n / 2];
    for i in 0..n {
        let q = evaluation.q(i);
        q_error = q_error.max(evaluation.error_bound(i, &q));
        for (kappa, errors) in by_vehicle.iter_mut().enumerate() {
            errors.push(truncation_errors(&q, n, kappa));
        }
    }
    let rewards = game.reward.into_iter();
    Ok(TruncationFigures {
        least_reward: rewards.clone().fold(f64::INFINITY, f64::min),
        largest_reward: rewards.fold(f64::NEG_INFINITY, f64::max),
        q_error,
        by_kappa: (by_vehicle.iter())
            .filter_map(|errors| TruncationErrors::merged(errors))
            .collect(),
    })
}
