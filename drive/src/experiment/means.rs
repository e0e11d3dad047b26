use covista_sensors::ErrorModel;
use rayon::prelude::*;

use super::{
    Case, ExperimentError, Figures, Policies, ring_case, scene_case, training_case, truncation_case,
};
use crate::Networks;

/// What cases are driven with.
#[derive(Default)]
pub struct Means {
    /// The trained policies.
    pub policies: Policies,
    /// The errors of statistical percepts.
    pub errors: Option<ErrorModel>,
    /// The networks of network percepts.
    pub networks: Option<Networks>,
}

impl Means {
    /// Drives one case from beginning to end; the same case gives the same figures.
    ///
    /// # Errors
    /// When a setting makes no sense or a policy does not fit.
    pub fn drive(&self, case: &Case) -> Result<Figures, ExperimentError> {
        Ok(match case {
            Case::Loop(case) => Figures::Loop(Box::new(ring_case::drive(case, self)?)),
            Case::Scene(case) => Figures::Scene(scene_case::drive(case, self)?),
            Case::Training(case) => Figures::Training(training_case::drive(case)?),
            Case::Truncation(case) => Figures::Truncation(truncation_case::drive(case)?),
        })
    }

    /// Drives `cases` on all threads and hands over what each came to as it is done.
    ///
    /// # Errors
    /// The first that arises; cases under way are finished and handed over.
    pub fn drive_all<E: From<ExperimentError> + Send>(
        &self,
        cases: &[Case],
        done: impl Fn(&Case, &Figures) -> Result<(), E> + Sync,
    ) -> Result<(), E> {
        cases
            .par_iter()
            .try_for_each(|case| done(case, &self.drive(case)?))
    }
}
