//! Prints what one agent's update costs:
//! `cargo run --release -p covista-planner --example update_cost`.

use std::io::Write;

use covista_planner::learning::{Algorithm, Hyperparameters, LearningError, update_cost};

fn main() -> Result<(), LearningError> {
    let mut out = std::io::stdout().lock();
    for algorithm in [Algorithm::SafeActorCritic, Algorithm::Maddpg] {
        for (agents, neighbours) in [(30, 6), (30, 8), (1000, 8)] {
            let cost = update_cost(
                algorithm,
                agents,
                neighbours,
                Hyperparameters::default(),
                300,
            )?;
            // A closed pipe is no reason to fail.
            let _ = writeln!(out, "{cost:?}");
        }
    }
    Ok(())
}
