use pulp::NullaryFnOnce;
use rand::Rng;

use super::{Layout, Matrix, Out, Packed, fill_uniform};

/// A fully connected layer: y = x W + b, W stored input by input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dense {
    pub inputs: usize,
    pub outputs: usize,
    weights: usize,
    bias: usize,
}

impl Dense {
    pub fn new(layout: &mut Layout, name: &str, inputs: usize, outputs: usize) -> Self {
        Self {
            inputs,
            outputs,
            weights: layout.add(format!("{name}.weight"), &[inputs, outputs]),
            bias: layout.add(format!("{name}.bias"), &[outputs]),
        }
    }

    /// Uniform in +-1/sqrt(inputs), bias included.
    pub fn initialise(&self, parameters: &mut [f32], rng: &mut impl Rng) {
        let count = (self.inputs + 1) * self.outputs;
        let bound = 1.0 / (self.inputs as f32).sqrt();
        fill_uniform(&mut parameters[self.weights..][..count], bound, rng);
    }

    /// The weights out of the inputs from `first` on, as rows of `outputs`.
    pub fn rows<'a>(&self, parameters: &'a [f32], first: usize) -> &'a [f32] {
        let end = self.weights + self.inputs * self.outputs;
        &parameters[self.weights + first * self.outputs..end]
    }

    /// The same of a gradient, to add to.
    pub fn rows_mut<'a>(&self, gradient: &'a mut [f32], first: usize) -> &'a mut [f32] {
        let end = self.weights + self.inputs * self.outputs;
        &mut gradient[self.weights + first * self.outputs..end]
    }

    /// `y` = `x` W + b, with as many of the first inputs as `x` has columns (the others are zero).
    pub fn forward(
        &self,
        parameters: &[f32],
        x: &[f32],
        columns: usize,
        packed: &mut Packed,
        y: &mut [f32],
    ) {
        let bias = &parameters[self.bias..][..self.outputs];
        for row in y.chunks_exact_mut(self.outputs) {
            row.copy_from_slice(bias);
        }
        packed.pack(self.weights(parameters, columns));
        let rows = y.len() / self.outputs;
        Matrix::new(x, rows, columns, columns).multiply(packed, 0, Out::add(y, self.outputs));
    }

    /// Adds dL/dW and dL/db, given x and dL/dy.
    pub fn backward_weights(
        &self,
        x: &[f32],
        columns: usize,
        dy: &[f32],
        packed: &mut Packed,
        gradient: &mut [f32],
    ) {
        let rows = dy.len() / self.outputs;
        packed.pack(Matrix::new(dy, rows, self.outputs, self.outputs));
        let out = Out::add(self.rows_mut(gradient, 0), self.outputs);
        Matrix::new(x, rows, columns, columns)
            .transposed()
            .multiply(packed, 0, out);
        add_rows(dy, &mut gradient[self.bias..][..self.outputs]);
    }

    /// `dx` = dL/dx of the first `columns` inputs, given dL/dy.
    pub fn backward_input(
        &self,
        parameters: &[f32],
        dy: &[f32],
        columns: usize,
        packed: &mut Packed,
        dx: &mut [f32],
    ) {
        packed.pack(self.weights(parameters, columns).transposed());
        let rows = dy.len() / self.outputs;
        let dy = Matrix::new(dy, rows, self.outputs, self.outputs);
        dy.multiply(packed, 0, Out::replace(dx, columns));
    }

    fn weights<'a>(&self, parameters: &'a [f32], columns: usize) -> Matrix<'a> {
        Matrix::new(
            self.rows(parameters, 0),
            columns,
            self.outputs,
            self.outputs,
        )
    }
}

/// Adds the rows of `matrix`, each as long as `sum`, to `sum`.
fn add_rows(matrix: &[f32], sum: &mut [f32]) {
    pulp::Arch::new().dispatch(AddRows { matrix, sum });
}

struct AddRows<'a> {
    matrix: &'a [f32],
    sum: &'a mut [f32],
}

impl NullaryFnOnce for AddRows<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        for row in self.matrix.chunks_exact(self.sum.len()) {
            for (sum, &value) in self.sum.iter_mut().zip(row) {
                *sum += value;
            }
        }
    }
}
