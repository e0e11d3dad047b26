/// A batch of sequences of different lengths, packed without padding.
///
/// All sequences end at the last step. Rows are ordered by length, longest first, so that the
/// `active(t)` sequences that have begun at step t are the first rows; `inputs` holds them step by
/// step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sequences {
    /// Sequences that have begun at each step.
    active: Vec<usize>,
    /// Where each step's rows begin, and their number in all.
    starts: Vec<usize>,
    features: usize,
    inputs: Vec<f32>,
}

impl Sequences {
    /// Room for `rows` sequences of at most `steps` steps.
    pub fn new(rows: usize, steps: usize, features: usize) -> Self {
        Self {
            active: vec![0; steps],
            starts: vec![0; steps + 1],
            features,
            inputs: vec![0.0; rows * steps * features],
        }
    }

    /// Lays the batch out: `counts[l]` sequences of length l, for l = 0 ..= steps.
    pub fn lay_out(&mut self, counts: &[usize]) {
        let steps = self.active.len();
        let mut active = 0;
        for t in 0..steps {
            active += counts[steps - t];
            self.active[t] = active;
            self.starts[t + 1] = self.starts[t] + active;
        }
    }

    pub fn steps(&self) -> usize {
        self.active.len()
    }

    pub fn features(&self) -> usize {
        self.features
    }

    /// How many sequences have begun at step `t`.
    pub fn active(&self, t: usize) -> usize {
        self.active[t]
    }

    /// The packed rows of step `t`.
    pub fn rows(&self, t: usize) -> std::ops::Range<usize> {
        self.starts[t]..self.starts[t + 1]
    }

    /// Packed rows in all.
    pub fn packed(&self) -> usize {
        self.starts[self.steps()]
    }

    /// The features of every packed row.
    pub fn inputs(&self) -> &[f32] {
        &self.inputs[..self.packed() * self.features]
    }

    /// The features of sequence `row` at step `t`.
    pub fn input_mut(&mut self, t: usize, row: usize) -> &mut [f32] {
        let at = (self.starts[t] + row) * self.features;
        &mut self.inputs[at..][..self.features]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_sequences_begin_late() {
        let mut sequences = Sequences::new(4, 3, 1);
        sequences.lay_out(&[1, 0, 2, 1]);
        assert_eq!([0, 1, 2].map(|t| sequences.active(t)), [1, 3, 3]);
        assert_eq!(sequences.rows(1), 1..4);
        assert_eq!(sequences.packed(), 7);
        sequences.lay_out(&[4, 0, 0, 0]);
        assert_eq!(sequences.packed(), 0);
    }
}
