//! A corridor of three cells with a gate, small enough to know its values exactly.
//!
//! The reward of a step is that of the cell where it ends: 0.2, 0 and 1. The gate between the
//! second and the third cell is open at every other step; going through while it is shut is legal,
//! but not safe. The best of the mapped policies goes to the third cell, waiting at the gate where
//! it must. Two agents walk beside each other and do not touch.

use covista_world::Action;

use crate::learning::{
    ActionSet, Algorithm, Environment, EnvironmentError, Hyperparameters, LearningError, Outcome,
    Shape, Sharing, Situations, Trainer, TrainingSettings, mixed,
};

const REWARDS: [f32; 3] = [0.2, 0.0, 1.0];
const DISCOUNT: f32 = 0.9;

pub(super) struct Corridor {
    pub cells: [usize; 2],
    pub gate_is_open: bool,
    pub steps: usize,
    pub bad_reward_at: Option<usize>,
    /// Whether the other agent's keeping its cell is worth one more.
    pub pays_for_rest: bool,
}

impl Corridor {
    pub const SHAPE: Shape = Shape {
        agents: 2,
        own: 4,
        neighbours: 1,
        neighbour: 3,
        global: 4,
    };

    pub fn new() -> Self {
        Self {
            cells: [0; 2],
            gate_is_open: false,
            steps: 0,
            bad_reward_at: None,
            pays_for_rest: false,
        }
    }

    fn tell(&self, situations: &mut Situations) {
        for agent in 0..2 {
            let (cell, other) = (self.cells[agent], self.cells[1 - agent]);
            let row = situations.get_mut(agent);
            row.own[cell] = 1.0;
            row.own[3] = if self.gate_is_open { 1.0 } else { -1.0 };
            row.global.copy_from_slice(row.own);
            row.neighbours[other] = 1.0;
            row.agents[0] = Some(1 - agent as u32);
            *row.known = 1;
            *row.legal = legal(cell);
            *row.safe = safe(cell, self.gate_is_open);
        }
    }
}

fn legal(cell: usize) -> ActionSet {
    let all = [Action::KeepLane, Action::ChangeLeft, Action::ChangeRight];
    let stays = |&action: &Action| moved(cell, action).is_some();
    all.into_iter().filter(stays).collect()
}

fn safe(cell: usize, gate_is_open: bool) -> ActionSet {
    let is_safe = |action: &Action| cell != 1 || gate_is_open || *action != Action::ChangeRight;
    legal(cell).iter().filter(is_safe).collect()
}

fn moved(cell: usize, action: Action) -> Option<usize> {
    match action {
        Action::ChangeLeft => cell.checked_sub(1),
        Action::ChangeRight => (cell < 2).then_some(cell + 1),
        Action::KeepLane | Action::EmergencyStop => Some(cell),
    }
}

impl Environment for Corridor {
    fn shape(&self) -> Shape {
        Self::SHAPE
    }

    fn reset(&mut self, seed: u64, situations: &mut Situations) -> Result<(), EnvironmentError> {
        self.cells = [0, 1].map(|agent| (mixed(seed, agent) % 3) as usize);
        self.gate_is_open = mixed(seed, 2).is_multiple_of(2);
        self.steps = 0;
        self.tell(situations);
        Ok(())
    }

    fn step(
        &mut self,
        actions: &[Action],
        outcome: &mut Outcome,
        situations: &mut Situations,
    ) -> Result<(), EnvironmentError> {
        for agent in 0..2 {
            let cell = moved(self.cells[agent], actions[agent]).expect("a legal action");
            self.cells[agent] = cell;
            let other_rests = actions[1 - agent] == Action::KeepLane;
            let bonus = f32::from(u8::from(self.pays_for_rest && other_rests));
            outcome.rewards[agent] = REWARDS[cell] + bonus;
        }
        self.gate_is_open = !self.gate_is_open;
        self.steps += 1;
        if self.bad_reward_at == Some(self.steps) {
            outcome.rewards[1] = f32::NAN;
        }
        outcome.is_over = self.steps == 10;
        self.tell(situations);
        Ok(())
    }
}

/// The values of the best mapped policy, by value iteration: [cell][gate].
fn best_values() -> [[f32; 2]; 3] {
    let mut values = [[0.0_f32; 2]; 3];
    for _ in 0..300 {
        values = std::array::from_fn(|cell| {
            std::array::from_fn(|gate| {
                let worth = |action| {
                    let next = moved(cell, action).expect("legal");
                    REWARDS[next] + DISCOUNT * values[next][1 - gate]
                };
                let worths = safe(cell, gate == 1).iter().map(worth);
                worths.fold(f32::NEG_INFINITY, f32::max)
            })
        });
    }
    values
}

pub(super) fn small() -> Hyperparameters {
    Hyperparameters {
        critic_learning_rate: 3e-3,
        actor_learning_rate: 3e-3,
        hidden: 32,
        minibatch: 32,
        warm_up: 64,
        replay: 5_000,
        exploration_decisions: 1_000,
        first_exploration: 1.0,
        last_exploration: 0.3,
        discount: DISCOUNT,
        target_rate: 0.02,
        ..Hyperparameters::default()
    }
}

pub(super) fn settings(algorithm: Algorithm, sharing: Sharing) -> TrainingSettings {
    TrainingSettings {
        algorithm,
        sharing,
        hyperparameters: small(),
        seed: 7,
        ..TrainingSettings::default()
    }
}

fn trained(algorithm: Algorithm, sharing: Sharing, rounds: usize) -> Trainer<Corridor> {
    let environments = (0..4).map(|_| Corridor::new()).collect();
    let mut trainer = Trainer::new(environments, settings(algorithm, sharing)).expect("a trainer");
    for _ in 0..rounds {
        let report = trainer.train_round().expect("a round");
        if algorithm.is_mapped() {
            assert!(
                report
                    .episodes
                    .iter()
                    .all(|episode| episode.unsafe_actions == 0)
            );
        }
    }
    trainer
}

/// Mean reward of the best mapped policy in the trainer's next evaluation, by walking it.
fn best_reward(seed: u64) -> f64 {
    let values = best_values();
    let mut sum = 0.0;
    for index in 0..4 {
        let mut walk = Corridor::new();
        let mut situations = Situations::new(Corridor::SHAPE);
        walk.reset(mixed(seed, index), &mut situations)
            .expect("reset");
        for _ in 0..10 {
            let gate = usize::from(walk.gate_is_open);
            let actions = walk.cells.map(|cell| {
                let worth = |action| {
                    let next = moved(cell, action).expect("legal");
                    REWARDS[next] + DISCOUNT * values[next][1 - gate]
                };
                let safe = safe(cell, walk.gate_is_open).iter();
                safe.reduce(|a, b| if worth(b) > worth(a) { b } else { a })
                    .expect("one")
            });
            let mut outcome = Outcome::new(2);
            walk.step(&actions, &mut outcome, &mut situations)
                .expect("a step");
            sum += outcome.rewards.iter().copied().map(f64::from).sum::<f64>() / 2.0;
        }
    }
    sum / 4.0
}

fn reward_of(trainer: &mut Trainer<Corridor>, seed: u64) -> f64 {
    let report = trainer.evaluate(seed).expect("an evaluation");
    report
        .episodes
        .iter()
        .map(|episode| episode.reward)
        .sum::<f64>()
        / 4.0
}

#[test]
fn every_algorithm_finds_the_best_policy() {
    let best: f64 = (0..5).map(best_reward).sum();
    for algorithm in [Algorithm::SafeActorCritic, Algorithm::MaddpgMapped] {
        for sharing in [Sharing::Independent, Sharing::Shared] {
            let mut trainer = trained(algorithm, sharing, 120);
            let reward: f64 = (0..5).map(|seed| reward_of(&mut trainer, seed)).sum();
            let case = format!("{algorithm:?} {sharing:?}: {reward} of {best}");
            assert!(reward > 0.99 * best, "{case}");
        }
    }
}

#[test]
fn the_critic_has_the_values_of_the_mapped_policy() {
    let trainer = trained(Algorithm::SafeActorCritic, Sharing::Shared, 400);
    let values = best_values();
    for cell in 0..3 {
        for gate in 0..2 {
            let corridor = Corridor {
                cells: [cell, 0],
                gate_is_open: gate == 1,
                ..Corridor::new()
            };
            let mut situations = Situations::new(Corridor::SHAPE);
            corridor.tell(&mut situations);
            let learnt = trainer.critic_values(&situations.get(0), &[Some(Action::KeepLane)]);
            for action in safe(cell, gate == 1).iter() {
                let next = moved(cell, action).expect("legal");
                let exact = REWARDS[next] + DISCOUNT * values[next][1 - gate];
                let learnt = learnt[crate::learning::action_index(action)];
                let case = format!("cell {cell}, gate {gate}, {action:?}: {learnt} for {exact}");
                assert!((learnt - exact).abs() < 0.3, "{case}");
            }
        }
    }
}

#[test]
fn the_critic_knows_what_neighbours_do() {
    let mut settings = settings(Algorithm::SafeActorCritic, Sharing::Shared);
    settings.hyperparameters.discount = 0.0;
    let mut corridor = Corridor::new();
    corridor.pays_for_rest = true;
    let mut trainer = Trainer::new(vec![corridor], settings).expect("a trainer");
    for _ in 0..300 {
        trainer.train_round().expect("a round");
    }
    let mut situations = Situations::new(Corridor::SHAPE);
    Corridor::new().tell(&mut situations);
    let value = |action| trainer.critic_values(&situations.get(0), &[Some(action)])[0];
    let gain = value(Action::KeepLane) - value(Action::ChangeRight);
    assert!((gain - 1.0).abs() < 0.2, "{gain}");
}

#[test]
fn a_reward_that_is_no_number_ends_the_training() {
    let mut bad = Corridor::new();
    bad.bad_reward_at = Some(4);
    let settings = settings(Algorithm::SafeActorCritic, Sharing::Independent);
    let mut trainer = Trainer::new(vec![bad], settings).expect("a trainer");
    let error = trainer.train_round().expect_err("refused");
    assert!(
        matches!(
            error,
            LearningError::NotFinite {
                agent: 1,
                what: "a reward"
            }
        ),
        "{error}"
    );
}

#[test]
fn a_network_that_diverges_ends_the_training_as_it_was() {
    let mut trainer = trained(Algorithm::SafeActorCritic, Sharing::Shared, 20);
    trainer.poison();
    let before = trainer.fingerprint();
    let error = trainer.train_round().expect_err("refused");
    assert!(
        error
            .to_string()
            .starts_with("the critic's loss of learner 0 is not finite"),
        "{error}"
    );
    assert_eq!(trainer.fingerprint(), before);
    let folder = tempfile::tempdir().expect("a folder");
    trainer
        .save(&folder.path().join("diverged.safetensors"))
        .expect("saved to look at");
}

#[test]
fn without_mapping_unsafe_actions_are_taken_and_counted() {
    let settings = settings(Algorithm::Maddpg, Sharing::Shared);
    let mut trainer = Trainer::new(vec![Corridor::new()], settings).expect("a trainer");
    let mut unsafe_actions = 0;
    for _ in 0..10 {
        let report = trainer.train_round().expect("a round");
        unsafe_actions += report.episodes[0].unsafe_actions;
    }
    assert!(unsafe_actions > 0);
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let weights_with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a pool");
        pool.install(|| trained(Algorithm::SafeActorCritic, Sharing::Independent, 6).fingerprint())
    };
    assert_eq!(weights_with(1), weights_with(3));
}
