//! Gradients of the whole networks against finite differences.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::learning::ACTIONS;
use crate::learning::batch::{Batch, BatchShape};
use crate::learning::network::{Buffers, Network};

const SHAPE: BatchShape = BatchShape {
    rows: 6,
    own: 3,
    neighbours: 4,
    neighbour: 2,
    action: ACTIONS,
    central: 9,
};

fn batch(rng: &mut ChaCha8Rng) -> Batch {
    let mut batch = Batch::new(SHAPE);
    let known = [2, 0, 4, 1, 2];
    batch.lay_out(known.len(), |item| known[item]);
    for row in 0..known.len() {
        batch.own_mut(row).fill_with(|| rng.random_range(-1.0..1.0));
        batch
            .central_mut(row)
            .fill_with(|| rng.random_range(-1.0..1.0));
        for slot in 0..known[batch.order[row]] {
            let (state, action) = batch.neighbour_mut(row, slot);
            state.fill_with(|| rng.random_range(-1.0..1.0));
            action.fill_with(|| rng.random_range(-1.0..1.0));
        }
        batch.set_input(row, [0, 1].map(|_| rng.random_range(-1.0..1.0)));
    }
    batch
}

#[test]
fn gradients_are_the_slopes_of_the_values() {
    let networks = [
        Network::actor(SHAPE, 7),
        Network::truncated_critic(SHAPE, 7),
        Network::central_critic(SHAPE, 7),
        Network::input_actor(SHAPE, 7),
        Network::input_critic(SHAPE, 7),
    ];
    for (which, network) in networks.iter().enumerate() {
        let mut rng = ChaCha8Rng::seed_from_u64(which as u64);
        let batch = batch(&mut rng);
        let mut parameters = network.initialise(&mut rng);
        let factors: Vec<f32> = (0..batch.rows() * network.values)
            .map(|_| rng.random_range(-1.0..1.0))
            .collect();
        let mut buffers = Buffers::new(network, SHAPE);
        let mut gradient = vec![0.0; network.len()];
        network.forward(&parameters, &batch, &mut buffers);
        network.backward(&parameters, &batch, &mut buffers, &factors, &mut gradient);

        let mut loss = |parameters: &[f32]| -> f64 {
            let values = network.forward(parameters, &batch, &mut buffers);
            let terms = values.iter().zip(&factors);
            terms
                .map(|(&value, &factor)| f64::from(value) * f64::from(factor))
                .sum()
        };
        let here = loss(&parameters);
        for index in 0..parameters.len() {
            let (kept, by) = (parameters[index], 2e-3);
            parameters[index] = kept + by;
            let right = (loss(&parameters) - here) / f64::from(by);
            parameters[index] = kept - by;
            let left = (here - loss(&parameters)) / f64::from(by);
            parameters[index] = kept;
            // Where a ReLU turns on within the step, the two differ.
            let slack = 5e-3 * (1.0 + left.abs());
            let slopes = left.min(right) - slack..left.max(right) + slack;
            let found = f64::from(gradient[index]);
            assert!(
                slopes.contains(&found),
                "network {which}, weight {index}: {found} not in {slopes:?}"
            );
        }
    }
}

#[test]
fn only_the_critic_sees_neighbours_actions() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut batch = batch(&mut rng);
    for (network, sees) in [
        (Network::actor(SHAPE, 7), false),
        (Network::truncated_critic(SHAPE, 7), true),
    ] {
        let parameters = network.initialise(&mut rng);
        let mut buffers = Buffers::new(&network, SHAPE);
        let before = network.forward(&parameters, &batch, &mut buffers).to_vec();
        batch.neighbour_mut(0, 0).1.fill(1.0);
        let after = network.forward(&parameters, &batch, &mut buffers);
        assert_eq!(before != after, sees);
        assert_eq!(before[network.values..], after[network.values..]);
        batch.neighbour_mut(0, 0).1.fill(0.0);
    }
}

#[test]
fn the_slopes_by_the_own_input_are_those_of_the_value() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let network = Network::input_critic(SHAPE, 7);
    let parameters = network.initialise(&mut rng);
    let mut batch = batch(&mut rng);
    let mut buffers = Buffers::new(&network, SHAPE);
    let mut slopes = vec![0.0; 2 * batch.rows()];
    network.forward(&parameters, &batch, &mut buffers);
    network.input_slopes(&parameters, &buffers, &mut slopes);
    for (index, slope) in slopes.into_iter().enumerate() {
        let row = index / 2;
        let kept = [batch.inputs()[2 * row], batch.inputs()[2 * row + 1]];
        let mut value_at = |by: f32| {
            let mut moved = kept;
            moved[index % 2] += by;
            batch.set_input(row, moved);
            network.forward(&parameters, &batch, &mut buffers)[row]
        };
        let here = value_at(0.0);
        let (right, left) = (value_at(1e-2) - here, here - value_at(-1e-2));
        batch.set_input(row, kept);
        let slopes = [left.min(right) - 5e-5, left.max(right) + 5e-5].map(|by| by / 1e-2);
        assert!(
            (slopes[0]..slopes[1]).contains(&slope),
            "row {row}: {slope} not in {slopes:?}"
        );
    }
}
