use rand::Rng;

use super::batch::{Batch, BatchShape};
use super::input_shares::INPUTS;
use super::nn::{Dense, Layout, Lstm, LstmBuffers, Packed, Tensor, relu_backward};
use super::{ACTIONS, CHOICES};

/// How a network takes up what is around the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trunk {
    /// An LSTM over the neighbours, which may be told their actions, too. Its size does not depend
    /// on the number of vehicles.
    Neighbours(Lstm),
    /// A layer over everybody's state and action, with ReLU: it grows with the number of vehicles.
    Central(Dense),
}

/// The network of the paper's Fig. 3: what is around the vehicle through a trunk, its result beside
/// the own state through a layer of ReLU units, then the values.
///
/// An actor has one value for each action of A and sees no actions at all. A critic has one value,
/// and the own action is an input of its last hidden layer; the trunk does not see it, so that one
/// pass gives the value of every own action.
///
/// Where the action is the control input, an actor has its two numbers before the tanh, and the
/// critic one value, of the input that it is told in its last hidden layer.
#[derive(Debug, Clone)]
pub(super) struct Network {
    trunk: Trunk,
    hidden: Dense,
    head: Dense,
    own: usize,
    /// Numbers of the own control input that a critic is told; 0 of any other network.
    input: usize,
    /// What the head's first weights are multiplied by.
    head_scale: f32,
    tensors: Vec<Tensor>,
    /// Values a row: [`CHOICES`] of an actor, [`ACTIONS`] of a critic; [`INPUTS`] and 1 where the
    /// action is the control input.
    pub values: usize,
}

/// What one forward and backward pass write.
#[derive(Debug, Clone)]
pub(super) struct Buffers {
    lstm: LstmBuffers,
    packed: Packed,
    /// Result of the trunk and own state of each row.
    joined: Vec<f32>,
    joined_gradient: Vec<f32>,
    trunk: Vec<f32>,
    /// The hidden layer before its ReLU, without the own action.
    before: Vec<f32>,
    before_gradient: Vec<f32>,
    /// The hidden layer of each row and, in a critic, each own action.
    after: Vec<f32>,
    after_gradient: Vec<f32>,
    values: Vec<f32>,
}

impl Network {
    /// pi(a | s^{N_i}): own state and neighbours' states.
    pub fn actor(shape: BatchShape, hidden: usize) -> Self {
        let mut layout = Layout::default();
        let lstm = Lstm::new(&mut layout, "lstm", shape.neighbour, hidden);
        let joined = hidden + shape.own;
        let layer = Dense::new(&mut layout, "hidden", joined, hidden);
        let head = Dense::new(&mut layout, "head", hidden, CHOICES);
        Self::joined(Trunk::Neighbours(lstm), layer, head, shape.own, layout)
    }

    /// The control input before its tanh: own state and neighbours' states. It begins near zero,
    /// where the tanh has a slope.
    pub fn input_actor(shape: BatchShape, hidden: usize) -> Self {
        let mut layout = Layout::default();
        let lstm = Lstm::new(&mut layout, "lstm", shape.neighbour, hidden);
        let layer = Dense::new(&mut layout, "hidden", hidden + shape.own, hidden);
        let head = Dense::new(&mut layout, "head", hidden, INPUTS);
        Self {
            head_scale: 0.1,
            ..Self::joined(Trunk::Neighbours(lstm), layer, head, shape.own, layout)
        }
    }

    /// The truncated Q of the own control input, neighbours' states and control inputs.
    pub fn input_critic(shape: BatchShape, hidden: usize) -> Self {
        let mut layout = Layout::default();
        let features = shape.neighbour + shape.action;
        let lstm = Lstm::new(&mut layout, "lstm", features, hidden);
        let layer = Dense::new(&mut layout, "hidden", hidden + shape.own + INPUTS, hidden);
        let head = Dense::new(&mut layout, "head", hidden, 1);
        Self {
            input: INPUTS,
            values: 1,
            ..Self::joined(Trunk::Neighbours(lstm), layer, head, shape.own, layout)
        }
    }

    /// The truncated Q: own state and action, neighbours' states and actions.
    pub fn truncated_critic(shape: BatchShape, hidden: usize) -> Self {
        let mut layout = Layout::default();
        let lstm = Lstm::new(&mut layout, "lstm", shape.neighbour + ACTIONS, hidden);
        Self::critic(Trunk::Neighbours(lstm), layout, shape, hidden)
    }

    /// Q of the global state and the joint action, as MADDPG has it.
    pub fn central_critic(shape: BatchShape, hidden: usize) -> Self {
        let mut layout = Layout::default();
        let layer = Dense::new(&mut layout, "central", shape.central, hidden);
        Self::critic(Trunk::Central(layer), layout, shape, hidden)
    }

    fn critic(trunk: Trunk, mut layout: Layout, shape: BatchShape, hidden: usize) -> Self {
        let inputs = hidden + shape.own + ACTIONS;
        let layer = Dense::new(&mut layout, "hidden", inputs, hidden);
        let head = Dense::new(&mut layout, "head", hidden, 1);
        Self::joined(trunk, layer, head, shape.own, layout)
    }

    fn joined(trunk: Trunk, hidden: Dense, head: Dense, own: usize, layout: Layout) -> Self {
        Self {
            trunk,
            hidden,
            head,
            own,
            input: 0,
            head_scale: 1.0,
            tensors: layout.tensors,
            values: if head.outputs == 1 {
                ACTIONS
            } else {
                head.outputs
            },
        }
    }

    /// Number of weights.
    pub fn len(&self) -> usize {
        self.tensors
            .last()
            .map_or(0, |last| last.start + last.len())
    }

    /// Names, shapes and places of its weights.
    pub fn tensors(&self) -> &[Tensor] {
        &self.tensors
    }

    /// New random weights.
    pub fn initialise(&self, rng: &mut impl Rng) -> Vec<f32> {
        let mut parameters = vec![0.0; self.len()];
        match &self.trunk {
            Trunk::Neighbours(lstm) => lstm.initialise(&mut parameters, rng),
            Trunk::Central(layer) => layer.initialise(&mut parameters, rng),
        }
        self.hidden.initialise(&mut parameters, rng);
        self.head.initialise(&mut parameters, rng);
        let head = self.len() - (self.head.inputs + 1) * self.head.outputs;
        for weight in &mut parameters[head..] {
            *weight *= self.head_scale;
        }
        parameters
    }

    /// Whether it is a critic of control inputs.
    pub fn reads_input(&self) -> bool {
        self.input > 0
    }

    /// Own actions that a pass values apart: all of a critic, none of an actor.
    fn variants(&self) -> usize {
        self.values / self.head.outputs
    }

    fn trunk_width(&self) -> usize {
        match &self.trunk {
            Trunk::Neighbours(lstm) => lstm.hidden,
            Trunk::Central(layer) => layer.outputs,
        }
    }

    /// Numbers that one row gives it to read: for a critic over neighbours all K of them.
    pub fn inputs_per_row(&self, neighbours: usize) -> usize {
        let around = match &self.trunk {
            Trunk::Neighbours(lstm) => neighbours * lstm.inputs,
            Trunk::Central(layer) => layer.inputs,
        };
        around + self.hidden.inputs - self.trunk_width()
    }

    /// The values of each row: [rows, `values`].
    pub fn forward<'a>(
        &self,
        parameters: &[f32],
        batch: &Batch,
        buffers: &'a mut Buffers,
    ) -> &'a [f32] {
        let (rows, width, trunk) = (
            batch.rows(),
            self.trunk_width() + self.own,
            self.trunk_width(),
        );
        let packed = &mut buffers.packed;
        let joined = &mut buffers.joined[..rows * width];
        match &self.trunk {
            Trunk::Neighbours(lstm) => {
                lstm.forward(
                    parameters,
                    &batch.neighbours,
                    &mut buffers.lstm,
                    joined,
                    width,
                );
            }
            Trunk::Central(layer) => {
                let result = &mut buffers.trunk[..rows * trunk];
                layer.forward(parameters, batch.central(), layer.inputs, packed, result);
                for (to, from) in joined
                    .chunks_exact_mut(width)
                    .zip(result.chunks_exact(trunk))
                {
                    for (to, &from) in to.iter_mut().zip(from) {
                        *to = from.max(0.0);
                    }
                }
            }
        }
        for (to, own) in joined
            .chunks_exact_mut(width)
            .zip(batch.own().chunks_exact(self.own))
        {
            to[trunk..].copy_from_slice(own);
        }
        let (units, variants) = (self.hidden.outputs, self.variants());
        let before = &mut buffers.before[..rows * units];
        self.hidden
            .forward(parameters, joined, width, packed, before);
        let after = &mut buffers.after[..rows * variants * units];
        let actions = self.hidden.rows(parameters, width);
        if self.input > 0 {
            for (before, input) in before
                .chunks_exact_mut(units)
                .zip(batch.inputs().chunks_exact(self.input))
            {
                for (&share, weights) in input.iter().zip(actions.chunks_exact(units)) {
                    let terms = before.iter_mut().zip(weights);
                    terms.for_each(|(sum, &weight)| *sum += share * weight);
                }
            }
        }
        for (before, after) in before
            .chunks_exact(units)
            .zip(after.chunks_exact_mut(variants * units))
        {
            if variants == 1 {
                after
                    .iter_mut()
                    .zip(before)
                    .for_each(|(to, &x)| *to = x.max(0.0));
                continue;
            }
            for (after, action) in after
                .chunks_exact_mut(units)
                .zip(actions.chunks_exact(units))
            {
                for ((to, &x), &y) in after.iter_mut().zip(before).zip(action) {
                    *to = (x + y).max(0.0);
                }
            }
        }
        let values = &mut buffers.values[..rows * self.values];
        self.head.forward(parameters, after, units, packed, values);
        values
    }

    /// Adds the gradient of the weights, given that of the values; after a forward pass of the
    /// same batch with the same weights.
    pub fn backward(
        &self,
        parameters: &[f32],
        batch: &Batch,
        buffers: &mut Buffers,
        values_gradient: &[f32],
        gradient: &mut [f32],
    ) {
        let (rows, trunk, width) = (
            batch.rows(),
            self.trunk_width(),
            self.trunk_width() + self.own,
        );
        let (units, variants) = (self.hidden.outputs, self.variants());
        let packed = &mut buffers.packed;
        let after = &buffers.after[..rows * variants * units];
        let after_gradient = &mut buffers.after_gradient[..rows * variants * units];
        self.head
            .backward_weights(after, units, values_gradient, packed, gradient);
        self.head
            .backward_input(parameters, values_gradient, units, packed, after_gradient);
        relu_backward(after, after_gradient);

        let before_gradient = &mut buffers.before_gradient[..rows * units];
        before_gradient.fill(0.0);
        let actions = self.hidden.rows_mut(gradient, width);
        for (sum, given) in before_gradient
            .chunks_exact_mut(units)
            .zip(after_gradient.chunks_exact(variants * units))
        {
            for (variant, given) in given.chunks_exact(units).enumerate() {
                sum.iter_mut().zip(given).for_each(|(sum, &x)| *sum += x);
                if variants > 1 {
                    let action = &mut actions[variant * units..][..units];
                    action.iter_mut().zip(given).for_each(|(sum, &x)| *sum += x);
                }
            }
        }
        if self.input > 0 {
            for (given, input) in before_gradient
                .chunks_exact(units)
                .zip(batch.inputs().chunks_exact(self.input))
            {
                for (&share, slopes) in input.iter().zip(actions.chunks_exact_mut(units)) {
                    let terms = slopes.iter_mut().zip(given);
                    terms.for_each(|(sum, &x)| *sum += share * x);
                }
            }
        }
        let joined = &buffers.joined[..rows * width];
        self.hidden
            .backward_weights(joined, width, before_gradient, packed, gradient);
        let joined_gradient = &mut buffers.joined_gradient[..rows * trunk];
        self.hidden
            .backward_input(parameters, before_gradient, trunk, packed, joined_gradient);
        match &self.trunk {
            Trunk::Neighbours(lstm) => lstm.backward(
                parameters,
                &batch.neighbours,
                &mut buffers.lstm,
                joined_gradient,
                trunk,
                gradient,
            ),
            Trunk::Central(layer) => {
                relu_backward(&buffers.trunk[..rows * trunk], joined_gradient);
                layer.backward_weights(
                    batch.central(),
                    layer.inputs,
                    joined_gradient,
                    packed,
                    gradient,
                );
            }
        }
    }
}

impl Network {
    /// The slopes of each row's value by its own control input, after a forward pass of as many
    /// rows as `slopes` has, [rows, [`INPUTS`]].
    pub fn input_slopes(&self, parameters: &[f32], buffers: &Buffers, slopes: &mut [f32]) {
        let units = self.hidden.outputs;
        let head = &self.head.rows(parameters, 0)[..units];
        let weights = self.hidden.rows(parameters, self.trunk_width() + self.own);
        for (after, slopes) in
            (buffers.after.chunks_exact(units)).zip(slopes.chunks_exact_mut(INPUTS))
        {
            for (slope, weights) in slopes.iter_mut().zip(weights.chunks_exact(units)) {
                let terms = after.iter().zip(head).zip(weights);
                let open = terms.filter(|((after, _), _)| **after > 0.0);
                *slope = open.map(|((_, head), weight)| head * weight).sum();
            }
        }
    }
}

impl Buffers {
    pub fn new(network: &Network, shape: BatchShape) -> Self {
        let (trunk, units) = (network.trunk_width(), network.hidden.outputs);
        let variants = network.variants();
        let rows = shape.rows;
        Self {
            packed: Packed::default(),
            lstm: match &network.trunk {
                Trunk::Neighbours(lstm) => LstmBuffers::new(lstm, rows, shape.neighbours),
                Trunk::Central(_) => LstmBuffers::default(),
            },
            joined: vec![0.0; rows * (trunk + network.own)],
            joined_gradient: vec![0.0; rows * trunk],
            trunk: vec![0.0; rows * trunk],
            before: vec![0.0; rows * units],
            before_gradient: vec![0.0; rows * units],
            after: vec![0.0; rows * variants * units],
            after_gradient: vec![0.0; rows * variants * units],
            values: vec![0.0; rows * network.values],
        }
    }
}
