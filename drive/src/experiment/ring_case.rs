use covista_planner::learning::{Environment, InputShares, Outcome, Situations};

use super::{
    Behaviour, ExperimentError, Headways, LoopCase, LoopFigures, Means, Policies,
    behaviour::Decider, human_ring,
};
use crate::RingEnvironment;

/// An episode of the case.
pub(super) fn drive(case: &LoopCase, means: &Means) -> Result<LoopFigures, ExperimentError> {
    let (settings, policies) = (case.environment, &means.policies);
    if settings.ring.cavs == 0 {
        return human_ring::drive(case);
    }
    let mut environment = RingEnvironment::with_networks(settings, means.networks.as_ref())?;
    let shape = environment.shape();
    let mut decider = match case.behaviour {
        Behaviour::Ours | Behaviour::Unshared | Behaviour::MaddpgMapped | Behaviour::Maddpg => {
            let policy = policies.get(case.behaviour, shape)?;
            let explores = case.explores.then_some(settings.ring.seed);
            Decider::learned(policy, case.behaviour.is_filtered(), explores)
        }
        Behaviour::EndToEnd | Behaviour::EndToEndUnfiltered => {
            return drive_end_to_end(case, environment, policies);
        }
        Behaviour::RandomSafe => Decider::random(settings.ring.seed),
        Behaviour::KeepLane | Behaviour::Idm => Decider::KeepLane,
    };
    let mut headways = case.keeps_headways.then(Headways::default);
    let (mut situations, mut outcome) = (Situations::new(shape), Outcome::new(shape.agents));
    let mut actions = Vec::with_capacity(shape.agents);
    environment.reset(settings.ring.seed, &mut situations)?;
    if case.keeps_motion {
        environment.record_motion();
    }
    while !outcome.is_over {
        actions.clear();
        actions
            .extend((0..shape.agents).map(|agent| decider.decide(agent, &situations.get(agent))));
        outcome.clear();
        situations.clear();
        environment.step(&actions, &mut outcome, &mut situations)?;
        if let Some(headways) = &mut headways {
            headways.note(environment.ring());
        }
    }
    Ok(figures(&environment, headways))
}

/// An episode of CAVs that choose control inputs.
fn drive_end_to_end(
    case: &LoopCase,
    mut environment: RingEnvironment,
    policies: &Policies,
) -> Result<LoopFigures, ExperimentError> {
    let shape = environment.shape();
    let mut policy = policies.get(case.behaviour, shape)?;
    let mut headways = case.keeps_headways.then(Headways::default);
    let (mut situations, mut outcome) = (Situations::new(shape), Outcome::new(shape.agents));
    let mut inputs: Vec<InputShares> = Vec::with_capacity(shape.agents);
    environment.reset(case.environment.ring.seed, &mut situations)?;
    if case.keeps_motion {
        environment.record_motion();
    }
    while !outcome.is_over {
        inputs.clear();
        for agent in 0..shape.agents {
            let input = policy.input(&situations.get(agent));
            inputs.push(input.ok_or(ExperimentError::NotLoaded(case.behaviour.name()))?);
        }
        outcome.clear();
        situations.clear();
        environment.steer(&inputs, &mut outcome, &mut situations)?;
        if let Some(headways) = &mut headways {
            headways.note(environment.ring());
        }
    }
    Ok(figures(&environment, headways))
}

fn figures(environment: &RingEnvironment, headways: Option<Headways>) -> LoopFigures {
    let (tally, safety) = (environment.tally(), environment.safety());
    LoopFigures {
        motion: environment.motion(),
        ..LoopFigures::new(environment.ring(), tally, safety, headways)
    }
}
