use super::{ActionSet, Options, Shape};

/// What n agents see before they decide, one row for each.
///
/// All features are about in [-1, 1] and finite; [`super::FeatureEncoder`] makes them from
/// [`crate::Observation`]s.
#[derive(Debug, Clone, PartialEq)]
pub struct Situations {
    shape: Shape,
    pub(super) own: Vec<f32>,
    pub(super) neighbours: Vec<f32>,
    pub(super) agents: Vec<Option<u32>>,
    pub(super) known: Vec<usize>,
    pub(super) legal: Vec<ActionSet>,
    pub(super) safe: Vec<ActionSet>,
    pub(super) global: Vec<f32>,
}

/// What one agent sees.
#[derive(Debug, Clone, Copy)]
pub struct Situation<'a> {
    /// Own state s^i, [`Shape::own`] features.
    pub own: &'a [f32],
    /// The states of its neighbours, nearest first, [`Shape::neighbour`] features each.
    pub neighbours: &'a [f32],
    /// For each neighbour: which agent it is, `None` for a human or a CAV that is not reached.
    pub agents: &'a [Option<u32>],
    /// Its legal and its safe actions.
    pub options: Options,
}

/// One agent's row to be written.
#[derive(Debug)]
pub struct SituationMut<'a> {
    /// Own state s^i, [`Shape::own`] features.
    pub own: &'a mut [f32],
    /// Room for [`Shape::neighbours`] neighbours, nearest first, [`Shape::neighbour`] features each.
    pub neighbours: &'a mut [f32],
    /// Room for which agent each neighbour is: the critic looks up its action there.
    pub agents: &'a mut [Option<u32>],
    /// How many neighbours there are.
    pub known: &'a mut usize,
    /// The legal actions.
    pub legal: &'a mut ActionSet,
    /// The safe ones of them.
    pub safe: &'a mut ActionSet,
    /// This agent's part of the global state, [`Shape::global`] features.
    pub global: &'a mut [f32],
}

impl Situations {
    /// Room for the agents of `shape`.
    pub fn new(shape: Shape) -> Self {
        let n = shape.agents;
        Self {
            shape,
            own: vec![0.0; n * shape.own],
            neighbours: vec![0.0; n * shape.neighbours * shape.neighbour],
            agents: vec![None; n * shape.neighbours],
            known: vec![0; n],
            legal: vec![ActionSet::EMPTY; n],
            safe: vec![ActionSet::EMPTY; n],
            global: vec![0.0; n * shape.global],
        }
    }

    /// Its sizes.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// No neighbours, no legal action, all features zero.
    pub fn clear(&mut self) {
        self.own.fill(0.0);
        self.neighbours.fill(0.0);
        self.agents.fill(None);
        self.known.fill(0);
        self.legal.fill(ActionSet::EMPTY);
        self.safe.fill(ActionSet::EMPTY);
        self.global.fill(0.0);
    }

    /// What agent `index` sees.
    ///
    /// # Panics
    /// Without such an agent, as a slice does.
    pub fn get(&self, index: usize) -> Situation<'_> {
        let Shape {
            own,
            neighbours,
            neighbour,
            ..
        } = self.shape;
        let known = self.known[index].min(neighbours);
        let first = index * neighbours;
        Situation {
            own: &self.own[index * own..][..own],
            neighbours: &self.neighbours[first * neighbour..][..known * neighbour],
            agents: &self.agents[first..][..known],
            options: Options {
                legal: self.legal[index],
                safe: self.safe[index].and(self.legal[index]),
            },
        }
    }

    /// The row of agent `index`, to write it.
    ///
    /// # Panics
    /// Without such an agent, as a slice does.
    pub fn get_mut(&mut self, index: usize) -> SituationMut<'_> {
        let Shape {
            own,
            neighbours,
            neighbour,
            global,
            ..
        } = self.shape;
        let first = index * neighbours;
        SituationMut {
            own: &mut self.own[index * own..][..own],
            neighbours: &mut self.neighbours[first * neighbour..][..neighbours * neighbour],
            agents: &mut self.agents[first..][..neighbours],
            known: &mut self.known[index],
            legal: &mut self.legal[index],
            safe: &mut self.safe[index],
            global: &mut self.global[index * global..][..global],
        }
    }

    /// The global state s, agent by agent.
    pub fn global(&self) -> &[f32] {
        &self.global
    }
}
