use std::path::Path;

use rayon::prelude::*;

use super::arena::{Arena, Phase};
use super::checkpoint::{CheckpointHeader, Counts, Reader, Writer};
use super::learner::{Learner, Workspace};
use super::nn::Adam;
use super::plan::Plan;
use super::seat::Seat;
use super::{
    Algorithm, Environment, LearnedPolicy, LearningError, RoundReport, Shape, Sharing,
    TrainingSettings, UpdateReport,
};

/// Trains and evaluates learners in a set of environments that are stepped together.
///
/// A round is one episode of every environment. It depends on the seed, the round's number and what
/// was learnt before, not on the number of threads.
pub struct Trainer<E> {
    settings: TrainingSettings,
    shape: Shape,
    environments: Vec<E>,
    arenas: Vec<Arena>,
    seats: Vec<Seat>,
    workspaces: Vec<Workspace>,
    /// Rounds trained so far.
    rounds: u64,
}

impl<E: Environment> Trainer<E> {
    /// New learners with random weights.
    ///
    /// # Errors
    /// When a setting makes no sense or the environments do not go together.
    pub fn new(environments: Vec<E>, settings: TrainingSettings) -> Result<Self, LearningError> {
        settings.hyperparameters.validate()?;
        let shape = common_shape(&environments, settings.algorithm)?;
        let plan = Plan::new(shape, &settings);
        let learners = match settings.sharing {
            Sharing::Independent => shape.agents,
            Sharing::Shared => 1,
        };
        let seats = (0..learners)
            .map(|index| {
                Seat::new(
                    plan.learner(index),
                    index,
                    environments.len(),
                    shape,
                    &settings,
                )
            })
            .collect();
        let workspaces = (0..rayon::current_num_threads().min(learners))
            .map(|_| plan.workspace())
            .collect();
        Ok(Self {
            settings,
            shape,
            arenas: environments.iter().map(|_| Arena::new(shape)).collect(),
            environments,
            seats,
            workspaces,
            rounds: 0,
        })
    }

    /// One episode in every environment, exploring and learning.
    ///
    /// # Errors
    /// When an environment fails, gives a number that is not finite, or a network diverges.
    pub fn train_round(&mut self) -> Result<RoundReport, LearningError> {
        let seed = mixed(self.settings.seed, self.rounds);
        let report = self.round(seed, true)?;
        self.rounds += 1;
        Ok(report)
    }

    /// One episode in every environment with what was learnt: no exploration, no updates. Episode i
    /// has the seed `mixed(seed, i)`.
    ///
    /// # Errors
    /// When an environment fails or gives a number that is not finite.
    pub fn evaluate(&mut self, seed: u64) -> Result<RoundReport, LearningError> {
        self.round(seed, false)
    }

    /// Writes everything that is needed to go on: weights, targets and Adam's moments of every
    /// learner, settings and counts. The replay buffers are not kept; they fill anew.
    ///
    /// # Errors
    /// When the file cannot be written; an older one stays then.
    pub fn save(&self, path: &Path) -> Result<(), LearningError> {
        let mut writer = Writer::default();
        for seat in &self.seats {
            let Learner {
                index,
                actor,
                critic,
                ..
            } = &seat.learner;
            for (role, learnt) in [("actor", actor), ("critic", critic)] {
                for (part, numbers) in learnt.parts() {
                    writer.add(&format!("{index}.{role}.{part}"), &learnt.network, numbers);
                }
            }
        }
        writer.save(path, &self.header())
    }

    /// Writes the actors alone, for [`super::LearnedPolicy`].
    ///
    /// # Errors
    /// When the file cannot be written; an older one stays then.
    pub fn save_policy(&self, path: &Path) -> Result<(), LearningError> {
        let mut writer = Writer::default();
        for seat in &self.seats {
            let Learner { index, actor, .. } = &seat.learner;
            writer.add(
                &format!("{index}.actor.weights"),
                &actor.network,
                &actor.weights,
            );
        }
        writer.save(path, &self.header())
    }

    /// Goes on from a checkpoint, with its settings.
    ///
    /// # Errors
    /// When the file is missing, damaged, of other sizes than the environments, or has a number
    /// that is not finite.
    pub fn resume(environments: Vec<E>, path: &Path) -> Result<Self, LearningError> {
        let reader = Reader::open(path)?;
        let header = &reader.header;
        let mut trainer = Self::new(environments, header.settings)?;
        if trainer.shape != header.shape {
            let (found, needed) = (header.shape, trainer.shape);
            let problem = format!("is for {found:?}, the environments have {needed:?}");
            return Err(reader.problem(problem));
        }
        if trainer.seats.len() != header.learners.len() {
            let (found, needed) = (header.learners.len(), trainer.seats.len());
            return Err(reader.problem(format!("has {found} learners of {needed}")));
        }
        trainer.rounds = header.rounds;
        for (seat, counts) in trainer.seats.iter_mut().zip(&header.learners) {
            let Learner {
                index,
                actor,
                critic,
                ..
            } = &mut seat.learner;
            for (role, learnt) in [("actor", actor), ("critic", critic)] {
                let read =
                    |part| reader.numbers(&format!("{index}.{role}.{part}"), &learnt.network);
                let (weights, target) = (read("weights")?, read("target")?);
                let (mean, square) = (read("mean")?, read("square")?);
                let steps = counts.updates;
                (learnt.weights, learnt.target) = (weights, target);
                learnt.adam = Adam {
                    mean,
                    square,
                    steps,
                };
            }
            seat.learner.updates = counts.updates;
            seat.learner.decisions = counts.decisions;
        }
        Ok(trainer)
    }

    /// The actor of learner `index` as it is now; `None` without such a learner.
    pub fn policy(&self, index: usize, loop_length_m: Option<f64>) -> Option<LearnedPolicy> {
        let actor = &self.seats.get(index)?.learner.actor;
        let (network, weights) = (actor.network.clone(), actor.weights.clone());
        Some(LearnedPolicy::new(
            self.shape,
            self.settings,
            network,
            weights,
            loop_length_m,
        ))
    }

    fn header(&self) -> CheckpointHeader {
        let counts = |seat: &Seat| Counts {
            updates: seat.learner.updates,
            decisions: seat.learner.decisions,
        };
        let learners = self.seats.iter().map(counts).collect();
        let environment = self.environments[0].settings();
        CheckpointHeader::new(
            self.shape,
            self.settings,
            environment,
            self.rounds,
            learners,
        )
    }

    /// What is trained and how.
    pub fn settings(&self) -> &TrainingSettings {
        &self.settings
    }

    /// The environments.
    pub fn environments(&self) -> &[E] {
        &self.environments
    }

    /// Rounds trained so far.
    pub fn rounds(&self) -> u64 {
        self.rounds
    }

    /// Decisions that each learner has made while learning: one at every behaviour step.
    pub fn decisions(&self) -> u64 {
        self.seats[0].learner.decisions
    }

    /// Updates that the learners have made, all together.
    pub fn updates(&self) -> u64 {
        self.seats.iter().map(|seat| seat.learner.updates).sum()
    }

    /// Bytes taken by the replay buffers, and those of one transition.
    pub fn replay_bytes(&self) -> (usize, usize) {
        let of_all = self
            .seats
            .iter()
            .map(|seat| seat.learner.replay.bytes())
            .sum();
        let of_one = self.seats[0].learner.replay.bytes_per_transition();
        (of_all, of_one)
    }

    fn round(&mut self, seed: u64, learns: bool) -> Result<RoundReport, LearningError> {
        self.reset(seed)?;
        for seat in &mut self.seats {
            seat.begin(mixed(seed, u64::MAX));
        }
        while self.arenas.iter().any(|arena| arena.phase != Phase::Done) {
            self.decide(learns)?;
            if learns {
                self.learn()?;
            }
            self.step()?;
        }
        let updates: u64 = self.seats.iter().map(|seat| seat.updates).sum();
        let mean = |index: usize| {
            let sum: f64 = self.seats.iter().map(|seat| seat.losses[index]).sum();
            sum / updates.max(1) as f64
        };
        Ok(RoundReport {
            episodes: self.arenas.iter().map(|arena| arena.report).collect(),
            updates: UpdateReport {
                updates,
                critic_loss: mean(0),
                value: mean(1),
            },
        })
    }

    fn reset(&mut self, seed: u64) -> Result<(), LearningError> {
        self.environments
            .par_iter_mut()
            .zip(&mut self.arenas)
            .enumerate()
            .try_for_each(|(index, (environment, arena))| {
                arena.reset(environment, mixed(seed, index as u64))
            })?;
        Ok(())
    }

    /// Every learner notes what its agents see, where it learns, and decides for them.
    fn decide(&mut self, learns: bool) -> Result<(), LearningError> {
        let (arenas, settings) = (&self.arenas, &self.settings);
        with_workspaces(&mut self.seats, &mut self.workspaces, |seat, workspace| {
            seat.decide(arenas, settings, learns, workspace)
        })?;
        for seat in &self.seats {
            let decided = seat.actions.iter().zip(&seat.inputs);
            for (&(arena, agent), (&action, &input)) in seat.agents.iter().zip(decided) {
                self.arenas[arena].actions[agent] = action;
                self.arenas[arena].inputs[agent] = input;
            }
        }
        Ok(())
    }

    /// Every learner completes its agents' last transitions and updates.
    fn learn(&mut self) -> Result<(), LearningError> {
        let (arenas, settings) = (&self.arenas, &self.settings);
        with_workspaces(&mut self.seats, &mut self.workspaces, |seat, workspace| {
            seat.learn(arenas, settings, workspace)
        })
    }

    /// Every running environment executes the actions.
    fn step(&mut self) -> Result<(), LearningError> {
        let steers = self.settings.algorithm.steers();
        self.environments
            .par_iter_mut()
            .zip(&mut self.arenas)
            .try_for_each(|(environment, arena)| arena.step(environment, steers))?;
        Ok(())
    }
}

/// Does `work` for every seat in parallel, each with a workspace of its own thread.
fn with_workspaces(
    seats: &mut [Seat],
    workspaces: &mut [Workspace],
    work: impl Fn(&mut Seat, &mut Workspace) -> Result<(), LearningError> + Sync,
) -> Result<(), LearningError> {
    let each = seats.len().div_ceil(workspaces.len());
    seats
        .par_chunks_mut(each)
        .zip(workspaces)
        .try_for_each(|(seats, workspace)| {
            seats.iter_mut().try_for_each(|seat| work(seat, workspace))
        })
}

fn common_shape<E: Environment>(
    environments: &[E],
    algorithm: Algorithm,
) -> Result<Shape, LearningError> {
    let refuse = |problem: String| Err(LearningError::Environments(problem));
    let Some(first) = environments.first() else {
        return refuse("there is no environment to learn in; give at least one".into());
    };
    let shape = first.shape();
    if let Some(other) = environments
        .iter()
        .map(E::shape)
        .find(|other| *other != shape)
    {
        return refuse(format!(
            "environments of different sizes cannot share learners: {shape:?} and {other:?}"
        ));
    }
    shape.validate()?;
    if algorithm.is_central() && shape.global == 0 {
        return refuse("MADDPG needs the global state; set Shape::global above 0".into());
    }
    Ok(shape)
}

#[cfg(test)]
impl<E: Environment> Trainer<E> {
    /// The first critic's values of every own action in a situation, given the neighbours' actions.
    pub(super) fn critic_values(
        &self,
        situation: &super::Situation<'_>,
        neighbours: &[Option<covista_world::Action>],
    ) -> Vec<f32> {
        let mut workspace = Plan::new(self.shape, &self.settings).workspace();
        let mut batch = workspace.minibatch.now.clone();
        batch.lay_out(1, |_| neighbours.len());
        batch.write(0, situation);
        for (slot, action) in neighbours.iter().enumerate() {
            let place = action.map_or(u8::MAX, |action| super::action_index(action) as u8);
            super::batch::write_one_hot(place, batch.neighbour_mut(0, slot).1);
        }
        self.seats[0]
            .learner
            .values(&batch, &mut workspace)
            .to_vec()
    }

    /// Makes the first critic's values infinite.
    pub(super) fn poison(&mut self) {
        let last_bias = self.seats[0].learner.critic.weights.last_mut();
        *last_bias.expect("a weight") = f32::INFINITY;
    }

    /// Every weight's bits.
    pub(super) fn fingerprint(&self) -> Vec<u32> {
        let learners = self.seats.iter().map(|seat| &seat.learner);
        let networks = learners.flat_map(|learner| [&learner.actor, &learner.critic]);
        networks
            .flat_map(|n| n.weights.iter().chain(&n.target))
            .map(|w| w.to_bits())
            .collect()
    }
}

/// A seed out of a seed and a number (SplitMix64).
pub fn mixed(seed: u64, number: u64) -> u64 {
    let mut z = seed.wrapping_add((number.wrapping_add(1)).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
