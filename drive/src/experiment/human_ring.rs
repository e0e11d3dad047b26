use covista_traffic::Ring;

use super::{ExperimentError, Headways, LoopCase, LoopFigures};
use crate::{
    RingTally,
    environment::{BEHAVIOUR_S, BEHAVIOUR_STEPS},
};

/// An episode of human drivers alone, counted as the others are.
pub(super) fn drive(case: &LoopCase) -> Result<LoopFigures, ExperimentError> {
    let settings = &case.environment;
    if settings.steps == 0 {
        return Err(ExperimentError::NoSteps);
    }
    let mut ring_settings = settings.ring;
    ring_settings.duration_s = settings.steps as f64 * BEHAVIOUR_S;
    let mut ring = Ring::new(ring_settings)?;
    let mut tally = RingTally::default();
    let mut headways = case.keeps_headways.then(Headways::default);
    let mut before_mps = Vec::new();
    for _ in 0..settings.steps {
        before_mps.clear();
        before_mps.extend(ring.vehicles().iter().map(|vehicle| vehicle.speed_mps));
        for _ in 0..BEHAVIOUR_STEPS {
            ring.step(&[])?;
        }
        tally.ends(&ring, &[], &before_mps);
        if let Some(headways) = &mut headways {
            headways.note(&ring);
        }
    }
    Ok(LoopFigures::new(&ring, tally, None, headways))
}
