use covista_world::{LANE_COUNT, LaneIndex};

use crate::{
    LoopRoad,
    human::{Across, Strip},
};

/// How many vehicles ahead in each lane somebody looks at.
const AHEAD: usize = 2;
/// What two bodies may reach beyond their strips: roads bend, and CAVs may face anywhere.
const BEYOND_M: f64 = 5.0;
/// All that somebody looks at: in each lane those ahead and one behind.
const SEEN_MAX: usize = (AHEAD + 1) * LANE_COUNT as usize;

/// Who is where on a ring: the vehicles in the order of their fronts, once for the whole road and
/// once for each lane they reach into, or are about to.
#[derive(Debug, Clone)]
pub(super) struct Lanes {
    period_m: f64,
    bounds: [Across; LANE_COUNT as usize],
    strips: Vec<Strip>,
    ring: Vec<Entry>,
    lanes: [Vec<Entry>; LANE_COUNT as usize],
}

/// A vehicle and where its front is in its lap.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub front_m: f64,
    pub index: u32,
}

/// What somebody sees: the strips of the nearest images, and whose they are.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    strips: [Strip; SEEN_MAX],
    indices: [u32; SEEN_MAX],
    count: usize,
}

impl Seen {
    pub fn strips(&self) -> &[Strip] {
        &self.strips[..self.count]
    }

    pub fn index(&self, of: usize) -> u32 {
        self.indices[of]
    }

    fn push(&mut self, mut strip: Strip, index: u32, moved_m: f64) {
        strip.front_m += moved_m;
        strip.rear_m += moved_m;
        self.strips[self.count] = strip;
        self.indices[self.count] = index;
        self.count += 1;
    }
}

impl Lanes {
    pub fn new(road: &LoopRoad, vehicles: usize) -> Self {
        let bounds = LaneIndex::all().map(|lane| {
            let (right_m, left_m) = road.road().lane_bounds_m(lane);
            Across { right_m, left_m }
        });
        let mut lanes = Self {
            period_m: road.period_m(),
            bounds: [Across::default(); LANE_COUNT as usize],
            strips: Vec::with_capacity(vehicles),
            ring: Vec::with_capacity(vehicles),
            lanes: std::array::from_fn(|_| Vec::with_capacity(vehicles)),
        };
        for (known, bounds) in lanes.bounds.iter_mut().zip(bounds) {
            *known = bounds;
        }
        lanes
    }

    /// Takes everybody's strip up; fronts lie in [0, period).
    pub fn update(&mut self, strips: impl Iterator<Item = Strip>) {
        self.strips.clear();
        self.strips.extend(strips);
        self.sort();
        for (lane, bounds) in self.lanes.iter_mut().zip(self.bounds) {
            lane.clear();
            let strips = &self.strips;
            let claims = |entry: &&Entry| strips[entry.index as usize].across.overlaps(bounds);
            lane.extend(self.ring.iter().filter(claims));
        }
    }

    fn sort(&mut self) {
        let Self { strips, ring, .. } = self;
        if ring.len() != strips.len() {
            ring.clear();
            let index = 0..strips.len() as u32;
            ring.extend(index.map(|index| Entry {
                front_m: 0.0,
                index,
            }));
        }
        for entry in ring.iter_mut() {
            entry.front_m = strips[entry.index as usize].front_m;
        }
        ring.sort_unstable_by(|a, b| a.front_m.total_cmp(&b.front_m).then(a.index.cmp(&b.index)));
    }

    pub fn strip(&self, index: usize) -> &Strip {
        &self.strips[index]
    }

    /// Calls `each` with every pair whose strips overlap: there is no contact but among these.
    pub fn near_pairs(&self, mut each: impl FnMut(u32, u32)) {
        let longest_m = self
            .strips
            .iter()
            .map(|strip| strip.front_m - strip.rear_m)
            .fold(0.0, f64::max);
        for (place, one) in self.ring.iter().enumerate() {
            let first = self.strips[one.index as usize];
            let next = self.ring[place + 1..].iter().map(|entry| (entry, 0.0));
            let lapped = self.ring[..place]
                .iter()
                .map(|entry| (entry, self.period_m));
            for (other, lap_m) in next.chain(lapped) {
                let reach_m = first.front_m - other.front_m - lap_m + BEYOND_M;
                if reach_m + longest_m < 0.0 {
                    break;
                }
                let second = self.strips[other.index as usize];
                let length_m = second.front_m - second.rear_m;
                if reach_m + length_m >= 0.0 && first.across.overlaps(second.across) {
                    each(one.index.min(other.index), one.index.max(other.index));
                }
            }
        }
    }

    /// A vehicle covers more than before: others see it from now on.
    pub fn claim(&mut self, index: usize, strip: Strip) {
        let before = std::mem::replace(&mut self.strips[index], strip).across;
        let front_m = strip.front_m;
        for (lane, bounds) in self.lanes.iter_mut().zip(self.bounds) {
            if strip.across.overlaps(bounds) && !before.overlaps(bounds) {
                let at = lane.partition_point(|entry| entry.front_m <= front_m);
                let index = index as u32;
                lane.insert(at, Entry { front_m, index });
            }
        }
    }

    /// What vehicle `index` sees: in each lane the nearest ahead and the nearest behind.
    pub fn around(&self, index: usize) -> Seen {
        let own_m = self.strips[index].front_m;
        let mut seen = Seen::default();
        for lane in &self.lanes {
            let after = lane.partition_point(|entry| entry.front_m <= own_m);
            let count = lane.len();
            let is_other = |place: &usize| lane[place % count].index != index as u32;
            let ahead = (after..after + count).filter(is_other).take(AHEAD);
            for place in ahead {
                let lap_m = if place < count { 0.0 } else { self.period_m };
                self.push(&mut seen, lane[place % count], lap_m);
            }
            let behind = (after..after + count).rev().find(is_other);
            if let Some(place) = behind {
                let lap_m = if place < count { -self.period_m } else { 0.0 };
                self.push(&mut seen, lane[place % count], lap_m);
            }
        }
        seen
    }

    fn push(&self, seen: &mut Seen, entry: Entry, moved_m: f64) {
        seen.push(self.strips[entry.index as usize], entry.index, moved_m);
    }
}
