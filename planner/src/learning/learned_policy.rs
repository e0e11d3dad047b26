use std::path::Path;

use covista_world::StationId;

use super::batch::{Batch, BatchShape};
use super::checkpoint::Reader;
use super::network::{Buffers, Network};
use super::trainer::Plan;
use super::{
    ActionSet, CHOICES, FeatureEncoder, LearningError, NEIGHBOUR_FEATURES, OWN_FEATURES, Options,
    Shape, Situation, Situations,
};
use crate::{ActionValues, Observation, Policy};

/// A trained actor as a policy: its values are the logits of pi(a | s^{N_i}), so that the safe
/// action mapping takes the best safe action.
#[derive(Debug, Clone)]
pub struct LearnedPolicy {
    encoder: FeatureEncoder,
    actor: Network,
    weights: Vec<f32>,
    situations: Situations,
    batch: Batch,
    buffers: Buffers,
}

impl LearnedPolicy {
    /// Reads the actor of learner `index` (0 for a shared one) from a checkpoint or policy file.
    /// `loop_length_m` is that of the road, where it is a loop.
    ///
    /// # Errors
    /// When the file is missing, damaged, of other sizes, or has a number that is not finite.
    pub fn load(
        path: &Path,
        index: usize,
        loop_length_m: Option<f64>,
    ) -> Result<Self, LearningError> {
        let reader = Reader::open(path)?;
        let shape = reader.header.shape;
        let actor = Plan::new(shape, &reader.header.settings).actor;
        let weights = reader.numbers(&format!("{index}.actor.weights"), &actor)?;
        if (shape.own, shape.neighbour) != (OWN_FEATURES, NEIGHBOUR_FEATURES) {
            return Err(reader.problem(format!(
                "was trained with {} own and {} neighbour features, a policy needs {OWN_FEATURES} and {NEIGHBOUR_FEATURES}",
                shape.own, shape.neighbour
            )));
        }
        Ok(Self::new(shape, actor, weights, loop_length_m))
    }

    pub(super) fn new(
        shape: Shape,
        actor: Network,
        weights: Vec<f32>,
        loop_length_m: Option<f64>,
    ) -> Self {
        let batch = BatchShape {
            rows: 1,
            own: shape.own,
            neighbours: shape.neighbours,
            neighbour: shape.neighbour,
            central: 0,
        };
        let one = Shape {
            agents: 1,
            global: 0,
            ..shape
        };
        Self {
            encoder: FeatureEncoder::new(loop_length_m),
            buffers: Buffers::new(&actor, batch),
            actor,
            weights,
            situations: Situations::new(one),
            batch: Batch::new(batch),
        }
    }

    /// The encoder, which counts how often the cap on neighbours binds.
    pub fn encoder(&self) -> &FeatureEncoder {
        &self.encoder
    }

    /// The logits in a situation that is encoded already.
    pub fn logits(&mut self, situation: &Situation<'_>) -> [f32; CHOICES] {
        let known = situation.neighbours.len() / self.batch.shape().neighbour;
        self.batch.lay_out(1, |_| known);
        self.batch.write(0, situation);
        let values = self
            .actor
            .forward(&self.weights, &self.batch, &mut self.buffers);
        std::array::from_fn(|index| values[index])
    }
}

impl Policy for LearnedPolicy {
    /// Keep lane first where the observation has a number that is not finite.
    fn values(&mut self, observation: &Observation) -> ActionValues {
        self.situations.clear();
        let nobody = |_: StationId| None;
        let mut situations = std::mem::replace(&mut self.situations, Situations::new(EMPTY));
        let encoded = self
            .encoder
            .encode(observation, nobody, &mut situations.get_mut(0));
        let mut situation = situations.get(0);
        situation.options = Options {
            legal: ActionSet::ALL,
            safe: ActionSet::ALL,
        };
        let logits = match encoded {
            Ok(()) => self.logits(&situation).map(f64::from),
            Err(_) => [0.0, f64::NEG_INFINITY, f64::NEG_INFINITY],
        };
        self.situations = situations;
        ActionValues {
            keep_lane: logits[0],
            change_left: logits[1],
            change_right: logits[2],
        }
    }
}

const EMPTY: Shape = Shape {
    agents: 0,
    own: 0,
    neighbours: 0,
    neighbour: 0,
    global: 0,
};
