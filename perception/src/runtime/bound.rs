//! A session whose inputs and outputs stay in the same memory from frame to frame.

use std::fmt;

use ort::memory::Allocator;
use ort::session::{HasSelectedOutputs, OutputSelector, RunOptions, Session, SessionInputValue};
use ort::value::{DynValue, Tensor};

use super::{OnnxRuntime, SessionSettings};
use crate::card::{Dimension, ModelCard, TensorSpec};
use crate::models::{ModelError, open_model, refused};

/// A network whose inputs and outputs are float32 tensors of fixed shapes, bound once; a run
/// allocates nothing on this side of ONNX Runtime.
pub(crate) struct BoundSession {
    session: Session,
    inputs: Vec<SessionInputValue<'static>>,
    /// The outputs for ONNX Runtime to write,
    bound_outputs: RunOptions<HasSelectedOutputs>,
    /// and the same for us to read.
    outputs: Vec<DynValue>,
}

impl BoundSession {
    /// Opens the verified model of `card` and runs it once, on zeros, so that what takes long only
    /// the first time is done.
    ///
    /// # Errors
    /// The file is not the card's, a tensor is not float32 of a fixed shape or ONNX Runtime fails.
    pub(crate) fn open(
        runtime: &OnnxRuntime,
        card: &ModelCard,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let refused = |error: ort::Error| refused(card, settings.provider, &error);
        let zeros = |spec: &TensorSpec| {
            let shape = fixed_shape(spec).ok_or_else(|| ModelError::Mismatch {
                path: card.file.clone(),
                reason: format!("{} is not float32 of a fixed shape", spec.name),
            })?;
            Tensor::<f32>::new(&Allocator::default(), shape).map_err(refused)
        };
        let mut session = open_model(runtime, card, settings)?;
        let mut inputs = Vec::new();
        for spec in &card.inputs {
            inputs.push(zeros(spec)?.into());
        }
        let mut selector = OutputSelector::default();
        for spec in &card.outputs {
            selector = selector.preallocate(spec.name.as_str(), zeros(spec)?);
        }
        let bound_outputs = RunOptions::new().map_err(refused)?.with_outputs(selector);
        let outputs = session
            .run_with_options(inputs.as_slice(), &bound_outputs)
            .map_err(refused)?
            .into_iter()
            .map(|(_, output)| output)
            .collect();
        Ok(Self {
            session,
            inputs,
            bound_outputs,
            outputs,
        })
    }

    /// The whole of an input of the card, row by row. It keeps what was written into it; at first
    /// that is zeros.
    pub(crate) fn input_mut(&mut self, index: usize) -> &mut [f32] {
        match self.inputs.get_mut(index) {
            Some(SessionInputValue::Owned(tensor)) => tensor
                .try_extract_tensor_mut()
                .map_or(&mut [], |(_, numbers)| numbers),
            _ => &mut [],
        }
    }

    /// Computes the outputs from the inputs.
    ///
    /// # Errors
    /// ONNX Runtime fails.
    pub(crate) fn run(&mut self) -> ort::Result<()> {
        self.session
            .run_with_options(self.inputs.as_slice(), &self.bound_outputs)
            .map(drop)
    }

    /// The whole of an output of the card, row by row, as the last run left it.
    pub(crate) fn output(&self, index: usize) -> &[f32] {
        let tensor = self.outputs.get(index);
        let numbers = tensor.and_then(|tensor| tensor.try_extract_tensor().ok());
        numbers.map_or(&[], |(_, numbers)| numbers)
    }

    /// What the ONNX file says under `key`.
    pub(crate) fn metadata(&self, key: &str) -> Option<String> {
        self.session.metadata().ok()?.custom(key)
    }
}

impl fmt::Debug for BoundSession {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { session, .. } = self;
        formatter
            .debug_struct("BoundSession")
            .field("session", session)
            .finish_non_exhaustive()
    }
}

fn fixed_shape(spec: &TensorSpec) -> Option<Vec<i64>> {
    let lengths = spec.shape.iter().map(|axis| match axis {
        Dimension::Fixed(length @ 1..) => Some(*length),
        _ => None,
    });
    lengths
        .collect::<Option<_>>()
        .filter(|_| spec.dtype == "float32")
}
