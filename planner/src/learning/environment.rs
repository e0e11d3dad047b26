use covista_world::Action;

use super::{ActionSet, InputShares, LearningError, Situations};

const MOST_FEATURES: usize = 1024;
const MOST_NEIGHBOURS: usize = u8::MAX as usize;
const MOST_AGENTS: usize = 100_000;

/// Why an environment cannot be reset or stepped.
#[derive(Debug, thiserror::Error)]
#[error("the environment failed {when}: {source}")]
pub struct EnvironmentError {
    /// What it was doing.
    pub when: String,
    /// What went wrong there.
    #[source]
    pub source: Box<dyn std::error::Error + Send + Sync>,
}

/// What n agents got for one step, each in its own row.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The reward r^i of each agent.
    pub rewards: Vec<f32>,
    /// Whether the step was this agent's last because of what happened to it (a collision): its
    /// future is worth nothing. An episode that only ran out of time terminates nobody.
    pub terminated: Vec<bool>,
    /// Whether the episode is over. Agents that are not terminated were truncated then: their
    /// future is worth what the critic says.
    pub is_over: bool,
}

impl Outcome {
    /// All zero, for `agents` agents.
    pub fn new(agents: usize) -> Self {
        Self {
            rewards: vec![0.0; agents],
            terminated: vec![false; agents],
            is_over: false,
        }
    }

    /// Sets everything back to zero, as [`Environment::step`] gets it.
    pub fn clear(&mut self) {
        self.rewards.fill(0.0);
        self.terminated.fill(false);
        self.is_over = false;
    }
}

/// Sizes of everything that an environment writes: the same for all its episodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Agents n.
    pub agents: usize,
    /// Features of an agent's own state.
    pub own: usize,
    /// Most neighbours that are kept, K.
    pub neighbours: usize,
    /// Features of one neighbour.
    pub neighbour: usize,
    /// Features of an agent in the global state of a centralised critic; 0 where none is needed.
    pub global: usize,
}

impl Shape {
    /// Checks that networks of these sizes can be made.
    pub(super) fn validate(&self) -> Result<(), LearningError> {
        let refuse = |problem: String| Err(LearningError::Environments(problem));
        if self.agents == 0 {
            return refuse("there is no CAV to learn; set at least one CAV".into());
        }
        let is_feature_count = |count: usize| (1..=MOST_FEATURES).contains(&count);
        if !is_feature_count(self.own) || !is_feature_count(self.neighbour) {
            return refuse(format!(
                "own and neighbour features must be 1 to {MOST_FEATURES}, not {self:?}"
            ));
        }
        if self.neighbours > MOST_NEIGHBOURS {
            return refuse(format!(
                "neighbours must be at most {MOST_NEIGHBOURS}, not {self:?}"
            ));
        }
        if self.agents > MOST_AGENTS || self.global > MOST_FEATURES {
            return refuse(format!(
                "agents must be at most {MOST_AGENTS}, global features {MOST_FEATURES}, not {self:?}"
            ));
        }
        Ok(())
    }
}

/// n connected vehicles that act together once every behaviour step.
///
/// The same seed gives the same episode. `situations` and `outcome` have the sizes of
/// [`Environment::shape`]; every row is to be written at each call (they arrive cleared).
pub trait Environment: Send {
    /// Its sizes.
    fn shape(&self) -> Shape;

    /// What it was set up with, for the metadata of what is learnt in it.
    fn settings(&self) -> serde_json::Value {
        serde_json::Value::Null
    }

    /// Starts the episode of this seed and tells each agent's first situation.
    ///
    /// # Errors
    /// Where the episode cannot be set up.
    fn reset(&mut self, seed: u64, situations: &mut Situations) -> Result<(), EnvironmentError>;

    /// One behaviour step with everybody's action; tells the rewards and the next situations. At
    /// the end of an episode these are the last ones, not those of a new episode.
    ///
    /// # Errors
    /// Where the step cannot be done.
    fn step(
        &mut self,
        actions: &[Action],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError>;

    /// One step of agents whose actions are control inputs, which may be shorter than a behaviour
    /// step.
    ///
    /// # Errors
    /// Where the step cannot be done, and where nobody can steer here.
    fn steer(
        &mut self,
        inputs: &[InputShares],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        let _ = (inputs, outcome, situations);
        Err(EnvironmentError {
            when: "to steer".into(),
            source: "it takes behaviours only; choose another algorithm".into(),
        })
    }
}

/// The actions open to an agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Options {
    /// Those with a meaning: there is a lane on that side; within a lane change, going on and
    /// taking it back (keep lane).
    pub legal: ActionSet,
    /// Those of them that the safety filter allows now, C_A of Alg. 1.
    pub safe: ActionSet,
}
