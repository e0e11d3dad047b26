use covista_world::Action;

use super::arena::{Arena, Phase};
use super::kept_action::KeptAction;
use super::learner::{Learner, Losses, Workspace};
use super::replay::{FrameId, ReplayBuffer};
use super::{InputShares, LearningError, Objective, Shape, Sharing, Situations, TrainingSettings};

/// A learner with what it is about in this step.
pub(super) struct Seat {
    pub learner: Learner,
    /// The agents that it acts for, as (arena, agent).
    pub agents: Vec<(usize, usize)>,
    pub actions: Vec<Action>,
    pub inputs: Vec<InputShares>,
    pub before: Vec<Option<FrameId>>,
    pub now: Vec<Option<FrameId>>,
    pub central: Vec<f32>,
    pub losses: [f64; 2],
    pub updates: u64,
}

impl Seat {
    pub fn new(
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
            inputs: vec![InputShares::default(); agents.len()],
            before: vec![None; agents.len()],
            now: vec![None; agents.len()],
            agents,
            central: vec![0.0; central],
            losses: [0.0; 2],
            updates: 0,
        }
    }

    /// Begins a round.
    pub fn begin(&mut self, seed: u64) {
        self.learner.reseed(seed);
        self.before.fill(None);
        self.now.fill(None);
        self.losses = [0.0; 2];
        self.updates = 0;
    }

    /// Notes what its agents see, where it learns, and decides for them.
    pub fn decide(
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
                    let situation = arena.situation(agent, is_mapped);
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
            arenas[arena].situation(agent, is_mapped)
        };
        if settings.algorithm.steers() {
            self.learner
                .steer(situation, learns, workspace, &mut self.inputs);
        } else {
            self.learner
                .act(situation, learns, workspace, &mut self.actions);
        }
        Ok(())
    }

    /// Completes its agents' last transitions with what they brought and what everybody does now;
    /// then updates.
    pub fn learn(
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
                if settings.algorithm.steers() {
                    note(replay, now, agent, arena, &arena.inputs, is_central);
                } else {
                    note(replay, now, agent, arena, &arena.actions, is_central);
                }
            }
            if let (Some(before), true) = (self.before[item], arena.phase != Phase::Done) {
                let outcome = &arena.outcome;
                let brought = brought(arena, agent, settings.objective);
                let reward =
                    (settings.hyperparameters).learnt_reward(brought, outcome.terminated[agent]);
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

/// What the newest step brought `agent`, and those who are in reach to tell theirs when it is over.
fn brought(arena: &Arena, agent: usize, objective: Objective) -> f32 {
    let rewards = &arena.outcome.rewards;
    match objective {
        Objective::Own => rewards[agent],
        Objective::Neighbourhood => {
            let neighbours = arena.situations.get(agent).agents.iter().flatten();
            let all = neighbours.map(|&other| rewards[other as usize]);
            let (sum, count) = all.fold((rewards[agent], 1.0), |(sum, count), reward| {
                (sum + reward, count + 1.0)
            });
            sum / count
        }
    }
}

/// Notes what `agent` did in a frame, and what its neighbours did or, for a centralised critic,
/// everybody else.
fn note<A: KeptAction>(
    replay: &mut ReplayBuffer,
    now: FrameId,
    agent: usize,
    arena: &Arena,
    actions: &[A],
    is_central: bool,
) {
    let neighbours = arena.situations.get(agent).agents.iter();
    let told = neighbours.map(|&other| actions.get(other? as usize).copied());
    let others = if is_central { actions.len() } else { 0 };
    let joint = (1..others).map(|by| actions[(agent + by) % others]);
    replay.decide(now, actions[agent], told, joint);
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

#[cfg(test)]
#[allow(clippy::float_cmp)] // these numbers are exact
mod tests {
    use super::*;

    #[test]
    fn a_neighbourhoods_reward_is_the_mean_of_its_agents() {
        let shape = Shape {
            agents: 3,
            own: 1,
            neighbours: 3,
            neighbour: 1,
            global: 0,
        };
        let mut arena = Arena::new(shape);
        arena.outcome.rewards.copy_from_slice(&[1.0, 5.0, 30.0]);
        let row = arena.situations.get_mut(1);
        // A human driver stands between the two CAVs; a third neighbour is not there.
        row.agents.copy_from_slice(&[Some(0), None, Some(2)]);
        *row.known = 2;
        let of = |agent, objective| brought(&arena, agent, objective);
        assert_eq!(of(1, Objective::Own), 5.0);
        assert_eq!(of(1, Objective::Neighbourhood), 3.0);
        assert_eq!(of(2, Objective::Neighbourhood), 30.0);
    }
}
