use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use covista_planner::learning::{LearnedPolicy, Shape, Sharing};
use sha2::{Digest, Sha256};

use super::{Behaviour, ExperimentError};

/// The file of a learned behaviour in a folder of policies.
pub fn policy_file(folder: &Path, behaviour: Behaviour) -> PathBuf {
    folder.join(format!("policy-{}.safetensors", behaviour.name()))
}

/// The trained policies of an experiment.
#[derive(Default)]
pub struct Policies(BTreeMap<Behaviour, Trained>);

struct Trained {
    path: PathBuf,
    sha256: String,
    policy: LearnedPolicy,
}

impl Policies {
    /// Reads those of `behaviours` that are learnt from `folder`.
    ///
    /// # Errors
    /// When a file is missing or damaged, or holds another algorithm or a policy for each CAV.
    pub fn load(folder: &Path, behaviours: &[Behaviour]) -> Result<Self, ExperimentError> {
        let mut policies = BTreeMap::new();
        for &behaviour in behaviours {
            let Some(algorithm) = behaviour.algorithm() else {
                continue;
            };
            let path = policy_file(folder, behaviour);
            let bytes = std::fs::read(&path).map_err(|source| ExperimentError::Policy {
                path: path.clone(),
                source,
            })?;
            let policy = LearnedPolicy::load(&path, 0, None)?;
            let unfit = |problem: String| ExperimentError::Unfit {
                path: path.clone(),
                problem,
            };
            let trained = policy.settings();
            if trained.algorithm != algorithm {
                let found = Behaviour::of(trained.algorithm).name();
                return Err(unfit(format!(
                    "is one of {found}, not of {}",
                    behaviour.name()
                )));
            }
            let shared = policy.environment()["sharing"].as_bool();
            if shared.is_some_and(|shared| shared != behaviour.shares()) {
                let how = if behaviour.shares() {
                    "without"
                } else {
                    "with"
                };
                return Err(unfit(format!(
                    "was trained {how} messages, {} is not",
                    behaviour.name()
                )));
            }
            let mode = policy.environment()["control"]["mode"].as_str();
            if mode.is_some_and(|mode| (mode == "off") == behaviour.is_filtered()) {
                let how = if behaviour.is_filtered() {
                    "without"
                } else {
                    "with"
                };
                return Err(unfit(format!(
                    "was trained {how} the safety filter, {} is not",
                    behaviour.name()
                )));
            }
            if trained.sharing != Sharing::Shared {
                return Err(unfit("has networks for each CAV, not one for all".into()));
            }
            let sha256 = Sha256::digest(&bytes)
                .iter()
                .map(|byte| format!("{byte:02x}"))
                .collect();
            let trained = Trained {
                path,
                sha256,
                policy,
            };
            policies.insert(behaviour, trained);
        }
        Ok(Self(policies))
    }

    /// SHA-256 of each file.
    pub fn hashes(&self) -> BTreeMap<Behaviour, String> {
        let hash =
            |(&behaviour, trained): (&Behaviour, &Trained)| (behaviour, trained.sha256.clone());
        self.0.iter().map(hash).collect()
    }

    /// The policy of `behaviour` for a loop that writes situations of `shape`.
    pub(super) fn get(
        &self,
        behaviour: Behaviour,
        shape: Shape,
    ) -> Result<LearnedPolicy, ExperimentError> {
        let missing = ExperimentError::NotLoaded(behaviour.name());
        let trained = self.0.get(&behaviour).ok_or(missing)?;
        let of_one = |shape: Shape| (shape.own, shape.neighbours, shape.neighbour);
        let (found, needed) = (of_one(trained.policy.shape()), of_one(shape));
        if found != needed {
            return Err(ExperimentError::Unfit {
                path: trained.path.clone(),
                problem: format!(
                    "was trained on {} own features and {} neighbours of {}, the loop has {} and {} of {}",
                    found.0, found.1, found.2, needed.0, needed.1, needed.2
                ),
            });
        }
        Ok(trained.policy.clone())
    }

    /// Checks that every policy fits situations of `shape`.
    ///
    /// # Errors
    /// The first that does not.
    pub fn check(&self, shape: Shape) -> Result<(), ExperimentError> {
        self.0
            .keys()
            .try_for_each(|&behaviour| self.get(behaviour, shape).map(drop))
    }
}
