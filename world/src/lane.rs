use serde::{Deserialize, Serialize};

/// Lanes of the freeway of the paper (Section V).
pub const LANE_COUNT: u8 = 3;

/// A lane, counted from the leftmost in driving direction: 0, 1, 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct LaneIndex(u8);

impl LaneIndex {
    /// The leftmost lane.
    pub const LEFTMOST: Self = Self(0);
    /// The rightmost lane.
    pub const RIGHTMOST: Self = Self(LANE_COUNT - 1);

    /// The lane with this index, or `None` where there is none.
    pub fn new(index: u8) -> Option<Self> {
        (index < LANE_COUNT).then_some(Self(index))
    }

    /// All lanes, from left to right.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..LANE_COUNT).map(Self)
    }

    /// The index: 0 is the leftmost.
    pub fn get(self) -> u8 {
        self.0
    }

    /// The next lane to the left.
    pub fn left(self) -> Option<Self> {
        self.0.checked_sub(1).map(Self)
    }

    /// The next lane to the right.
    pub fn right(self) -> Option<Self> {
        Self::new(self.0 + 1)
    }
}
