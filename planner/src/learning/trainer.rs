use std::path::Path;

use covista_world::Action;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::batch::BatchShape;
use super::checkpoint::{CheckpointHeader, Counts, Reader, Writer};
use super::learner::{Learner, Losses, Workspace};
use super::network::Network;
use super::nn::Adam;
use super::replay::{FrameId, ReplayBuffer};
use super::{
    ACTIONS, Environment, Hyperparameters, LearnedPolicy, LearningError, Outcome, Shape, Situation,
    Situations,
};

/// What learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Alg. 2: truncated critic, safe action mapping.
    SafeActorCritic,
    /// The baseline: a critic of the global state and the joint action, any legal action.
    Maddpg,
    /// The same with the safe action mapping.
    MaddpgMapped,
}

impl Algorithm {
    /// Whether only safe actions are executed.
    pub fn is_mapped(self) -> bool {
        self != Self::Maddpg
    }

    fn is_central(self) -> bool {
        self != Self::SafeActorCritic
    }
}

/// Who learns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sharing {
    /// Each agent has networks and a buffer of its own, as in Alg. 2.
    Independent,
    /// All agents use and train the same networks.
    Shared,
}

/// What to train and how.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingSettings {
    /// What learns.
    pub algorithm: Algorithm,
    /// Who learns.
    pub sharing: Sharing,
    /// How it learns.
    pub hyperparameters: Hyperparameters,
    /// Of all random numbers.
    pub seed: u64,
}

impl Default for TrainingSettings {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::SafeActorCritic,
            sharing: Sharing::Independent,
            hyperparameters: Hyperparameters::default(),
            seed: 0,
        }
    }
}

/// What an episode of one environment came to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EpisodeReport {
    /// Behaviour steps.
    pub steps: u64,
    /// Rewards, summed over the steps, mean over the agents: the paper's global reward.
    pub reward: f64,
    /// Actions executed that were not safe.
    pub unsafe_actions: u64,
    /// Emergency stops.
    pub emergency_stops: u64,
    /// Lane changes among the actions.
    pub lane_changes: u64,
    /// Agents that were terminated.
    pub terminated: u64,
}

/// What the updates of a round of episodes came to.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct UpdateReport {
    /// Updates in all.
    pub updates: u64,
    /// Mean squared error of the critics.
    pub critic_loss: f64,
    /// Mean value of the actors' choices by their critics.
    pub value: f64,
}

/// What one environment wrote last.
struct Arena {
    situations: Situations,
    outcome: Outcome,
    actions: Vec<Action>,
    phase: Phase,
    report: EpisodeReport,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The next actions are to be executed.
    Running,
    /// It is over; what would have been done next is still needed for the last transitions.
    Ending,
    /// Nothing is left to do.
    Done,
}

/// A learner with what it is about in this step.
struct Seat {
    learner: Learner,
    /// The agents that it acts for, as (arena, agent).
    agents: Vec<(usize, usize)>,
    actions: Vec<Action>,
    before: Vec<Option<FrameId>>,
    now: Vec<Option<FrameId>>,
    central: Vec<f32>,
    losses: [f64; 2],
    updates: u64,
}

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

/// What a round of episodes came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RoundReport {
    /// Of each environment.
    pub episodes: Vec<EpisodeReport>,
    /// Of all learners together; zero in an evaluation.
    pub updates: UpdateReport,
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
        let arena = |_: &E| Arena {
            situations: Situations::new(shape),
            outcome: Outcome::new(shape.agents),
            actions: vec![Action::KeepLane; shape.agents],
            phase: Phase::Done,
            report: EpisodeReport::default(),
        };
        Ok(Self {
            settings,
            shape,
            arenas: environments.iter().map(arena).collect(),
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
        CheckpointHeader::new(self.shape, self.settings, self.rounds, learners)
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
                arena.phase = Phase::Running;
                arena.report = EpisodeReport::default();
                arena.outcome.clear();
                arena.situations.clear();
                environment.reset(mixed(seed, index as u64), &mut arena.situations)
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
            for (&(arena, agent), &action) in seat.agents.iter().zip(&seat.actions) {
                self.arenas[arena].actions[agent] = action;
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
        self.environments
            .par_iter_mut()
            .zip(&mut self.arenas)
            .try_for_each(|(environment, arena)| arena.step(environment))?;
        Ok(())
    }
}

impl Arena {
    fn step(&mut self, environment: &mut impl Environment) -> Result<(), super::EnvironmentError> {
        if self.phase != Phase::Running {
            self.phase = Phase::Done;
            return Ok(());
        }
        let agents = self.actions.len();
        for (agent, &action) in self.actions.iter().enumerate() {
            let is_stop = action == Action::EmergencyStop;
            let safe = self.situations.get(agent).options.safe;
            self.report.emergency_stops += u64::from(is_stop);
            self.report.lane_changes += u64::from(action.is_lane_change());
            self.report.unsafe_actions += u64::from(!is_stop && !safe.contains(action));
        }
        self.outcome.clear();
        self.situations.clear();
        environment.step(&self.actions, &mut self.outcome, &mut self.situations)?;
        self.report.steps += 1;
        let reward: f64 = self.outcome.rewards.iter().copied().map(f64::from).sum();
        self.report.reward += reward / agents as f64;
        if self.outcome.is_over {
            self.report.terminated = self.outcome.terminated.iter().filter(|&&t| t).count() as u64;
            self.phase = Phase::Ending;
        }
        Ok(())
    }
}

impl Seat {
    fn new(
        learner: Learner,
        index: usize,
        arenas: usize,
        shape: Shape,
        settings: &TrainingSettings,
    ) -> Self {
        let agents: Vec<_> = match settings.sharing {
            Sharing::Independent => (0..arenas).map(|arena| (arena, index)).collect(),
            Sharing::Shared => (0..arenas)
                .flat_map(|arena| (0..shape.agents).map(move |agent| (arena, agent)))
                .collect(),
        };
        let is_central = settings.algorithm.is_central();
        let central = if is_central {
            shape.agents * shape.global
        } else {
            0
        };
        Self {
            learner,
            actions: vec![Action::KeepLane; agents.len()],
            before: vec![None; agents.len()],
            now: vec![None; agents.len()],
            agents,
            central: vec![0.0; central],
            losses: [0.0; 2],
            updates: 0,
        }
    }

    fn begin(&mut self, seed: u64) {
        self.learner.reseed(seed);
        self.before.fill(None);
        self.now.fill(None);
        self.losses = [0.0; 2];
        self.updates = 0;
    }

    fn decide(
        &mut self,
        arenas: &[Arena],
        settings: &TrainingSettings,
        learns: bool,
        workspace: &mut Workspace,
    ) -> Result<(), LearningError> {
        let is_mapped = settings.algorithm.is_mapped();
        let agents = &self.agents;
        if learns {
            std::mem::swap(&mut self.before, &mut self.now);
            for (&(arena, agent), now) in agents.iter().zip(&mut self.now) {
                let arena = &arenas[arena];
                *now = None;
                if arena.phase != Phase::Done && !arena.outcome.terminated[agent] {
                    write_central(&arena.situations, agent, &mut self.central);
                    let situation = seen(arena, agent, is_mapped);
                    let safe = situation.options.safe;
                    let frame = self
                        .learner
                        .replay
                        .push(agent, &situation, safe, &self.central)?;
                    *now = Some(frame);
                }
            }
        }
        let situation = |item: usize| {
            let (arena, agent) = agents[item];
            seen(&arenas[arena], agent, is_mapped)
        };
        self.learner
            .act(situation, learns, workspace, &mut self.actions);
        Ok(())
    }

    fn learn(
        &mut self,
        arenas: &[Arena],
        settings: &TrainingSettings,
        workspace: &mut Workspace,
    ) -> Result<(), LearningError> {
        let is_central = settings.algorithm.is_central();
        for (item, &(arena, agent)) in self.agents.iter().enumerate() {
            let arena = &arenas[arena];
            let replay = &mut self.learner.replay;
            if let Some(now) = self.now[item] {
                let neighbours = arena.situations.get(agent).agents.iter();
                let told = neighbours.map(|&other| arena.actions.get(other? as usize).copied());
                let others = if is_central { arena.actions.len() } else { 0 };
                let joint = (1..others).map(|by| arena.actions[(agent + by) % others]);
                replay.decide(now, arena.actions[agent], told, joint);
            }
            if let (Some(before), true) = (self.before[item], arena.phase != Phase::Done) {
                let reward = arena.outcome.rewards[agent];
                replay.complete(agent, before, reward, self.now[item])?;
            }
        }
        for _ in 0..settings.hyperparameters.updates_per_decision {
            if let Some(Losses { critic, value }) = self.learner.update(workspace)? {
                self.losses[0] += f64::from(critic);
                self.losses[1] += f64::from(value);
                self.updates += 1;
            }
        }
        Ok(())
    }
}

/// What the agent sees, with the options that the algorithm keeps to as its safe ones.
fn seen(arena: &Arena, agent: usize, is_mapped: bool) -> Situation<'_> {
    let mut situation = arena.situations.get(agent);
    if !is_mapped {
        situation.options.safe = situation.options.legal;
    }
    situation
}

/// The global state as `agent` has it: its own part first, the others' after it in their order.
fn write_central(situations: &Situations, agent: usize, central: &mut [f32]) {
    if central.is_empty() {
        return;
    }
    let Shape { agents, global, .. } = situations.shape();
    for (by, to) in central.chunks_exact_mut(global).enumerate() {
        let other = (agent + by) % agents;
        to.copy_from_slice(&situations.global()[other * global..][..global]);
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

/// The sizes and networks of a training.
pub(super) struct Plan {
    pub batch: BatchShape,
    pub actor: Network,
    pub critic: Network,
    joint: usize,
    settings: TrainingSettings,
}

impl Plan {
    pub fn new(shape: Shape, settings: &TrainingSettings) -> Self {
        let is_central = settings.algorithm.is_central();
        let joint = if is_central { shape.agents - 1 } else { 0 };
        let global = if is_central {
            shape.agents * shape.global
        } else {
            0
        };
        let batch = BatchShape {
            rows: settings.hyperparameters.minibatch,
            own: shape.own,
            neighbours: shape.neighbours,
            neighbour: shape.neighbour,
            central: global + joint * ACTIONS,
        };
        let hidden = settings.hyperparameters.hidden;
        Self {
            batch,
            actor: Network::actor(batch, hidden),
            critic: if is_central {
                Network::central_critic(batch, hidden)
            } else {
                Network::truncated_critic(batch, hidden)
            },
            joint,
            settings: *settings,
        }
    }

    pub fn learner(&self, index: usize) -> Learner {
        let settings = self.settings.hyperparameters;
        let replay = ReplayBuffer::new(self.batch, self.joint, settings.replay);
        let (actor, critic) = (self.actor.clone(), self.critic.clone());
        Learner::new(index, actor, critic, replay, settings, self.settings.seed)
    }

    /// Features of the global state that a centralised critic gets.
    pub fn central_features(&self) -> usize {
        self.batch.central - self.joint * ACTIONS
    }

    pub fn workspace(&self) -> Workspace {
        Workspace::new(&self.actor, &self.critic, self.batch)
    }
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
        situation: &Situation<'_>,
        neighbours: &[Option<Action>],
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
