use covista_world::{LaneIndex, Road};

/// Some of the lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LaneSet([bool; covista_world::LANE_COUNT as usize]);

impl LaneSet {
    /// Whether `lane` is one of them.
    pub fn contains(self, lane: LaneIndex) -> bool {
        self.0[usize::from(lane.get())]
    }

    /// Adds `lane`.
    pub fn insert(&mut self, lane: LaneIndex) {
        self.0[usize::from(lane.get())] = true;
    }

    /// The lanes into which offsets from `right_m` to `left_m` reach by more than `entry_m`.
    pub fn between(road: &Road, right_m: f64, left_m: f64, entry_m: f64) -> Self {
        let mut lanes = Self::default();
        for lane in LaneIndex::all() {
            let (lane_right, lane_left) = road.lane_bounds_m(lane);
            if left_m > lane_right + entry_m && right_m < lane_left - entry_m {
                lanes.insert(lane);
            }
        }
        lanes
    }
}
