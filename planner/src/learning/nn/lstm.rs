use pulp::NullaryFnOnce;
use rand::Rng;

use super::activation::{sigmoid, tanh};
use super::{Layout, Matrix, Out, Packed, Sequences, fill_uniform};

/// A long short-term memory over a batch of sequences; its result is the last hidden state.
///
/// In one step, z = [h, x] W + b in four parts, i, f, g, o, then
///
/// ```text
/// c' = sigmoid(f) c + sigmoid(i) tanh(g)
/// h' = sigmoid(o) tanh(c')
/// ```
///
/// W has a row for each hidden unit, then one for each input feature; b follows as one more, for an
/// input that is always one. h and c begin at zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lstm {
    pub inputs: usize,
    pub hidden: usize,
    weights: usize,
}

/// What the forward pass keeps for the backward pass.
#[derive(Debug, Clone, Default)]
pub struct LstmBuffers {
    /// [h, x, 1] of every packed row.
    joined: Vec<f32>,
    /// The four gates of every packed row after their activations; then the gradients before them.
    gates: Vec<f32>,
    /// The cell's state after every packed row.
    cells: Vec<f32>,
    /// tanh of it.
    squashed: Vec<f32>,
    /// dL/dh and dL/dc of each sequence.
    hidden_gradient: Vec<f32>,
    cell_gradient: Vec<f32>,
    packed: Packed,
}

impl LstmBuffers {
    /// For at most `rows` sequences of at most `steps` steps.
    pub fn new(lstm: &Lstm, rows: usize, steps: usize) -> Self {
        let hidden = lstm.hidden;
        Self {
            joined: vec![0.0; rows * steps * lstm.width()],
            gates: vec![0.0; rows * steps * 4 * hidden],
            cells: vec![0.0; rows * steps * hidden],
            squashed: vec![0.0; rows * steps * hidden],
            hidden_gradient: vec![0.0; rows * hidden],
            cell_gradient: vec![0.0; rows * hidden],
            packed: Packed::default(),
        }
    }
}

impl Lstm {
    pub fn new(layout: &mut Layout, name: &str, inputs: usize, hidden: usize) -> Self {
        let weights = layout.add(format!("{name}.weight"), &[hidden + inputs, 4 * hidden]);
        layout.add(format!("{name}.bias"), &[4 * hidden]);
        Self {
            inputs,
            hidden,
            weights,
        }
    }

    /// Uniform in +-1/sqrt(hidden); the forget gate's bias at one, so that it remembers at first.
    pub fn initialise(&self, parameters: &mut [f32], rng: &mut impl Rng) {
        let hidden = self.hidden;
        let rows = self.width() * 4 * hidden;
        let bound = 1.0 / (hidden as f32).sqrt();
        let weights = &mut parameters[self.weights..][..rows];
        fill_uniform(weights, bound, rng);
        weights[rows - 3 * hidden..rows - 2 * hidden].fill(1.0);
    }

    fn width(&self) -> usize {
        self.inputs + self.hidden + 1
    }

    fn weights<'a>(&self, parameters: &'a [f32]) -> &'a [f32] {
        &parameters[self.weights..][..self.width() * 4 * self.hidden]
    }

    /// Writes the last hidden state of sequence r to `last[r * stride..]`; an empty sequence's is
    /// zero. Of the sequences' features the first `inputs` are read.
    pub fn forward(
        &self,
        parameters: &[f32],
        sequences: &Sequences,
        buffers: &mut LstmBuffers,
        last: &mut [f32],
        stride: usize,
    ) {
        let (hidden, width, four) = (self.hidden, self.width(), 4 * self.hidden);
        let weights = self.weights(parameters);
        buffers.packed.pack(Matrix::new(weights, width, four, four));
        for row in last.chunks_mut(stride) {
            row[..hidden].fill(0.0);
        }
        let steps = sequences.steps();
        let mut before = 0;
        for t in 0..steps {
            let rows = sequences.rows(t);
            let joined = &mut buffers.joined[rows.start * width..];
            let (joined, following) = joined.split_at_mut(rows.len() * width);
            let inputs = &sequences.inputs()[rows.start * sequences.features()..];
            let given = inputs.chunks_exact(sequences.features());
            for (row, x) in joined.chunks_exact_mut(width).zip(given) {
                row[hidden..width - 1].copy_from_slice(&x[..self.inputs]);
                row[width - 1] = 1.0;
            }
            for row in joined.chunks_exact_mut(width).skip(before) {
                row[..hidden].fill(0.0);
            }
            let gates = &mut buffers.gates[rows.start * four..rows.end * four];
            // Where all sequences begin, h is zero and its part of the product left out.
            let skipped = if before == 0 { hidden } else { 0 };
            let read = width - skipped;
            let joined = joined.get(skipped..).unwrap_or_default();
            Matrix::new(joined, rows.len(), read, width).multiply(
                &buffers.packed,
                skipped,
                Out::replace(gates, four),
            );
            let (past, now) = buffers.cells.split_at_mut(rows.start * hidden);
            let is_last = t + 1 == steps;
            pulp::Arch::new().dispatch(Steps {
                hidden,
                gates,
                past: &past[past.len() - before * hidden..],
                now: &mut now[..rows.len() * hidden],
                squashed: &mut buffers.squashed[rows.start * hidden..rows.end * hidden],
                next: if is_last { &mut *last } else { following },
                stride: if is_last { stride } else { width },
            });
            before = rows.len();
        }
    }

    /// Adds the gradient of the weights, given dL/d`last`. Undoes the buffers' gates.
    pub fn backward(
        &self,
        parameters: &[f32],
        sequences: &Sequences,
        buffers: &mut LstmBuffers,
        last_gradient: &[f32],
        stride: usize,
        gradient: &mut [f32],
    ) {
        let (hidden, width, four) = (self.hidden, self.width(), 4 * self.hidden);
        let LstmBuffers {
            joined,
            gates,
            cells,
            squashed,
            hidden_gradient,
            cell_gradient,
            packed,
        } = buffers;
        let steps = sequences.steps();
        let of_hidden = Matrix::new(self.weights(parameters), hidden, four, four);
        packed.pack(of_hidden.transposed());
        cell_gradient.fill(0.0);
        for (row, given) in hidden_gradient
            .chunks_exact_mut(hidden)
            .zip(last_gradient.chunks(stride))
        {
            row.copy_from_slice(&given[..hidden]);
        }
        for t in (0..steps).rev() {
            let rows = sequences.rows(t);
            let before = if t == 0 { 0..0 } else { sequences.rows(t - 1) };
            let gates = &mut gates[rows.start * four..rows.end * four];
            let past = &cells[before.start * hidden..before.end * hidden];
            let squashed = &squashed[rows.start * hidden..rows.end * hidden];
            pulp::Arch::new().dispatch(StepsBack {
                hidden,
                gates,
                past,
                squashed,
                hidden_gradient,
                cell_gradient,
            });
            let through = &mut hidden_gradient[..before.len() * hidden];
            Matrix::new(gates, before.len(), four, four).multiply(
                packed,
                0,
                Out::replace(through, hidden),
            );
        }
        // The hidden units' rows of the gradient, over the rows where h is not zero; the others'.
        let (of_hidden, of_inputs) =
            gradient[self.weights..][..width * four].split_at_mut(hidden * four);
        let total = sequences.packed();
        let later = (0..steps)
            .find(|&t| sequences.active(t) > 0)
            .map_or(total, |first| sequences.rows(first).end);
        packed.pack(Matrix::new(gates, total, four, four));
        for (rows, cols, gradient) in [
            (later..total, 0..hidden, of_hidden),
            (0..total, hidden..width, of_inputs),
        ] {
            let joined = joined
                .get(rows.start * width + cols.start..)
                .unwrap_or_default();
            Matrix::new(joined, rows.len(), cols.len(), width)
                .transposed()
                .multiply(packed, rows.start, Out::add(gradient, four));
        }
    }
}

/// One step of every sequence that has begun.
struct Steps<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    past: &'a [f32],
    now: &'a mut [f32],
    squashed: &'a mut [f32],
    /// Where the hidden states go, in rows `stride` apart.
    next: &'a mut [f32],
    stride: usize,
}

impl NullaryFnOnce for Steps<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let n = self.hidden;
        for (r, row) in self.gates.chunks_exact_mut(4 * n).enumerate() {
            let at = r * n;
            let past = self.past.get(at..at + n);
            let (cell, squashed) = (&mut self.now[at..][..n], &mut self.squashed[at..][..n]);
            step(
                row,
                past,
                cell,
                squashed,
                &mut self.next[r * self.stride..][..n],
            );
        }
    }
}

/// The same backwards.
struct StepsBack<'a> {
    hidden: usize,
    gates: &'a mut [f32],
    past: &'a [f32],
    squashed: &'a [f32],
    hidden_gradient: &'a [f32],
    cell_gradient: &'a mut [f32],
}

impl NullaryFnOnce for StepsBack<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let n = self.hidden;
        for (r, row) in self.gates.chunks_exact_mut(4 * n).enumerate() {
            let at = r * n;
            let past = self.past.get(at..at + n);
            let (squashed, dh) = (&self.squashed[at..][..n], &self.hidden_gradient[at..][..n]);
            step_back(row, past, squashed, dh, &mut self.cell_gradient[at..][..n]);
        }
    }
}

/// One sequence's step: gates activated in place, then its cell, tanh of it, and hidden state.
#[inline(always)]
fn step(
    gates: &mut [f32],
    past: Option<&[f32]>,
    cell: &mut [f32],
    squashed: &mut [f32],
    h: &mut [f32],
) {
    let n = cell.len();
    let (i, rest) = gates.split_at_mut(n);
    let (f, rest) = rest.split_at_mut(n);
    let (g, o) = rest.split_at_mut(n);
    let (squashed, h, o) = (&mut squashed[..n], &mut h[..n], &mut o[..n]);
    match past {
        Some(past) => cell.copy_from_slice(past),
        None => cell.fill(0.0),
    }
    for j in 0..n {
        i[j] = sigmoid(i[j]);
        f[j] = sigmoid(f[j]);
        g[j] = tanh(g[j]);
        o[j] = sigmoid(o[j]);
        cell[j] = f[j].mul_add(cell[j], i[j] * g[j]);
        squashed[j] = tanh(cell[j]);
        h[j] = o[j] * squashed[j];
    }
}

/// The same backwards: gates become gradients before their activations, `dc` that of the cell one
/// step earlier.
#[inline(always)]
fn step_back(
    gates: &mut [f32],
    past: Option<&[f32]>,
    squashed: &[f32],
    dh: &[f32],
    dc: &mut [f32],
) {
    let n = dc.len();
    let (i, rest) = gates.split_at_mut(n);
    let (f, rest) = rest.split_at_mut(n);
    let (g, o) = rest.split_at_mut(n);
    let (squashed, dh, o) = (&squashed[..n], &dh[..n], &mut o[..n]);
    for j in 0..n {
        let to_cell = (dh[j] * o[j]).mul_add(1.0 - squashed[j] * squashed[j], dc[j]);
        let (ij, fj, gj, oj) = (i[j], f[j], g[j], o[j]);
        i[j] = to_cell * gj * ij * (1.0 - ij);
        f[j] = to_cell * fj * (1.0 - fj);
        g[j] = to_cell * ij * (1.0 - gj * gj);
        o[j] = dh[j] * squashed[j] * oj * (1.0 - oj);
        dc[j] = to_cell * fj;
    }
    match past {
        Some(past) => f.iter_mut().zip(past).for_each(|(f, &cell)| *f *= cell),
        None => f.fill(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: &[f32], expected: &serde_json::Value) {
        let expected = expected.as_array().expect("numbers");
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            let expected = expected.as_f64().expect("a number");
            assert!(
                (f64::from(*found) - expected).abs() < 2e-5,
                "{found} for {expected}"
            );
        }
    }

    /// Values and gradients by PyTorch: tests/oracles/lstm.py.
    #[test]
    fn it_is_pytorchs() {
        let fixture: serde_json::Value =
            serde_json::from_str(include_str!("lstm.json")).expect("the fixture");
        let size = |name: &str| fixture[name].as_u64().expect("a size") as usize;
        let numbers = |value: &serde_json::Value| -> Vec<f32> {
            let numbers = value.as_array().expect("numbers").iter();
            numbers
                .map(|x| x.as_f64().expect("a number") as f32)
                .collect()
        };
        let (inputs, hidden) = (size("inputs"), size("hidden"));
        let mut layout = Layout::default();
        let lstm = Lstm::new(&mut layout, "lstm", inputs, hidden);
        let mut parameters = numbers(&fixture["weight"]);
        parameters.extend(numbers(&fixture["bias"]));
        assert_eq!(parameters.len(), layout.len());

        let given = fixture["sequences"].as_array().expect("sequences");
        let steps = 4;
        let mut sequences = Sequences::new(given.len() + 1, steps, inputs + 1);
        let mut counts = vec![0; steps + 1];
        counts[0] = 1; // one that is empty, besides PyTorch's
        for sequence in given {
            counts[sequence.as_array().expect("numbers").len() / inputs] += 1;
        }
        sequences.lay_out(&counts);
        for (row, sequence) in given.iter().enumerate() {
            let numbers = numbers(sequence);
            let begins = steps - numbers.len() / inputs;
            for (t, x) in numbers.chunks_exact(inputs).enumerate() {
                let to = sequences.input_mut(begins + t, row);
                to[..inputs].copy_from_slice(x);
                to[inputs] = 99.0; // not one of its inputs
            }
        }
        let stride = hidden + 2;
        let mut buffers = LstmBuffers::new(&lstm, given.len() + 1, steps);
        let mut last = vec![f32::NAN; (given.len() + 1) * stride];
        let mut gradient = vec![0.0; layout.len()];
        for _ in 0..2 {
            lstm.forward(&parameters, &sequences, &mut buffers, &mut last, stride);
            let rows = last.chunks(stride).take(given.len());
            let found: Vec<f32> = rows.flat_map(|row| row[..hidden].to_vec()).collect();
            close(&found, &fixture["last"]);
            assert_eq!(last[given.len() * stride..][..hidden], vec![0.0; hidden]);

            let mut factors = numbers(&fixture["factors"]);
            factors.extend(vec![7.0; hidden]);
            gradient.fill(0.0);
            lstm.backward(
                &parameters,
                &sequences,
                &mut buffers,
                &factors,
                hidden,
                &mut gradient,
            );
            let (weights, bias) = gradient.split_at(gradient.len() - 4 * hidden);
            close(weights, &fixture["weight_gradient"]);
            close(bias, &fixture["bias_gradient"]);
        }
    }
}
