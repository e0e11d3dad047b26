//! The PointPillars network: pillar features here, the rest as a session of ONNX Runtime.

use super::features::PillarFeatures;
use super::preprocess::Pillars;
use crate::card::{Dimension, ModelCard, PointPillarsSpec, TensorSpec};
use crate::models::ModelError;
use crate::runtime::{BoundSession, OnnxRuntime, SessionSettings};

/// Where a detector's file keeps the weights of the pillar features.
const PILLAR_FEATURES: &str = "pillar_features";

/// What the network gives on a map of half the grid's resolution, channel by channel, row (y) by row.
#[derive(Debug, Clone, Copy)]
pub struct HeadMaps<'a> {
    /// [anchors, ny / 2, nx / 2]: logit of the anchor's class.
    pub class_logits: &'a [f32],
    /// [anchors, 7, ny / 2, nx / 2]: SECOND's deltas from the anchor.
    pub box_deltas: &'a [f32],
    /// [anchors, 2, ny / 2, nx / 2]: logits of the two halves of the circle.
    pub direction_logits: &'a [f32],
}

/// The detector's network.
#[derive(Debug)]
pub struct DetectorNetwork {
    features: PillarFeatures,
    session: BoundSession,
}

impl DetectorNetwork {
    /// Opens the network of `card`.
    ///
    /// # Errors
    /// The file is not the card's, takes or gives other shapes than `spec` needs or has no weights
    /// of pillar features.
    pub fn open(
        runtime: &OnnxRuntime,
        card: &ModelCard,
        spec: &PointPillarsSpec,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let mismatch = |reason: String| ModelError::Mismatch {
            path: card.file.clone(),
            reason,
        };
        let [nx, ny] = spec.grid().map(|side| side as i64);
        let anchors = 2 * spec.anchors.len() as i64;
        let outputs = [1, 7, 2].map(|numbers| [1, anchors * numbers, ny / 2, nx / 2]);
        let channels = match card.inputs.as_slice() {
            [canvas] => channels_of(canvas, [ny, nx]),
            _ => None,
        };
        let outputs_fit = card.outputs.len() == outputs.len()
            && card.outputs.iter().zip(outputs).all(|(tensor, shape)| {
                tensor.shape.iter().cloned().eq(shape.map(Dimension::Fixed))
            });
        let Some(channels) = channels.filter(|_| outputs_fit) else {
            return Err(mismatch(format!(
                "a detector of this range takes a canvas [1, C, {ny}, {nx}] and gives {:?}, {:?} \
                 and {:?}",
                outputs[0], outputs[1], outputs[2]
            )));
        };
        let session = BoundSession::open(runtime, card, settings)?;
        let text = session
            .metadata(PILLAR_FEATURES)
            .ok_or_else(|| mismatch(format!("its metadata has no {PILLAR_FEATURES}")))?;
        let features = PillarFeatures::parse(&text).map_err(|reason| {
            mismatch(format!("in {PILLAR_FEATURES} of its metadata: {reason}"))
        })?;
        if features.channels() as i64 != channels {
            return Err(mismatch(format!(
                "its canvas has {channels} channels and {PILLAR_FEATURES} of its metadata {}",
                features.channels()
            )));
        }
        Ok(Self { features, session })
    }

    /// Puts the pillars onto the canvas, in place of the last ones.
    pub fn paint(&mut self, pillars: &Pillars) {
        self.features.paint(pillars, self.session.input_mut(0));
    }

    /// The canvas [C, ny, nx].
    pub fn canvas(&mut self) -> &[f32] {
        self.session.input_mut(0)
    }

    /// Computes the maps of the canvas.
    ///
    /// # Errors
    /// ONNX Runtime fails.
    pub fn run(&mut self) -> ort::Result<()> {
        self.session.run()
    }

    /// The maps that the last run computed.
    pub fn maps(&self) -> HeadMaps<'_> {
        HeadMaps {
            class_logits: self.session.output(0),
            box_deltas: self.session.output(1),
            direction_logits: self.session.output(2),
        }
    }
}

/// Channels of a canvas [1, C, ny, nx].
fn channels_of(canvas: &TensorSpec, [ny, nx]: [i64; 2]) -> Option<i64> {
    match canvas.shape.as_slice() {
        [
            Dimension::Fixed(1),
            Dimension::Fixed(channels @ 1..),
            Dimension::Fixed(rows),
            Dimension::Fixed(columns),
        ] if [*rows, *columns] == [ny, nx] => Some(*channels),
        _ => None,
    }
}
