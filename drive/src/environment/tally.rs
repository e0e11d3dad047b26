use covista_planner as planner;
use covista_traffic::{Ring, RingVehicle};
use covista_world::{Action, FilterOutcome};
use serde::{Deserialize, Serialize};

use super::{BEHAVIOUR_S, cav::RingCav};

/// What happened in an episode so far.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RingTally {
    /// Decisions of all CAVs.
    pub decisions: u64,
    /// Those that were not safe when they were taken.
    pub unsafe_actions: u64,
    /// Emergency stops: decisions where no action was safe.
    pub emergency_stops: u64,
    /// Lane changes that CAVs began, after announcing them.
    pub lane_changes: u64,
    /// Steps of all CAVs' controllers.
    pub control_steps: u64,
    /// Those in which the filter changed the nominal input.
    pub filtered_steps: u64,
    /// Those in which it braked because nothing else was left.
    pub backup_steps: u64,
    /// The paper's comfort of all CAVs' behaviour steps, and that of all vehicles', summed.
    pub cav_comfort: f64,
    /// The same of all vehicles; a human driver's action is the lane change he is about.
    pub comfort: f64,
    /// Behaviour steps of all vehicles.
    pub behaviour_steps: u64,
    /// Speeds of the CAVs at the ends of behaviour steps in m/s, summed.
    pub cav_speed_mps: f64,
    /// Rewards, summed over the CAVs.
    pub reward: f64,
}

impl RingTally {
    /// The comfort of all vehicles' behaviour steps; zero before the first.
    pub fn mean_comfort(&self) -> f64 {
        self.comfort / self.behaviour_steps.max(1) as f64
    }

    pub(super) fn decides(&mut self, cav: &RingCav, action: Action) {
        let is_allowed = cav.options.safe.contains(action) || action == Action::EmergencyStop;
        self.decisions += 1;
        self.unsafe_actions += u64::from(!is_allowed);
        self.emergency_stops += u64::from(action == Action::EmergencyStop);
    }

    pub(super) fn controls(&mut self, cav: &RingCav) {
        self.control_steps += 1;
        self.lane_changes += u64::from(cav.has_begun);
        self.filtered_steps += u64::from(cav.outcome != FilterOutcome::Nominal);
        self.backup_steps += u64::from(cav.outcome == FilterOutcome::Backup);
    }

    /// A behaviour step of everybody; `actions` are what the CAVs were about in it, `before_mps` the
    /// speeds at its beginning.
    pub(crate) fn ends(&mut self, ring: &Ring, actions: &[Action], before_mps: &[f64]) {
        for (index, vehicle) in ring.vehicles().iter().enumerate() {
            let own = actions.get(index).copied();
            let accel_mps2 = (vehicle.speed_mps - before_mps[index]) / BEHAVIOUR_S;
            let comfort =
                planner::comfort(accel_mps2, own.unwrap_or_else(|| human_action(vehicle)));
            self.comfort += comfort;
            self.behaviour_steps += 1;
            if own.is_some() {
                self.cav_comfort += comfort;
                self.cav_speed_mps += vehicle.speed_mps;
            }
        }
    }
}

/// What a human driver is about, in the words of the paper's actions.
fn human_action(vehicle: &RingVehicle) -> Action {
    // Which side it is makes no difference to comfort.
    vehicle
        .human_lane_change()
        .map_or(Action::KeepLane, |_| Action::ChangeLeft)
}
