use covista_planner::learning::{Environment, Outcome, Situations};

use super::{
    Behaviour, ExperimentError, Headways, LoopCase, LoopFigures, Policies, behaviour::Decider,
    human_ring,
};
use crate::RingEnvironment;

/// An episode of the case.
pub(super) fn drive(case: &LoopCase, policies: &Policies) -> Result<LoopFigures, ExperimentError> {
    let settings = case.environment;
    if settings.ring.cavs == 0 {
        return human_ring::drive(case);
    }
    let mut environment = RingEnvironment::new(settings)?;
    let shape = environment.shape();
    let mut decider = match case.behaviour {
        Behaviour::Ours | Behaviour::Unshared | Behaviour::MaddpgMapped | Behaviour::Maddpg => {
            Decider::Learned {
                policy: Box::new(policies.get(case.behaviour, shape)?),
                is_mapped: case.behaviour.is_filtered(),
            }
        }
        Behaviour::RandomSafe => Decider::random(settings.ring.seed),
        Behaviour::KeepLane | Behaviour::Idm => Decider::KeepLane,
    };
    let mut headways = case.keeps_headways.then(Headways::default);
    let (mut situations, mut outcome) = (Situations::new(shape), Outcome::new(shape.agents));
    let mut actions = Vec::with_capacity(shape.agents);
    environment.reset(settings.ring.seed, &mut situations)?;
    while !outcome.is_over {
        actions.clear();
        actions.extend((0..shape.agents).map(|agent| decider.decide(&situations.get(agent))));
        outcome.clear();
        situations.clear();
        environment.step(&actions, &mut outcome, &mut situations)?;
        if let Some(headways) = &mut headways {
            headways.note(environment.ring());
        }
    }
    let (ring, tally, safety) = (
        environment.ring(),
        environment.tally(),
        environment.safety(),
    );
    Ok(LoopFigures::new(ring, tally, safety, headways))
}
