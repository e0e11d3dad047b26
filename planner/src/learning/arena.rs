use covista_world::Action;

use super::{
    Environment, EnvironmentError, EpisodeReport, InputShares, Outcome, Shape, Situation,
    Situations,
};

/// What one environment wrote last.
pub(super) struct Arena {
    pub situations: Situations,
    pub outcome: Outcome,
    pub actions: Vec<Action>,
    /// Those instead of actions where agents steer.
    pub inputs: Vec<InputShares>,
    pub phase: Phase,
    pub report: EpisodeReport,
}

/// Where an episode is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Phase {
    /// The next actions are to be executed.
    Running,
    /// It is over; what would have been done next is still needed for the last transitions.
    Ending,
    /// Nothing is left to do.
    Done,
}

impl Arena {
    pub fn new(shape: Shape) -> Self {
        Self {
            situations: Situations::new(shape),
            outcome: Outcome::new(shape.agents),
            actions: vec![Action::KeepLane; shape.agents],
            inputs: vec![InputShares::default(); shape.agents],
            phase: Phase::Done,
            report: EpisodeReport::default(),
        }
    }

    /// Starts the episode of `seed`.
    pub fn reset(
        &mut self,
        environment: &mut impl Environment,
        seed: u64,
    ) -> Result<(), EnvironmentError> {
        self.phase = Phase::Running;
        self.report = EpisodeReport::default();
        self.outcome.clear();
        self.situations.clear();
        environment.reset(seed, &mut self.situations)
    }

    /// What the agent sees, with the options that the algorithm keeps to as its safe ones.
    pub fn situation(&self, agent: usize, is_mapped: bool) -> Situation<'_> {
        let mut situation = self.situations.get(agent);
        if !is_mapped {
            situation.options.safe = situation.options.legal;
        }
        situation
    }

    /// Executes the actions, or the control inputs, where it is running, and counts.
    pub fn step(
        &mut self,
        environment: &mut impl Environment,
        steers: bool,
    ) -> Result<(), EnvironmentError> {
        if self.phase != Phase::Running {
            self.phase = Phase::Done;
            return Ok(());
        }
        let agents = self.actions.len();
        if steers {
            self.outcome.clear();
            self.situations.clear();
            environment.steer(&self.inputs, &mut self.outcome, &mut self.situations)?;
        } else {
            self.count_actions();
            self.outcome.clear();
            self.situations.clear();
            environment.step(&self.actions, &mut self.outcome, &mut self.situations)?;
        }
        self.report.steps += 1;
        let reward: f64 = self.outcome.rewards.iter().copied().map(f64::from).sum();
        self.report.reward += reward / agents as f64;
        if self.outcome.is_over {
            self.report.terminated = self.outcome.terminated.iter().filter(|&&t| t).count() as u64;
            self.phase = Phase::Ending;
        }
        Ok(())
    }

    fn count_actions(&mut self) {
        for (agent, &action) in self.actions.iter().enumerate() {
            let is_stop = action == Action::EmergencyStop;
            let safe = self.situations.get(agent).options.safe;
            self.report.emergency_stops += u64::from(is_stop);
            self.report.lane_changes += u64::from(action.is_lane_change());
            self.report.unsafe_actions += u64::from(!is_stop && !safe.contains(action));
        }
    }
}
