use covista_planner::learning::{
    ActionSet, Algorithm, Exploration, LearnedPolicy, Situation, any_of, mapped_best, mixed,
};
use covista_world::Action;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::environment::{BEHAVIOUR_STEPS, STEERING_STEPS};

/// Keeps the draws of [`Behaviour::RandomSafe`] apart from those of the traffic of the same seed.
const DRAWS: u64 = 0x7A4D;

/// Who decides for the CAVs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Behaviour {
    /// The safe actor-critic of Alg. 2, as it was trained.
    Ours,
    /// The same, trained and driving without messages: each CAV knows what it sees itself.
    Unshared,
    /// The baseline: MADDPG with the safe action mapping.
    MaddpgMapped,
    /// MADDPG alone: its best legal action, and no safety filter.
    Maddpg,
    /// Keep lane where that is safe, else the emergency stop: what the filter does alone.
    KeepLane,
    /// Any safe action, each as likely.
    RandomSafe,
    /// The end-to-end variant: control inputs in place of behaviours, through the same filter.
    EndToEnd,
    /// The same without the filter, as in the paper: it has the whole road.
    EndToEndUnfiltered,
    /// Nobody: all vehicles are human drivers by IDM and gap acceptance.
    Idm,
}

impl Behaviour {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::Unshared => "unshared",
            Self::MaddpgMapped => "maddpg-mapped",
            Self::Maddpg => "maddpg",
            Self::KeepLane => "keep-lane",
            Self::RandomSafe => "random-safe",
            Self::EndToEnd => "end-to-end",
            Self::EndToEndUnfiltered => "end-to-end-unfiltered",
            Self::Idm => "idm",
        }
    }

    /// What it is trained with, where it is learnt.
    pub fn algorithm(self) -> Option<Algorithm> {
        match self {
            Self::Ours | Self::Unshared => Some(Algorithm::SafeActorCritic),
            Self::MaddpgMapped => Some(Algorithm::MaddpgMapped),
            Self::Maddpg => Some(Algorithm::Maddpg),
            Self::EndToEnd | Self::EndToEndUnfiltered => Some(Algorithm::EndToEnd),
            Self::KeepLane | Self::RandomSafe | Self::Idm => None,
        }
    }

    /// What `algorithm` learns with sharing.
    pub fn of(algorithm: Algorithm) -> Self {
        match algorithm {
            Algorithm::SafeActorCritic => Self::Ours,
            Algorithm::MaddpgMapped => Self::MaddpgMapped,
            Algorithm::Maddpg => Self::Maddpg,
            Algorithm::EndToEnd => Self::EndToEnd,
        }
    }

    /// Its decisions in the time of so many behaviours.
    pub fn decisions_as_long_as(self, behaviours: u64) -> u64 {
        if self.algorithm().is_some_and(Algorithm::steers) {
            behaviours.saturating_mul(BEHAVIOUR_STEPS / STEERING_STEPS)
        } else {
            behaviours
        }
    }

    /// Whether the safety filter acts on it.
    pub fn is_filtered(self) -> bool {
        !matches!(self, Self::Maddpg | Self::EndToEndUnfiltered)
    }

    /// Whether an episode on the loop ends where one of its CAVs leaves the road or touches another.
    pub(super) fn may_leave_the_road(self) -> bool {
        self == Self::EndToEndUnfiltered
    }

    /// Whether its CAVs tell each other what they see and do.
    pub fn shares(self) -> bool {
        self != Self::Unshared
    }
}

/// A behaviour at work, the same for all CAVs of a loop.
pub(super) enum Decider {
    /// The best action of an actor, of the safe ones or of the legal ones.
    Learned {
        policy: Box<LearnedPolicy>,
        is_mapped: bool,
        exploring: Option<Box<(Exploration, ChaCha8Rng)>>,
    },
    KeepLane,
    Random(Box<ChaCha8Rng>),
}

/// Random numbers of those who decide, apart from those of the traffic of the same seed.
fn draws(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(mixed(seed, DRAWS))
}

impl Decider {
    /// Draws at random as `seed` has it.
    pub fn random(seed: u64) -> Self {
        Self::Random(Box::new(draws(seed)))
    }

    /// By a policy; with a seed it explores as in the last episodes of its training.
    pub fn learned(policy: LearnedPolicy, is_mapped: bool, explores: Option<u64>) -> Self {
        let exploration = Exploration::last(&policy.settings().hyperparameters);
        Self::Learned {
            policy: Box::new(policy),
            is_mapped,
            exploring: explores.map(|seed| Box::new((exploration, draws(seed)))),
        }
    }

    pub fn decide(&mut self, agent: usize, situation: &Situation<'_>) -> Action {
        let safe = situation.options.safe;
        match self {
            Self::Learned {
                policy,
                is_mapped,
                exploring,
            } => {
                let among = if *is_mapped {
                    safe
                } else {
                    situation.options.legal
                };
                let best = mapped_best(&policy.logits(situation), among);
                match exploring.as_deref_mut() {
                    Some((exploration, draws)) => exploration.choose(agent, best, among, draws),
                    None => best,
                }
            }
            Self::KeepLane => {
                mapped_best(&[0.0; 3], safe.and(ActionSet::EMPTY.with(Action::KeepLane)))
            }
            Self::Random(rng) => any_of(safe, &mut **rng),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_planner::learning::Options;

    fn decide(decider: &mut Decider, safe: &[Action]) -> Action {
        let situation = Situation {
            own: &[],
            neighbours: &[],
            agents: &[],
            options: Options {
                legal: ActionSet::ALL,
                safe: safe.iter().copied().collect(),
            },
        };
        decider.decide(0, &situation)
    }

    #[test]
    fn keeping_the_lane_never_changes_it_and_stops_where_it_must() {
        use Action::{ChangeLeft, ChangeRight, EmergencyStop, KeepLane};
        let mut keep = Decider::KeepLane;
        assert_eq!(decide(&mut keep, &[KeepLane, ChangeLeft]), KeepLane);
        assert_eq!(decide(&mut keep, &[ChangeLeft, ChangeRight]), EmergencyStop);
    }

    #[test]
    fn draws_are_safe_alike_for_a_seed_and_of_every_kind() {
        use Action::{ChangeLeft, EmergencyStop, KeepLane};
        let draw = |seed| {
            let mut random = Decider::random(seed);
            let draws = (0..200).map(move |_| decide(&mut random, &[KeepLane, ChangeLeft]));
            draws.collect::<Vec<_>>()
        };
        let drawn = draw(9000);
        assert_eq!(drawn, draw(9000));
        assert_ne!(drawn, draw(9001));
        let kept = drawn.iter().filter(|action| **action == KeepLane).count();
        let left = drawn.iter().filter(|action| **action == ChangeLeft).count();
        assert!(
            kept + left == 200 && (70..=130).contains(&kept),
            "{kept} {left}"
        );
        assert_eq!(decide(&mut Decider::random(1), &[]), EmergencyStop);
    }
}
