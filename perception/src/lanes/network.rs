//! The UFLD network as a session of ONNX Runtime.

use crate::card::{Dimension, ModelCard, UfldSpec};
use crate::models::ModelError;
use crate::runtime::{BoundSession, OnnxRuntime, SessionSettings};

/// The lane network.
#[derive(Debug)]
pub struct LaneNetwork {
    session: BoundSession,
    input_size: [usize; 2],
}

impl LaneNetwork {
    /// Opens the network of `card`.
    ///
    /// # Errors
    /// The file is not the card's, or takes or gives other shapes than `spec` needs.
    pub fn open(
        runtime: &OnnxRuntime,
        card: &ModelCard,
        spec: &UfldSpec,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let mismatch = |reason: &str| ModelError::Mismatch {
            path: card.file.clone(),
            reason: reason.into(),
        };
        let input_size = match card.inputs.as_slice() {
            [image] => match image.shape.as_slice() {
                [
                    Dimension::Fixed(1),
                    Dimension::Fixed(3),
                    Dimension::Fixed(height @ 1..),
                    Dimension::Fixed(width @ 1..),
                ] => Some([*width as usize, *height as usize]),
                _ => None,
            },
            _ => None,
        }
        .ok_or_else(|| mismatch("the input of a lane network is [1, 3, height, width]"))?;
        let expected = spec
            .output_shape()
            .map(|length| Dimension::Fixed(length as i64));
        match card.outputs.as_slice() {
            [cells]
                if cells.shape.split_first()
                    == Some((&Dimension::Fixed(1), expected.as_slice())) => {}
            _ => return Err(mismatch("its output is not [1, grid_cells + 1, 28, 4]")),
        }
        Ok(Self {
            session: BoundSession::open(runtime, card, settings)?,
            input_size,
        })
    }

    /// Width and height of the input in pixels.
    pub fn input_size(&self) -> [usize; 2] {
        self.input_size
    }

    /// The input [3, height, width] of the next run, to be written.
    pub fn input_mut(&mut self) -> &mut [f32] {
        self.session.input_mut(0)
    }

    /// Computes the logits of the input.
    ///
    /// # Errors
    /// ONNX Runtime fails.
    pub fn run(&mut self) -> ort::Result<()> {
        self.session.run()
    }

    /// The logits [cells + 1, row anchors, marks] of the last run.
    pub fn logits(&self) -> &[f32] {
        self.session.output(0)
    }
}
