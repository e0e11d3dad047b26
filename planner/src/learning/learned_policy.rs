use std::path::Path;

use covista_world::StationId;

use super::batch::{Batch, BatchShape};
use super::checkpoint::Reader;
use super::input_shares::squashed;
use super::network::{Buffers, Network};
use super::plan::Plan;
use super::{
    CHOICES, FeatureEncoder, InputShares, LearningError, NEIGHBOUR_FEATURES, OWN_FEATURES, Shape,
    Situation, Situations, TrainingSettings,
};
use crate::{ActionValues, Observation, Policy};

/// A trained actor as a policy: its values are the logits of pi(a | s^{N_i}), so that the safe
/// action mapping takes the best safe action.
#[derive(Debug, Clone)]
pub struct LearnedPolicy {
    encoder: FeatureEncoder,
    situations: Situations,
    network: Actor,
    shape: Shape,
    settings: TrainingSettings,
    environment: serde_json::Value,
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
        let settings = reader.header.settings;
        Ok(Self {
            environment: reader.header.environment,
            ..Self::new(shape, settings, actor, weights, loop_length_m)
        })
    }

    pub(super) fn new(
        shape: Shape,
        settings: TrainingSettings,
        actor: Network,
        weights: Vec<f32>,
        loop_length_m: Option<f64>,
    ) -> Self {
        let batch = BatchShape {
            rows: 1,
            own: shape.own,
            neighbours: shape.neighbours,
            neighbour: shape.neighbour,
            action: 0,
            central: 0,
        };
        let one = Shape {
            agents: 1,
            global: 0,
            ..shape
        };
        Self {
            encoder: FeatureEncoder::new(loop_length_m),
            situations: Situations::new(one),
            network: Actor {
                buffers: Buffers::new(&actor, batch),
                batch: Batch::new(batch),
                network: actor,
                weights,
            },
            shape,
            settings,
            environment: serde_json::Value::Null,
        }
    }

    /// Sizes of the environments it was trained in.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// How it was trained.
    pub fn settings(&self) -> &TrainingSettings {
        &self.settings
    }

    /// What its environments were set up with, where its file tells.
    pub fn environment(&self) -> &serde_json::Value {
        &self.environment
    }

    /// The encoder, which counts how often the cap on neighbours binds.
    pub fn encoder(&self) -> &FeatureEncoder {
        &self.encoder
    }

    /// The logits in a situation that is encoded already, with at most as many neighbours as
    /// [`LearnedPolicy::shape`] has. An end-to-end policy has none: keep lane alone.
    pub fn logits(&mut self, situation: &Situation<'_>) -> [f32; CHOICES] {
        self.network.logits(situation)
    }

    /// The control input of an end-to-end policy in such a situation; `None` from any other.
    pub fn input(&mut self, situation: &Situation<'_>) -> Option<InputShares> {
        let steers = self.settings.algorithm.steers();
        steers.then(|| squashed(self.network.values(situation)))
    }
}

impl Policy for LearnedPolicy {
    /// Keep lane first where the observation has a number that is not finite, and from an end-to-end
    /// policy.
    fn values(&mut self, observation: &Observation) -> ActionValues {
        self.situations.clear();
        let nobody = |_: StationId| None;
        let row = &mut self.situations.get_mut(0);
        let logits = match self.encoder.encode(observation, nobody, row) {
            Ok(()) => self.network.logits(&self.situations.get(0)).map(f64::from),
            Err(_) => KEEP_LANE.map(f64::from),
        };
        ActionValues {
            keep_lane: logits[0],
            change_left: logits[1],
            change_right: logits[2],
        }
    }
}

/// The logits of keep lane alone.
const KEEP_LANE: [f32; CHOICES] = [0.0, f32::NEG_INFINITY, f32::NEG_INFINITY];

/// An actor with its weights and room for one situation.
#[derive(Debug, Clone)]
struct Actor {
    network: Network,
    weights: Vec<f32>,
    batch: Batch,
    buffers: Buffers,
}

impl Actor {
    fn logits(&mut self, situation: &Situation<'_>) -> [f32; CHOICES] {
        let values = self.values(situation).first_chunk::<CHOICES>();
        values.copied().unwrap_or(KEEP_LANE)
    }

    fn values(&mut self, situation: &Situation<'_>) -> &[f32] {
        let known = situation.neighbours.len() / self.batch.shape().neighbour;
        self.batch.lay_out(1, |_| known);
        self.batch.write(0, situation);
        self.network
            .forward(&self.weights, &self.batch, &mut self.buffers)
    }
}
