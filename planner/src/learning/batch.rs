use super::input_shares::INPUTS;
use super::nn::Sequences;
use super::{ActionSet, InputShares, Situation};

/// Sizes of a batch's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BatchShape {
    /// Most rows.
    pub rows: usize,
    /// Features of the own state.
    pub own: usize,
    /// Most neighbours, K.
    pub neighbours: usize,
    /// Features of a neighbour.
    pub neighbour: usize,
    /// Numbers by which the critic reads a neighbour's action.
    pub action: usize,
    /// Inputs of a centralised critic; 0 without.
    pub central: usize,
}

/// The networks' inputs for several situations, ordered by their numbers of neighbours.
#[derive(Debug, Clone)]
pub(super) struct Batch {
    shape: BatchShape,
    rows: usize,
    own: Vec<f32>,
    /// Neighbours' states, then their actions; the farthest first, so that the nearest is the
    /// freshest in memory.
    pub neighbours: Sequences,
    central: Vec<f32>,
    /// Own control inputs, where they are the actions.
    inputs: Vec<f32>,
    /// C_A in each row's situation.
    pub safe: Vec<ActionSet>,
    /// Which of the items laid out each row is.
    pub order: Vec<usize>,
    lengths: Vec<usize>,
}

impl Batch {
    pub fn new(shape: BatchShape) -> Self {
        let features = shape.neighbour + shape.action;
        Self {
            shape,
            rows: 0,
            own: vec![0.0; shape.rows * shape.own],
            neighbours: Sequences::new(shape.rows, shape.neighbours, features),
            central: vec![0.0; shape.rows * shape.central],
            inputs: vec![0.0; shape.rows * INPUTS],
            safe: vec![ActionSet::EMPTY; shape.rows],
            order: Vec::with_capacity(shape.rows),
            lengths: vec![0; shape.neighbours + 1],
        }
    }

    pub fn shape(&self) -> BatchShape {
        self.shape
    }

    /// Number of rows in use.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Own states, row by row.
    pub fn own(&self) -> &[f32] {
        &self.own[..self.rows * self.shape.own]
    }

    /// Inputs of a centralised critic, row by row.
    pub fn central(&self) -> &[f32] {
        &self.central[..self.rows * self.shape.central]
    }

    /// Own control inputs, row by row.
    pub fn inputs(&self) -> &[f32] {
        &self.inputs[..self.rows * INPUTS]
    }

    /// Sets the own control input of `row`.
    pub fn set_input(&mut self, row: usize, input: InputShares) {
        self.inputs[row * INPUTS..][..INPUTS].copy_from_slice(&input);
    }

    /// Makes room for `items` situations, item i with `known(i)` neighbours, and orders them.
    pub fn lay_out(&mut self, items: usize, known: impl Fn(usize) -> usize) {
        debug_assert!(items <= self.shape.rows);
        self.rows = items;
        self.lengths.fill(0);
        for item in 0..items {
            self.lengths[known(item)] += 1;
        }
        self.neighbours.lay_out(&self.lengths);
        self.order.clear();
        for length in (0..=self.shape.neighbours).rev() {
            if self.lengths[length] > 0 {
                self.order
                    .extend((0..items).filter(|&item| known(item) == length));
            }
        }
    }

    /// The own state of `row`, to be written.
    pub fn own_mut(&mut self, row: usize) -> &mut [f32] {
        let width = self.shape.own;
        &mut self.own[row * width..][..width]
    }

    /// The centralised critic's input of `row`, to be written.
    pub fn central_mut(&mut self, row: usize) -> &mut [f32] {
        let width = self.shape.central;
        &mut self.central[row * width..][..width]
    }

    /// The state of neighbour `slot` (nearest first) of `row` and its action, to be written.
    pub fn neighbour_mut(&mut self, row: usize, slot: usize) -> (&mut [f32], &mut [f32]) {
        let t = self.shape.neighbours - 1 - slot;
        self.neighbours
            .input_mut(t, row)
            .split_at_mut(self.shape.neighbour)
    }

    /// Lays out and writes `items` situations; neighbours' actions are left unknown.
    pub fn write_all<'s>(&mut self, items: usize, of: impl Fn(usize) -> Situation<'s>) {
        let width = self.shape.neighbour;
        self.lay_out(items, |item| of(item).neighbours.len() / width);
        for row in 0..self.rows {
            let item = self.order[row];
            self.write(row, &of(item));
        }
    }

    /// Writes a situation into `row`; neighbours' actions are left unknown.
    pub fn write(&mut self, row: usize, situation: &Situation<'_>) {
        self.own_mut(row).copy_from_slice(situation.own);
        self.safe[row] = situation.options.safe;
        for (slot, given) in situation
            .neighbours
            .chunks_exact(self.shape.neighbour)
            .enumerate()
        {
            let (state, action) = self.neighbour_mut(row, slot);
            state.copy_from_slice(given);
            action.fill(0.0);
        }
    }
}

/// Writes an action's place as ones and zeros; all zero for an unknown one.
pub(super) fn write_one_hot(place: u8, to: &mut [f32]) {
    for (index, value) in to.iter_mut().enumerate() {
        *value = f32::from(u8::from(index == usize::from(place)));
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // these numbers are exact
mod tests {
    use super::*;
    use crate::learning::ACTIONS;

    #[test]
    fn rows_are_ordered_and_the_nearest_comes_last() {
        let shape = BatchShape {
            rows: 4,
            own: 1,
            neighbours: 3,
            neighbour: 1,
            action: ACTIONS,
            central: 0,
        };
        let mut batch = Batch::new(shape);
        let known = [1, 3, 0, 3];
        batch.lay_out(4, |item| known[item]);
        assert_eq!(batch.order, [1, 3, 0, 2]);
        batch.neighbour_mut(2, 0).0[0] = 7.0;
        assert_eq!(batch.neighbours.rows(2), 4..7);
        assert_eq!(batch.neighbours.inputs()[6 * (1 + ACTIONS)], 7.0);
    }
}
