use covista_control::SightLine;
use covista_world::{LANE_COUNT, LaneIndex};

use super::{
    barriers::{Gaps, Sight, TrueBarriers},
    distributions::JerkMeter,
    motion::Plant,
};
use crate::truth::{Lanes, TrueVehicle};

/// One CAV from step to step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CavState {
    /// Lanes that it is in, enters or leaves.
    pub claimed: Option<Lanes>,
    pub changing: bool,
    pub plant: Plant,
    pub jerk: JerkMeter,
    has_looked: bool,
    /// By lane; empty for those that it is not in.
    sight: [LaneSight; LANE_COUNT as usize],
    pub barriers: Option<TrueBarriers>,
    pub min_headway_m: Option<f64>,
}

/// A CAV's free sight in one lane from step to step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LaneSight {
    clear_s_m: Option<f64>,
    held: bool,
    /// The sight barrier is negative since the sight itself broke off.
    broke_off: bool,
}

impl LaneSight {
    /// Takes in a step: free up to road s `clear_s_m`. Without a step before, what it is now is
    /// the start's doing, if this is the `start`.
    fn step(&mut self, clear_s_m: f64, barrier: Sight, start: bool) {
        let breaks_off = match self.clear_s_m {
            Some(before_m) => clear_s_m < before_m && self.held,
            None => start,
        };
        self.broke_off = barrier.h_promised_m < 0.0 && (self.broke_off || breaks_off);
        self.clear_s_m = Some(clear_s_m);
        self.held = barrier.h_m >= 0.0;
    }
}

impl CavState {
    pub fn watch_sight(&mut self, sight: Option<&SightLine>, gaps: &Gaps<'_>, lanes: Lanes) {
        let Some(sight) = sight else { return };
        let start = !std::mem::replace(&mut self.has_looked, true);
        for lane in LaneIndex::all() {
            let before = &mut self.sight[usize::from(lane.get())];
            if lanes.contains(lane) {
                let clear_s_m = sight.clear_s_m(lane);
                before.step(clear_s_m, gaps.sight(lane, clear_s_m), start);
            } else {
                *before = LaneSight::default();
            }
        }
    }

    /// Whether its sight in one of `lanes` broke off.
    pub fn sight_broke_off(&self, lanes: Lanes) -> bool {
        self.sight_in(lanes).any(|sight| sight.broke_off)
    }

    /// Whether its sight in one of `lanes` reaches past the rear of `other`: over a vehicle that
    /// hides it.
    pub fn sight_reaches_past(&self, other: &TrueVehicle, lanes: Lanes) -> bool {
        let past = |clear_s_m| clear_s_m > other.s_range_m[0];
        self.sight_in(lanes)
            .any(|sight| sight.clear_s_m.is_none_or(past))
    }

    fn sight_in(&self, lanes: Lanes) -> impl Iterator<Item = &LaneSight> {
        lanes
            .iter()
            .map(|lane| &self.sight[usize::from(lane.get())])
    }
}
