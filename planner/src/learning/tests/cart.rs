//! A cart on a rail that is pushed to its middle: end-to-end learners against the best there is.

use covista_world::Action;

use super::corridor::{settings, small};
use crate::learning::{
    Algorithm, Environment, EnvironmentError, Hyperparameters, InputShares, Outcome, Shape,
    Sharing, Situations, Trainer, TrainingSettings, mixed,
};

/// How far the whole input moves a cart.
const PUSH: f32 = 0.5;
const STEPS: usize = 10;

/// Two carts on rails of their own; each sees the other. The first number of an input moves a cart,
/// the second one costs its square from -0.5, and the reward is less the square of where it ends.
struct Carts {
    places: [f32; 2],
    steps: usize,
}

impl Carts {
    fn new() -> Self {
        Self {
            places: [0.0; 2],
            steps: 0,
        }
    }

    fn tell(&self, situations: &mut Situations) {
        for agent in 0..2 {
            let row = situations.get_mut(agent);
            row.own[0] = self.places[agent];
            row.neighbours[0] = self.places[1 - agent];
            row.agents[0] = Some(1 - agent as u32);
            *row.known = 1;
        }
    }
}

impl Environment for Carts {
    fn shape(&self) -> Shape {
        Shape {
            agents: 2,
            own: 1,
            neighbours: 1,
            neighbour: 1,
            global: 0,
        }
    }

    fn reset(&mut self, seed: u64, situations: &mut Situations) -> Result<(), EnvironmentError> {
        self.places = [0, 1].map(|agent| (mixed(seed, agent) % 2001) as f32 / 1000.0 - 1.0);
        self.steps = 0;
        self.tell(situations);
        Ok(())
    }

    fn step(
        &mut self,
        _: &[Action],
        _: &mut Outcome,
        _: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        panic!("a cart knows no behaviours");
    }

    fn steer(
        &mut self,
        inputs: &[InputShares],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        for (agent, &[push, second]) in inputs.iter().enumerate() {
            assert!(push.abs() <= 1.0 && second.abs() <= 1.0, "{inputs:?}");
            let place = (self.places[agent] + PUSH * push).clamp(-1.0, 1.0);
            self.places[agent] = place;
            outcome.rewards[agent] = -place.powi(2) - (second + 0.5).powi(2);
        }
        self.steps += 1;
        outcome.is_over = self.steps == STEPS;
        self.tell(situations);
        Ok(())
    }
}

fn trained(sharing: Sharing, rounds: usize) -> Trainer<Carts> {
    let settings = TrainingSettings {
        hyperparameters: Hyperparameters {
            actor_learning_rate: 1e-3,
            first_exploration: 0.5,
            last_exploration: 0.2,
            ..small()
        },
        ..settings(Algorithm::EndToEnd, sharing)
    };
    let carts = (0..4).map(|_| Carts::new()).collect();
    let mut trainer = Trainer::new(carts, settings).expect("a trainer");
    for _ in 0..rounds {
        trainer.train_round().expect("a round");
    }
    trainer
}

/// Reward of the best policy in the evaluation of this seed: straight to the middle.
fn best_reward(seed: u64) -> f64 {
    let of_one = |mut place: f64| -> f64 {
        let mut sum = 0.0;
        for _ in 0..STEPS {
            place -= place.clamp(-f64::from(PUSH), f64::from(PUSH));
            sum -= place * place;
        }
        sum
    };
    let episode = |index: u64| {
        let seed = mixed(seed, index);
        [0, 1].map(|agent| of_one((mixed(seed, agent) % 2001) as f64 / 1000.0 - 1.0))
    };
    (0..4).flat_map(episode).sum::<f64>() / 8.0
}

#[test]
fn the_best_control_input_is_found() {
    for sharing in [Sharing::Independent, Sharing::Shared] {
        let mut trainer = trained(sharing, 250);
        for seed in 0..3 {
            let report = trainer.evaluate(seed).expect("an evaluation");
            let reward: f64 = report.episodes.iter().map(|episode| episode.reward).sum();
            let (reward, best) = (reward / 4.0, best_reward(seed));
            // Doing nothing costs 2.5 for the second number alone.
            let case = format!("{sharing:?}, seed {seed}: {reward} of {best}");
            assert!(reward > best - 0.25 && reward <= best + 1e-6, "{case}");
        }
    }
}

#[test]
fn a_trained_policy_steers_as_the_trainer_does_and_knows_no_behaviours() {
    let trainer = trained(Sharing::Shared, 3);
    let mut policy = trainer.policy(0, None).expect("a policy");
    let mut carts = Carts::new();
    let mut situations = Situations::new(carts.shape());
    carts.reset(4, &mut situations).expect("a start");
    let [first, again] = [(); 2].map(|()| policy.input(&situations.get(0)).expect("an input"));
    let bits = |shares: InputShares| shares.map(f32::to_bits);
    assert_eq!(bits(first), bits(again));
    assert!(first.iter().all(|share| share.abs() < 1.0));
    assert!(policy.logits(&situations.get(0))[1].is_infinite());
}

#[test]
fn the_number_of_threads_changes_no_byte_of_steering() {
    let weights_with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| trained(Sharing::Independent, 4).fingerprint())
    };
    assert_eq!(weights_with(1), weights_with(3));
}

#[test]
fn where_nobody_can_steer_it_is_refused() {
    let settings = settings(Algorithm::EndToEnd, Sharing::Shared);
    let mut trainer =
        Trainer::new(vec![super::corridor::Corridor::new()], settings).expect("a trainer");
    let error = trainer.train_round().expect_err("refused").to_string();
    assert!(error.contains("behaviours only"), "{error}");
}
