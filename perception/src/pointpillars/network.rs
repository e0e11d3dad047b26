//! The PointPillars network as a session of ONNX Runtime.

use ort::session::Session;
use ort::value::TensorRef;

use super::preprocess::{FEATURES, Pillars};
use crate::card::{Dimension, ModelCard, PointPillarsSpec};
use crate::models::{ModelError, open_model};
use crate::runtime::{OnnxRuntime, SessionSettings};

/// What the network gives on a map of half the grid's resolution, row (y) by row.
#[derive(Debug, Clone, Copy)]
pub struct HeadMaps<'a> {
    /// [ny / 2, nx / 2, anchors]: logit of the anchor's class.
    pub class_logits: &'a [f32],
    /// [ny / 2, nx / 2, anchors, 7]: SECOND's deltas from the anchor.
    pub box_deltas: &'a [f32],
    /// [ny / 2, nx / 2, anchors, 2]: logits of the two halves of the circle.
    pub direction_logits: &'a [f32],
}

/// The detector's network.
#[derive(Debug)]
pub struct DetectorNetwork {
    session: Session,
    max_points_per_pillar: usize,
}

impl DetectorNetwork {
    /// Opens the network of `card`.
    ///
    /// # Errors
    /// The file is not the card's, or takes or gives other shapes than `spec` needs.
    pub fn open(
        runtime: &OnnxRuntime,
        card: &ModelCard,
        spec: &PointPillarsSpec,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let session = open_model(runtime, card, settings)?;
        let [nx, ny] = spec.grid();
        let points = spec.max_points_per_pillar;
        let anchors = 2 * spec.anchors.len();
        let map = [1, ny / 2, nx / 2, anchors];
        let inputs: [&[usize]; 2] = [&[points, FEATURES], &[]];
        let outputs: [&[usize]; 3] = [&[], &[7], &[2]];
        let inputs_fit = card.inputs.len() == inputs.len()
            && card.inputs.iter().zip(inputs).all(|(tensor, expected)| {
                matches!(tensor.shape.first(), Some(Dimension::Dynamic(_)))
                    && is_fixed(&tensor.shape[1..], expected.iter())
            });
        let outputs_fit = card.outputs.len() == outputs.len()
            && card
                .outputs
                .iter()
                .zip(outputs)
                .all(|(tensor, expected)| is_fixed(&tensor.shape, map.iter().chain(expected)));
        if !inputs_fit || !outputs_fit {
            return Err(ModelError::Mismatch {
                path: card.file.clone(),
                reason: format!(
                    "a detector takes [P, {points}, {FEATURES}] and [P] and gives {map:?}, and \
                     that with 7 and 2 more"
                ),
            });
        }
        Ok(Self {
            session,
            max_points_per_pillar: points,
        })
    }

    /// From pillars, at least one, to the maps, handed to `read`.
    ///
    /// # Errors
    /// ONNX Runtime fails.
    pub fn run<T>(
        &mut self,
        pillars: &Pillars,
        read: impl FnOnce(HeadMaps<'_>) -> T,
    ) -> ort::Result<T> {
        let count = pillars.coords.len();
        let features = TensorRef::from_array_view((
            [count, self.max_points_per_pillar, FEATURES],
            pillars.features.as_slice(),
        ))?;
        let coords = TensorRef::from_array_view(([count], pillars.coords.as_slice()))?;
        let outputs = self.session.run(ort::inputs![features, coords])?;
        let map = |index: usize| Ok::<_, ort::Error>(outputs[index].try_extract_tensor::<f32>()?.1);
        Ok(read(HeadMaps {
            class_logits: map(0)?,
            box_deltas: map(1)?,
            direction_logits: map(2)?,
        }))
    }
}

fn is_fixed<'a>(shape: &[Dimension], expected: impl Iterator<Item = &'a usize>) -> bool {
    let expected = expected.map(|length| Dimension::Fixed(*length as i64));
    shape.iter().cloned().eq(expected)
}
