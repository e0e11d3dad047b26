//! Small dense and recurrent networks in f32, for batches, with their gradients.
//!
//! A network's weights are one slice, so that Adam, target updates and checkpoints are loops over
//! slices; a layer knows where its part begins. Everything that a forward or backward pass writes
//! is a buffer made beforehand.

mod activation;
mod adam;
mod dense;
mod lstm;
mod matmul;
mod sequences;

pub(super) use activation::relu_backward;
pub use adam::AdamSettings;
pub(super) use adam::{Adam, clip_to_norm, norm, soft_update};
pub(super) use dense::Dense;
pub(super) use lstm::{Lstm, LstmBuffers};
pub(super) use matmul::{Matrix, Out, Packed};
pub(super) use sequences::Sequences;

/// A part of a network's weights.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Tensor {
    pub name: String,
    pub shape: Vec<usize>,
    pub start: usize,
}

impl Tensor {
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Hands out the parts of a network's weights, one after the other.
#[derive(Debug, Default)]
pub(super) struct Layout {
    pub tensors: Vec<Tensor>,
}

impl Layout {
    /// Number of weights so far.
    pub fn len(&self) -> usize {
        self.tensors
            .last()
            .map_or(0, |last| last.start + last.len())
    }

    /// Where the next part begins.
    pub fn add(&mut self, name: impl Into<String>, shape: &[usize]) -> usize {
        let start = self.len();
        self.tensors.push(Tensor {
            name: name.into(),
            shape: shape.to_vec(),
            start,
        });
        start
    }
}

/// Draws uniformly from +-`bound`.
pub(super) fn fill_uniform(weights: &mut [f32], bound: f32, rng: &mut impl rand::Rng) {
    for weight in weights {
        *weight = rng.random_range(-bound..bound);
    }
}
