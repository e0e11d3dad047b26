use covista_planner::learning::{
    ActionSet, Algorithm, LearnedPolicy, Situation, any_of, mapped_best, mixed,
};
use covista_world::Action;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

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
            Self::Idm => "idm",
        }
    }

    /// What it is trained with, where it is learnt.
    pub fn algorithm(self) -> Option<Algorithm> {
        match self {
            Self::Ours | Self::Unshared => Some(Algorithm::SafeActorCritic),
            Self::MaddpgMapped => Some(Algorithm::MaddpgMapped),
            Self::Maddpg => Some(Algorithm::Maddpg),
            Self::EndToEnd => Some(Algorithm::EndToEnd),
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

    /// Whether the safety filter acts on it.
    pub fn is_filtered(self) -> bool {
        self != Self::Maddpg
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
    },
    KeepLane,
    Random(Box<ChaCha8Rng>),
}

impl Decider {
    /// Draws at random as `seed` has it.
    pub fn random(seed: u64) -> Self {
        Self::Random(Box::new(ChaCha8Rng::seed_from_u64(mixed(seed, DRAWS))))
    }

    pub fn decide(&mut self, situation: &Situation<'_>) -> Action {
        let safe = situation.options.safe;
        match self {
            Self::Learned { policy, is_mapped } => {
                let among = if *is_mapped {
                    safe
                } else {
                    situation.options.legal
                };
                mapped_best(&policy.logits(situation), among)
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
        decider.decide(&Situation {
            own: &[],
            neighbours: &[],
            agents: &[],
            options: Options {
                legal: ActionSet::ALL,
                safe: safe.iter().copied().collect(),
            },
        })
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
