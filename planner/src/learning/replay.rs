use rand::Rng;

use super::batch::{Batch, BatchShape};
use super::kept_action::{KeptAction, MOST_BYTES, UNKNOWN, bytes_of, restored, write_action};
use super::{ActionSet, LearningError, Situation};

/// Frames that are allocated together.
const CHUNK: usize = 4096;
/// No following frame.
const NONE: u32 = u32::MAX;
/// Steps of a feature in [0, 1]: of 150 m, 5 mm.
const STEPS: f32 = i16::MAX as f32;

/// Which part of an agent's time a frame of the buffer is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameId(u64);

/// What is known of a frame besides its features.
#[derive(Debug, Clone, Copy)]
struct Record {
    reward: f32,
    /// The frame that holds s'; `NONE` while there is none.
    next: u32,
    action: [u8; MOST_BYTES],
    safe: u8,
    known: u8,
    /// Whether it is the start of a whole transition.
    is_whole: bool,
    terminated: bool,
}

struct Chunk {
    records: Box<[Record]>,
    features: Box<[i16]>,
    actions: Box<[u8]>,
}

/// Transitions (s, a, r, s') of one learner, the newest `capacity` of them, from which minibatches
/// are drawn uniformly.
///
/// Successive situations of an agent are stored once each, as frames that point to the next one,
/// which also holds the safe set at s' and what the neighbours did there. Features are kept in 16
/// bits over [-1, 1], actions in a byte, control inputs in two; memory is taken as it is needed.
pub(super) struct ReplayBuffer {
    shape: BatchShape,
    joint: usize,
    capacity: usize,
    pushed: u64,
    whole: usize,
    chunks: Vec<Chunk>,
}

/// A drawn minibatch.
#[derive(Debug)]
pub(super) struct Minibatch {
    /// s and a^N of every transition.
    pub now: Batch,
    /// s' and a'^N of those that go on.
    pub next: Batch,
    /// The own action's place, the reward, and the row of `next`, by row of `now`.
    pub action: Vec<u8>,
    pub reward: Vec<f32>,
    pub next_row: Vec<Option<usize>>,
    slots: Vec<usize>,
    next_slots: Vec<usize>,
    row_of: Vec<usize>,
}

impl Minibatch {
    pub fn new(shape: BatchShape) -> Self {
        Self {
            now: Batch::new(shape),
            next: Batch::new(shape),
            action: vec![0; shape.rows],
            reward: vec![0.0; shape.rows],
            next_row: vec![None; shape.rows],
            slots: Vec::with_capacity(shape.rows),
            next_slots: Vec::with_capacity(shape.rows),
            row_of: vec![0; shape.rows],
        }
    }
}

impl ReplayBuffer {
    /// For frames of these sizes; the last `joint` x [`super::ACTIONS`] central inputs are others' actions.
    pub fn new(shape: BatchShape, joint: usize, capacity: usize) -> Self {
        debug_assert!(joint * shape.action <= shape.central);
        Self {
            shape,
            joint,
            capacity,
            pushed: 0,
            whole: 0,
            chunks: Vec::new(),
        }
    }

    /// Whole transitions in it.
    pub fn len(&self) -> usize {
        self.whole
    }

    /// Bytes of one frame, that is, of one transition.
    pub fn bytes_per_transition(&self) -> usize {
        size_of::<Record>() + self.features() * size_of::<i16>() + self.actions()
    }

    /// Bytes taken so far.
    pub fn bytes(&self) -> usize {
        self.chunks.len() * CHUNK.min(self.capacity) * self.bytes_per_transition()
    }

    fn central(&self) -> usize {
        self.shape.central - self.joint * self.shape.action
    }

    fn features(&self) -> usize {
        self.shape.own + self.shape.neighbours * self.shape.neighbour + self.central()
    }

    fn actions(&self) -> usize {
        (self.shape.neighbours + self.joint) * bytes_of(self.shape.action)
    }

    fn record(&self, slot: usize) -> &Record {
        &self.chunks[slot / CHUNK].records[slot % CHUNK]
    }

    fn record_mut(&mut self, slot: usize) -> &mut Record {
        &mut self.chunks[slot / CHUNK].records[slot % CHUNK]
    }

    fn frame(&self, slot: usize) -> (&[i16], &[u8]) {
        let (chunk, index) = (&self.chunks[slot / CHUNK], slot % CHUNK);
        let (features, actions) = (self.features(), self.actions());
        (
            &chunk.features[index * features..][..features],
            &chunk.actions[index * actions..][..actions],
        )
    }

    fn slot(&self, id: FrameId) -> Option<usize> {
        let is_kept = id.0 < self.pushed && id.0 + self.capacity as u64 >= self.pushed;
        is_kept.then(|| (id.0 % self.capacity as u64) as usize)
    }

    /// Stores what `agent` sees, and the centralised critic's features.
    pub fn push(
        &mut self,
        agent: usize,
        situation: &Situation<'_>,
        safe: ActionSet,
        central: &[f32],
    ) -> Result<FrameId, LearningError> {
        let given = [situation.own, situation.neighbours, central];
        if !given.iter().all(|part| part.iter().all(|x| x.is_finite())) {
            let what = "a feature";
            return Err(LearningError::NotFinite { agent, what });
        }
        let slot = (self.pushed % self.capacity as u64) as usize;
        if slot / CHUNK == self.chunks.len() {
            let frames = CHUNK.min(self.capacity);
            self.chunks.push(Chunk {
                records: vec![Record::EMPTY; frames].into(),
                features: vec![0; frames * self.features()].into(),
                actions: vec![UNKNOWN; frames * self.actions()].into(),
            });
        }
        self.whole -= usize::from(self.record(slot).is_whole);
        let known = situation.neighbours.len() / self.shape.neighbour;
        *self.record_mut(slot) = Record {
            safe: safe.bits(),
            known: known as u8,
            ..Record::EMPTY
        };
        let (own, central_from) = (self.shape.own, self.features() - self.central());
        let (features, actions) = (self.features(), self.actions());
        let (chunk, index) = (&mut self.chunks[slot / CHUNK], slot % CHUNK);
        let to = &mut chunk.features[index * features..][..features];
        quantise(situation.own, &mut to[..own]);
        quantise(
            situation.neighbours,
            &mut to[own..][..situation.neighbours.len()],
        );
        quantise(central, &mut to[central_from..]);
        chunk.actions[index * actions..][..actions].fill(UNKNOWN);
        let id = FrameId(self.pushed);
        self.pushed += 1;
        Ok(id)
    }

    /// Notes what was done in a frame: the own action, each neighbour's, and everybody else's for a
    /// centralised critic.
    pub fn decide<A: KeptAction>(
        &mut self,
        id: FrameId,
        action: A,
        neighbours: impl Iterator<Item = Option<A>>,
        joint: impl Iterator<Item = A>,
    ) {
        let Some(slot) = self.slot(id) else { return };
        self.record_mut(slot).action = action.bytes();
        let (actions, bytes) = (self.actions(), bytes_of(self.shape.action));
        let split = self.shape.neighbours * bytes;
        let chunk = &mut self.chunks[slot / CHUNK];
        let row = &mut chunk.actions[slot % CHUNK * actions..][..actions];
        let (of_neighbours, of_all) = row.split_at_mut(split);
        for (to, action) in of_neighbours.chunks_exact_mut(bytes).zip(neighbours) {
            let kept = action.map_or([UNKNOWN; MOST_BYTES], KeptAction::bytes);
            to.copy_from_slice(&kept[..bytes]);
        }
        for (to, action) in of_all.chunks_exact_mut(bytes).zip(joint) {
            to.copy_from_slice(&action.bytes()[..bytes]);
        }
    }

    /// Makes a frame a whole transition: what it brought, and the frame after it, which must be
    /// decided; `None` where it ended there for good.
    pub fn complete(
        &mut self,
        agent: usize,
        id: FrameId,
        reward: f32,
        next: Option<FrameId>,
    ) -> Result<(), LearningError> {
        if !reward.is_finite() {
            let what = "a reward";
            return Err(LearningError::NotFinite { agent, what });
        }
        let next_slot = next.and_then(|next| self.slot(next));
        let Some(slot) = self.slot(id) else {
            return Ok(());
        };
        let record = self.record_mut(slot);
        record.reward = reward;
        record.terminated = next.is_none();
        record.next = next_slot.map_or(NONE, |slot| slot as u32);
        record.is_whole = true;
        self.whole += 1;
        Ok(())
    }

    /// Draws as many transitions as `minibatch` has rows; false without any to draw.
    pub fn sample(&self, rng: &mut impl Rng, minibatch: &mut Minibatch) -> bool {
        if self.whole == 0 {
            return false;
        }
        let kept = self.pushed.min(self.capacity as u64) as usize;
        minibatch.slots.clear();
        while minibatch.slots.len() < self.shape_rows(minibatch) {
            let slot = rng.random_range(0..kept);
            if self.record(slot).is_whole {
                minibatch.slots.push(slot);
            }
        }
        self.load(minibatch);
        true
    }

    fn shape_rows(&self, minibatch: &Minibatch) -> usize {
        minibatch.now.shape().rows
    }

    fn load(&self, minibatch: &mut Minibatch) {
        let Minibatch {
            now,
            next,
            action,
            reward,
            next_row,
            slots,
            next_slots,
            row_of,
        } = minibatch;
        let known = |slot: usize| usize::from(self.record(slot).known);
        now.lay_out(slots.len(), |item| known(slots[item]));
        next_slots.clear();
        for row in 0..now.rows() {
            let slot = slots[now.order[row]];
            let record = self.record(slot);
            self.read(slot, row, now);
            action[row] = record.action[0];
            if bytes_of(self.shape.action) == MOST_BYTES {
                now.set_input(row, restored(record.action));
            }
            reward[row] = record.reward;
            next_row[row] = (!record.terminated).then_some(next_slots.len());
            if !record.terminated {
                next_slots.push(record.next as usize);
            }
        }
        next.lay_out(next_slots.len(), |item| known(next_slots[item]));
        for row in 0..next.rows() {
            row_of[next.order[row]] = row;
            self.read(next_slots[next.order[row]], row, next);
        }
        for next_row in next_row.iter_mut() {
            *next_row = next_row.map(|item| row_of[item]);
        }
    }

    /// Writes a frame into `row`.
    fn read(&self, slot: usize, row: usize, batch: &mut Batch) {
        let (features, actions) = self.frame(slot);
        let record = self.record(slot);
        let BatchShape {
            own,
            neighbours,
            neighbour,
            action: width,
            ..
        } = self.shape;
        let bytes = bytes_of(width);
        batch.safe[row] = ActionSet::from_bits(record.safe);
        restore(&features[..own], batch.own_mut(row));
        for slot in 0..usize::from(record.known) {
            let (state, action) = batch.neighbour_mut(row, slot);
            restore(&features[own + slot * neighbour..][..neighbour], state);
            write_action(&actions[slot * bytes..][..bytes], action);
        }
        if self.shape.central > 0 {
            let central = self.central();
            let (states, joint) = batch.central_mut(row).split_at_mut(central);
            restore(&features[own + neighbours * neighbour..], states);
            let of_all = actions[neighbours * bytes..].chunks_exact(bytes);
            for (to, action) in joint.chunks_exact_mut(width).zip(of_all) {
                write_action(action, to);
            }
        }
    }
}

impl Record {
    const EMPTY: Self = Self {
        reward: 0.0,
        next: NONE,
        action: [UNKNOWN; MOST_BYTES],
        safe: 0,
        known: 0,
        is_whole: false,
        terminated: false,
    };
}

fn quantise(features: &[f32], to: &mut [i16]) {
    for (to, &feature) in to.iter_mut().zip(features) {
        *to = (feature.clamp(-1.0, 1.0) * STEPS).round() as i16;
    }
}

fn restore(kept: &[i16], to: &mut [f32]) {
    for (to, &kept) in to.iter_mut().zip(kept) {
        *to = f32::from(kept) / STEPS;
    }
}
