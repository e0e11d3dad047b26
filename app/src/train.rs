//! `covista train`: the safe actor-critic and its baselines on the three-lane ring.

mod curve;

use std::{collections::BTreeMap, path::Path, time::Instant};

use anyhow::{Context, bail};
use covista_drive::{RingEnvironment, RingPerception, Trainer, TrainingConfig};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};

use crate::{
    cli::{ProviderArg, TrainArgs},
    frames::{network_hashes, networks},
    output::{prepare_folder, say, write_json},
};
use curve::{Curve, CurveRow};

/// Rounds between two checkpoints.
const CHECKPOINT_ROUNDS: u64 = 5;
/// The episode after the training has a seed that no round has.
const UNSEEN: u64 = 0xE7A1;

/// `covista train`.
pub fn run(args: &TrainArgs) -> anyhow::Result<()> {
    let config = match &args.config {
        Some(path) => TrainingConfig::load(path)?,
        None => TrainingConfig::default(),
    };
    let models = args.models.as_deref();
    let (networks, hashes) = match config.environment.perception {
        RingPerception::Network => {
            let networks = networks(models, usize::MAX, ProviderArg::default())?;
            (Some(networks), network_hashes(models)?)
        }
        RingPerception::Exact | RingPerception::Statistical => {
            if models.is_some() {
                bail!("--models is for environment.perception = \"network\" in --config");
            }
            (None, BTreeMap::new())
        }
    };
    let settings = settings_of(&config, &hashes);
    let checkpoint = args.out.join("checkpoint.safetensors");
    let goes_on = args.resume && checkpoint.exists();
    let (mut trainer, mut curve) = if goes_on {
        check_settings(&settings, &args.out)?;
        let trainer = config.resume(&checkpoint, networks.as_ref())?;
        let curve = Curve::load(&args.out, trainer.rounds())?;
        (trainer, curve)
    } else {
        (config.start(networks.as_ref())?, Curve::default())
    };
    prepare_folder(&args.out)?;
    let decisions = args.decisions.get();
    let bar = ProgressBar::new(decisions).with_position(trainer.decisions());
    if let Ok(style) =
        ProgressStyle::with_template("[{bar:30}] {pos}/{len} decisions, {msg}, {eta} left")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message("first round");
    bar.tick();
    while trainer.decisions() < decisions {
        let start = Instant::now();
        let report = match trainer.train_round() {
            Ok(report) => report,
            Err(error) => {
                let failed = args.out.join("failed.safetensors");
                trainer.save(&failed)?;
                let place = failed.display().to_string();
                return Err(error).with_context(|| format!("stopped; the state is in {place}"));
            }
        };
        let row = CurveRow::new(trainer.rounds(), &report, trainer.environments());
        let steps: u64 = report.episodes.iter().map(|episode| episode.steps).sum();
        bar.set_message(format!(
            "reward {:.1}, {:.0} steps/s, {} unsafe actions",
            row.reward,
            steps as f64 / start.elapsed().as_secs_f64(),
            row.unsafe_actions
        ));
        curve.push(row);
        bar.set_position(trainer.decisions().min(decisions));
        if trainer.rounds() % CHECKPOINT_ROUNDS == 0 || trainer.decisions() >= decisions {
            keep(&trainer, settings.clone(), args, &curve)?;
        }
    }
    bar.finish_and_clear();
    let report = trainer.evaluate(config.training.seed ^ UNSEEN)?;
    let row = CurveRow::new(trainer.rounds(), &report, trainer.environments());
    let rounds = match trainer.rounds() {
        1 => "1 round".to_owned(),
        rounds => format!("{rounds} rounds"),
    };
    let learnt = match trainer.updates() {
        0 => format!(
            " without an update, which takes {} transitions (warm_up)",
            config.training.hyperparameters.warm_up
        ),
        updates => format!(", {updates} updates"),
    };
    say(&format!(
        "trained {rounds}{learnt}; without exploration, in another episode: reward {:.1} a CAV, {:.2} m/s, comfort {:.3}, {} unsafe actions, {} emergency stops, {} lane changes\nwritten to {}",
        row.reward,
        row.mean_velocity_mps,
        row.comfort,
        row.unsafe_actions,
        row.emergency_stops,
        row.lane_changes,
        args.out.display()
    ))
}

/// Writes all that is needed to go on, to drive and to look at.
fn keep(
    trainer: &Trainer<RingEnvironment>,
    mut settings: Value,
    args: &TrainArgs,
    curve: &Curve,
) -> anyhow::Result<()> {
    trainer.save(&args.out.join("checkpoint.safetensors"))?;
    trainer.save_policy(&args.out.join("policy.safetensors"))?;
    curve.save(&args.out)?;
    settings["command"] = "train".into();
    settings["version"] = env!("CARGO_PKG_VERSION").into();
    settings["rounds"] = trainer.rounds().into();
    settings["decisions"] = args.decisions.get().into();
    settings["decisions_made"] = trainer.decisions().into();
    write_json(&args.out.join("settings.json"), &settings)
}

/// What a training depends on, with the SHA-256 of its `networks` by their ids where it has any.
fn settings_of(config: &TrainingConfig, networks: &BTreeMap<String, String>) -> Value {
    let mut settings = json!({
        "environments": config.environments,
        "environment": config.environment,
        "training": config.training,
    });
    if !networks.is_empty() {
        settings["networks"] = json!(networks);
    }
    settings
}

/// Refuses to go on with other settings than the training in `folder` began with.
fn check_settings(settings: &Value, folder: &Path) -> anyhow::Result<()> {
    let file = folder.join("settings.json");
    let place = file.display();
    let text = std::fs::read_to_string(&file)
        .with_context(|| format!("cannot read {place}; leave out --resume to begin anew"))?;
    let began: Value = serde_json::from_str(&text)
        .with_context(|| format!("{place} is no JSON; leave out --resume to begin anew"))?;
    // By way of text, as those came: numbers may lose their last bit in it.
    let asked: Value = serde_json::from_str(&settings.to_string())?;
    let parts = ["environments", "environment", "training", "networks"];
    let mut differ = parts
        .iter()
        .map(|part| difference(&began[part], &asked[part], part));
    match differ.find_map(|field| field) {
        Some(field) => bail!(
            "the training of {place} has another {field} than --config and --models; give the same, or leave out --resume to begin anew"
        ),
        None => Ok(()),
    }
}

/// The first field in which two settings differ.
fn difference(one: &Value, other: &Value, path: &str) -> Option<String> {
    let (Value::Object(fields), Value::Object(others)) = (one, other) else {
        return (one != other).then(|| path.to_owned());
    };
    let mut keys = fields.keys().chain(others.keys());
    keys.find_map(|key| difference(&one[key], &other[key], &format!("{path}.{key}")))
}
