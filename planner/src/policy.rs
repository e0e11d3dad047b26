use crate::{ActionValues, Observation};

/// A behaviour policy, hand-written or learned.
pub trait Policy {
    /// The value of each action in this situation; only their order counts.
    fn values(&mut self, observation: &Observation) -> ActionValues;
}
