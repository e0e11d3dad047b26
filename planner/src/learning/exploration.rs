use covista_world::Action;
use rand::Rng;

use super::policy_distribution::any_of;
use super::{ActionSet, Hyperparameters};

/// Epsilon-greedy exploration of agents that choose behaviours: now and then any of the safe
/// actions, each as likely, repeated while it stays safe.
#[derive(Debug, Clone)]
pub struct Exploration {
    /// The probability that an agent begins to explore.
    begins: f32,
    /// Decisions that it lasts for.
    steps: u32,
    /// For each agent: the decisions that are left of it, and the action.
    bursts: Vec<(u32, Action)>,
}

impl Exploration {
    /// As after so many decisions of a training with these settings.
    pub(super) fn after(decisions: u64, settings: &Hyperparameters) -> Self {
        Self {
            begins: settings.exploration_begins(decisions),
            steps: settings.exploration_steps,
            bursts: Vec::new(),
        }
    }

    /// As at the end of a training with these settings.
    pub fn last(settings: &Hyperparameters) -> Self {
        Self::after(u64::MAX, settings)
    }

    /// Goes on with the exploration that is due after so many decisions.
    pub(super) fn fade(&mut self, decisions: u64, settings: &Hyperparameters) {
        self.begins = settings.exploration_begins(decisions);
    }

    /// Ends what is being repeated.
    pub(super) fn stop(&mut self) {
        self.bursts.iter_mut().for_each(|(left, _)| *left = 0);
    }

    /// What `agent` does instead of `best`, or `best`.
    pub fn choose(
        &mut self,
        agent: usize,
        best: Action,
        safe: ActionSet,
        draws: &mut impl Rng,
    ) -> Action {
        if self.bursts.len() <= agent {
            self.bursts.resize(agent + 1, (0, Action::KeepLane));
        }
        let (left, repeated) = &mut self.bursts[agent];
        if *left > 0 && safe.contains(*repeated) {
            *left -= 1;
            *repeated
        } else if draws.random::<f32>() < self.begins {
            (*left, *repeated) = (self.steps - 1, any_of(safe, draws));
            *repeated
        } else {
            *left = 0;
            best
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn the_share_of_random_actions_is_that_of_the_settings_and_all_are_safe() {
        let settings = Hyperparameters {
            last_exploration: 0.2,
            exploration_steps: 8,
            ..Hyperparameters::default()
        };
        let safe: ActionSet = [Action::KeepLane, Action::ChangeLeft].into_iter().collect();
        let mut exploration = Exploration::last(&settings);
        let mut draws = ChaCha8Rng::seed_from_u64(3);
        let mut lefts = 0;
        let decisions = 40_000;
        for step in 0..decisions {
            let chosen = exploration.choose(step % 3, Action::KeepLane, safe, &mut draws);
            assert!(safe.contains(chosen));
            lefts += usize::from(chosen == Action::ChangeLeft);
        }
        let share = lefts as f64 / decisions as f64;
        assert!((share - 0.1).abs() < 0.01, "{share}");
    }

    #[test]
    fn what_is_no_longer_safe_is_not_repeated() {
        let settings = Hyperparameters {
            last_exploration: 1.0,
            exploration_steps: 1000,
            ..Hyperparameters::default()
        };
        let mut exploration = Exploration::last(&settings);
        let mut draws = ChaCha8Rng::seed_from_u64(3);
        let left: ActionSet = [Action::ChangeLeft].into_iter().collect();
        let right: ActionSet = [Action::ChangeRight].into_iter().collect();
        for safe in [left, left, right, right, ActionSet::EMPTY] {
            let chosen = exploration.choose(0, Action::KeepLane, safe, &mut draws);
            let expected = safe.iter().next().unwrap_or(Action::EmergencyStop);
            assert_eq!(chosen, expected);
        }
    }
}
