use std::path::Path;

use covista_planner::Reward;
use covista_planner::learning::{
    Hyperparameters, Objective, RoundReport, Sharing, Trainer, TrainingSettings,
};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{Behaviour, ExperimentError, LearningCurve, TrainingCase, plan::STEPS};
use crate::{ControlMode, RingEnvironment, RingEnvironmentSettings, TrainingConfig};

/// The reward that policies are trained with: a lane change must pay before it is over, and no speed
/// makes up for an emergency stop.
pub(super) fn reward() -> Reward {
    Reward {
        speed_weight: 0.7,
        emergency_stop_penalty: 30.0,
        ..Reward::default()
    }
}

/// How the policy of `behaviour` is trained where nothing else is said, as the shipped ones were,
/// with episodes of `steps` behaviour steps if that is given; `None` where nothing is learnt.
///
/// Those who choose behaviours differ in the algorithm and in who has messages and the filter; the
/// monitor looks on where a promise is to be kept. Who steers has settings for its shorter step.
pub fn training_of(behaviour: Behaviour, steps: Option<u64>, seed: u64) -> Option<TrainingConfig> {
    let algorithm = behaviour.algorithm()?;
    let mut environment = RingEnvironmentSettings {
        sharing: behaviour.shares(),
        watched: behaviour == Behaviour::Ours,
        reward: reward(),
        ..RingEnvironmentSettings::default()
    };
    environment.steps = steps.unwrap_or(STEPS);
    if !behaviour.is_filtered() {
        environment.control.mode = ControlMode::Off;
    }
    let mut environments = 2;
    if behaviour.may_leave_the_road() {
        // The first to leave it ends the episode of all.
        (environments, environment.ring.cavs) = (4, 6);
    }
    Some(TrainingConfig {
        environments,
        environment,
        training: TrainingSettings {
            algorithm,
            sharing: Sharing::Shared,
            // Who hears nobody knows of no other reward.
            objective: if algorithm.steers() || !behaviour.shares() {
                Objective::Own
            } else {
                Objective::Neighbourhood
            },
            hyperparameters: if algorithm.steers() {
                steering()
            } else {
                behaving()
            },
            seed,
        },
    })
}

/// Of those who choose behaviours.
fn behaving() -> Hyperparameters {
    Hyperparameters {
        discount: 0.99,
        reward_center: 13.3,
        reward_scale: 0.2,
        first_exploration: 0.3,
        exploration_steps: 8,
        exploration_decisions: 12_000,
        entropy_weight: 0.15,
        ..Hyperparameters::default()
    }
}

/// Of those who choose control inputs, five times as often: a step earns a fifth, noise lasts for
/// 0.3 s, which brings nobody into the next lane.
fn steering() -> Hyperparameters {
    Hyperparameters {
        discount: 0.98,
        reward_center: 2.0,
        reward_scale: 0.2,
        first_exploration: 0.15,
        exploration_steps: 3,
        exploration_decisions: 20_000,
        entropy_weight: 0.0,
        ..Hyperparameters::default()
    }
}

/// Trains anew in whole rounds until every learner has made so many decisions, and tells of each
/// round.
///
/// # Errors
/// When a setting makes no sense or a network diverges.
pub fn train(
    config: &TrainingConfig,
    decisions: u64,
    each: &mut dyn FnMut(&Trainer<RingEnvironment>, &RoundReport),
) -> Result<Trainer<RingEnvironment>, ExperimentError> {
    let mut trainer = config.start(None)?;
    while trainer.decisions() < decisions {
        let report = trainer.train_round()?;
        each(&trainer, &report);
    }
    Ok(trainer)
}

pub(super) fn drive(case: &TrainingCase) -> Result<LearningCurve, ExperimentError> {
    let mut curve = LearningCurve::default();
    train(&case.config, case.decisions, &mut |trainer, report| {
        let episodes = &report.episodes;
        let reward: f64 = episodes.iter().map(|episode| episode.reward).sum();
        curve.reward.push(reward / episodes.len().max(1) as f64);
        let unsafe_actions = episodes.iter().map(|episode| episode.unsafe_actions);
        curve.unsafe_actions.push(unsafe_actions.sum());
        let loops = trainer.environments().iter();
        let unattributed = loops.map(|of| Some(of.safety()?.violations_unattributed));
        curve.unattributed.push(unattributed.sum());
    })?;
    Ok(curve)
}

/// What a folder of `covista train` holds: its settings and its learning curve.
///
/// # Errors
/// When a file is missing or is not what `covista train` writes.
pub fn read_training(folder: &Path) -> Result<(TrainingCase, LearningCurve), ExperimentError> {
    let settings_file = folder.join("settings.json");
    let wrong = |path: &Path, problem: String| ExperimentError::Training {
        path: path.to_owned(),
        problem,
    };
    let text = |path: &Path| {
        std::fs::read_to_string(path)
            .map_err(|error| wrong(path, format!("cannot be read ({error})")))
    };
    let in_settings = |problem: String| wrong(&settings_file, problem);
    let settings: Value = serde_json::from_str(&text(&settings_file)?)
        .map_err(|error| in_settings(format!("is no JSON ({error})")))?;
    let rounds: u64 = field(&settings, "rounds").map_err(in_settings)?;
    let decisions: u64 = field(&settings, "decisions").map_err(in_settings)?;
    let made: u64 = field(&settings, "decisions_made").map_err(in_settings)?;
    if made < decisions {
        return Err(in_settings(format!(
            "has {made} of {decisions} decisions; go on with --resume"
        )));
    }
    let config = TrainingConfig {
        environments: field(&settings, "environments").map_err(in_settings)?,
        environment: field(&settings, "environment").map_err(in_settings)?,
        training: field(&settings, "training").map_err(in_settings)?,
    };
    let curve_file = folder.join("curve.csv");
    let curve =
        parse_curve(&text(&curve_file)?, rounds).map_err(|problem| wrong(&curve_file, problem))?;
    Ok((TrainingCase { config, decisions }, curve))
}

fn field<T: DeserializeOwned>(settings: &Value, name: &str) -> Result<T, String> {
    let value = settings
        .get(name)
        .ok_or_else(|| format!("has no field {name}"))?;
    serde_json::from_value(value.clone())
        .map_err(|error| format!("has a {name} that is none ({error})"))
}

fn parse_curve(text: &str, rounds: u64) -> Result<LearningCurve, String> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let column = |name: &str| {
        let place = header.iter().position(|column| *column == name);
        place.ok_or_else(|| format!("has no column {name}"))
    };
    let (rewards, unsafe_actions) = (column("reward")?, column("unsafe_actions")?);
    let unattributed = column("violations_unattributed")?;
    let mut curve = LearningCurve::default();
    for (number, line) in lines.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        let reward = cells.get(rewards).and_then(|cell| cell.parse::<f64>().ok());
        let counted = cells.get(unsafe_actions).and_then(|cell| cell.parse().ok());
        let (Some(reward), Some(counted)) = (reward.filter(|reward| reward.is_finite()), counted)
        else {
            return Err(format!(
                "line {} has no reward or no count of unsafe actions",
                number + 2
            ));
        };
        curve.reward.push(reward);
        curve.unsafe_actions.push(counted);
        let seen = cells.get(unattributed).and_then(|cell| cell.parse().ok());
        curve.unattributed.push(seen);
    }
    if curve.reward.len() as u64 != rounds {
        let found = curve.reward.len();
        return Err(format!("has {found} rounds, settings.json says {rounds}"));
    }
    Ok(curve)
}

#[cfg(test)]
mod tests {
    use covista_planner::learning::LearnedPolicy;

    use super::*;
    use crate::policy_file;

    const LEARNT: [Behaviour; 6] = [
        Behaviour::Ours,
        Behaviour::Unshared,
        Behaviour::MaddpgMapped,
        Behaviour::Maddpg,
        Behaviour::EndToEnd,
        Behaviour::EndToEndUnfiltered,
    ];

    #[test]
    fn the_configurations_beside_the_training_scripts_are_these() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/training/policies");
        for behaviour in LEARNT {
            let name = behaviour.name();
            let read = TrainingConfig::load(&folder.join(format!("{name}.toml"))).expect("read");
            assert_eq!(training_of(behaviour, None, 1), Some(read), "{name}");
        }
    }

    #[test]
    fn the_shipped_policies_were_trained_so() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models");
        for behaviour in LEARNT {
            let path = policy_file(&folder, behaviour);
            let policy = LearnedPolicy::load(&path, 0, None).expect("read");
            let config = training_of(behaviour, None, 1).expect("learnt");
            assert_eq!(*policy.settings(), config.training, "{}", path.display());
            let loops = RingEnvironment::new(config.environment).expect("a loop");
            let environment: RingEnvironmentSettings =
                serde_json::from_value(policy.environment().clone()).expect("settings");
            assert_eq!(environment, *loops.settings(), "{}", path.display());
        }
    }

    #[test]
    fn a_learning_curve_is_read_by_the_names_of_its_columns() {
        let text = "violations_unattributed,unsafe_actions,reward\n,7,-2.5\n3,0,31.25\n";
        let curve = parse_curve(text, 2).expect("a curve");
        assert_eq!(
            (curve.reward, curve.unsafe_actions, curve.unattributed),
            (vec![-2.5, 31.25], vec![7, 0], vec![None, Some(3)])
        );
        let header = "reward,unsafe_actions,violations_unattributed";
        for (bad, rounds, part) in [
            ("round,reward\n1,2\n", 1, "unsafe_actions"),
            (&format!("{header}\n1,2,0\nNaN,3,0\n"), 2, "line 3"),
            (&format!("{header}\n1\n"), 1, "line 2"),
            (
                &format!("{header}\n1,2,0\n"),
                4,
                "1 rounds, settings.json says 4",
            ),
            ("", 0, "reward"),
        ] {
            let problem = parse_curve(bad, rounds).expect_err("refused");
            assert!(problem.contains(part), "{problem}");
        }
    }
}
