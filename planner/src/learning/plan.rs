use super::batch::BatchShape;
use super::kept_action::INPUT_FEATURES;
use super::learner::{Learner, Workspace};
use super::network::Network;
use super::replay::ReplayBuffer;
use super::{ACTIONS, Shape, TrainingSettings};

/// The sizes and networks of a training.
pub(super) struct Plan {
    pub batch: BatchShape,
    pub actor: Network,
    pub critic: Network,
    joint: usize,
    settings: TrainingSettings,
}

impl Plan {
    pub fn new(shape: Shape, settings: &TrainingSettings) -> Self {
        let is_central = settings.algorithm.is_central();
        let steers = settings.algorithm.steers();
        let joint = if is_central { shape.agents - 1 } else { 0 };
        let global = if is_central {
            shape.agents * shape.global
        } else {
            0
        };
        let batch = BatchShape {
            rows: settings.hyperparameters.minibatch,
            own: shape.own,
            neighbours: shape.neighbours,
            neighbour: shape.neighbour,
            action: if steers { INPUT_FEATURES } else { ACTIONS },
            central: global + joint * ACTIONS,
        };
        let hidden = settings.hyperparameters.hidden;
        Self {
            batch,
            actor: if steers {
                Network::input_actor(batch, hidden)
            } else {
                Network::actor(batch, hidden)
            },
            critic: if is_central {
                Network::central_critic(batch, hidden)
            } else if steers {
                Network::input_critic(batch, hidden)
            } else {
                Network::truncated_critic(batch, hidden)
            },
            joint,
            settings: *settings,
        }
    }

    pub fn learner(&self, index: usize) -> Learner {
        let settings = self.settings.hyperparameters;
        let replay = ReplayBuffer::new(self.batch, self.joint, settings.replay);
        let (actor, critic) = (self.actor.clone(), self.critic.clone());
        Learner::new(index, actor, critic, replay, settings, self.settings.seed)
    }

    /// Features of the global state that a centralised critic gets.
    pub fn central_features(&self) -> usize {
        self.batch.central - self.joint * ACTIONS
    }

    pub fn workspace(&self) -> Workspace {
        Workspace::new(&self.actor, &self.critic, self.batch)
    }
}
