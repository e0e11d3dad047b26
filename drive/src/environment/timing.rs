use std::time::Instant;

use covista_planner::learning::{Environment, EnvironmentError, Outcome, Situations, any_of};
use covista_world::Action;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::{BEHAVIOUR_S, RingEnvironment, failed};
use crate::RingEnvironmentSettings;

/// How fast the closed loop runs: `loops` rings side by side with random safe actions, each for an
/// episode. Simulated seconds of all of them by seconds on the clock.
///
/// # Errors
/// When a setting makes no sense or a step fails.
pub fn time_closed_loop(
    settings: RingEnvironmentSettings,
    loops: usize,
) -> Result<f64, EnvironmentError> {
    let ring = |_| RingEnvironment::new(settings);
    let mut rings = (0..loops)
        .map(ring)
        .collect::<Result<Vec<_>, _>>()
        .map_err(|source| failed("to be set up".into(), source))?;
    let start = Instant::now();
    rings
        .par_iter_mut()
        .enumerate()
        .try_for_each(|(seed, ring)| drive(ring, seed as u64))?;
    let driven_s = (loops as u64 * settings.steps) as f64 * BEHAVIOUR_S;
    Ok(driven_s / start.elapsed().as_secs_f64())
}

fn drive(ring: &mut RingEnvironment, seed: u64) -> Result<(), EnvironmentError> {
    let shape = ring.shape();
    let (mut situations, mut outcome) = (Situations::new(shape), Outcome::new(shape.agents));
    let mut dice = ChaCha8Rng::seed_from_u64(seed);
    let mut actions = vec![Action::KeepLane; shape.agents];
    ring.reset(seed, &mut situations)?;
    while !outcome.is_over {
        for (agent, action) in actions.iter_mut().enumerate() {
            *action = any_of(situations.get(agent).options.safe, &mut dice);
        }
        situations.clear();
        outcome.clear();
        ring.step(&actions, &mut outcome, &mut situations)?;
    }
    Ok(())
}
