use std::collections::BTreeMap;

use covista_traffic::VehicleId;

use super::{Cause, Distributions, Monitor, TrueBarriers};

impl Monitor {
    /// The true barriers of `cav` against the worst vehicle ahead in its lanes, if there is one.
    pub fn barriers_of(&self, cav: VehicleId) -> Option<&TrueBarriers> {
        self.cavs.get(&cav)?.barriers.as_ref()
    }

    /// Smallest headway of `cav` so far, in metres.
    pub fn min_headway_m(&self, cav: VehicleId) -> Option<f64> {
        self.cavs.get(&cav)?.min_headway_m
    }

    /// CAVs and humans that were stuck at some time.
    pub fn stuck(&self) -> usize {
        self.vehicles.values().filter(|motion| motion.stuck).count()
    }

    /// Times that h_0 of a CAV became negative.
    pub fn collision_set_left(&self) -> usize {
        self.collision_set_left
    }

    /// Lane changes that began inside the collision set of the truth.
    pub fn unsafe_actions(&self) -> usize {
        self.unsafe_actions
    }

    /// Pairs of bodies that overlapped at some time.
    pub fn collisions(&self) -> usize {
        self.collisions.len()
    }

    /// Violations by cause.
    pub fn violations(&self) -> &BTreeMap<Cause, usize> {
        &self.violations
    }

    /// Gaps to followers that were lost after a lane change, by cause. They are not promised.
    pub fn rear_losses(&self) -> &BTreeMap<Cause, usize> {
        &self.rear_losses
    }

    /// Steps of CAVs on which the worst h was negative, by the cause that it had.
    pub fn steps_violated(&self) -> impl Iterator<Item = (Cause, usize)> {
        Cause::ALL
            .into_iter()
            .zip(self.steps_violated)
            .filter(|(_, steps)| *steps > 0)
    }

    /// Steps of 0.01 s, summed over CAVs.
    pub fn cav_steps(&self) -> usize {
        self.cav_steps
    }

    /// How near CAVs came in time, and how roughly they drove.
    pub fn distributions(&self) -> &Distributions {
        &self.distributions
    }
}
