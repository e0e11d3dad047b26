//! `covista experiment`: the paper's experiments, case by case.

mod document;
mod store;

use std::{
    collections::BTreeMap,
    num::NonZeroU64,
    path::{Path, PathBuf},
};

use anyhow::{Context, bail};
use covista_drive::{
    Behaviour, Case, Experiment, ExperimentOptions, Figures, Means, Percepts, Plan, Policies,
    policy_file, read_training, train, training_of,
};
use covista_sensors::ErrorModel;
use indicatif::{ProgressBar, ProgressStyle};

pub use document::{Document, claims_table, pictures, table};
pub use store::Store;

use crate::{
    cli::{ExperimentArgs, PerceptionArg, ProviderArg, Shard},
    frames::{network_hashes, networks},
    output::{models_folder, prepare_file, prepare_folder, say, write_json},
};

/// The seed of a policy's training: none of the seeds that experiments are driven on.
const TRAINING_SEED: u64 = 1;
/// Decisions of each learner in the trainings of the shipped policies.
const DECISIONS: u64 = 12_000;

/// `covista experiment`.
pub fn run(args: &ExperimentArgs) -> anyhow::Result<()> {
    let experiment = args.name;
    check(args)?;
    prepare_folder(&args.out)?;
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let options = options(args);
    // Networks that cannot be used are told before anything is trained.
    let (networks, hashes) = match options.percepts {
        Percepts::Network => {
            let models = args.models.as_deref();
            let networks = networks(models, usize::MAX, ProviderArg::default())?;
            (Some(networks), network_hashes(models)?)
        }
        Percepts::Truth | Percepts::Statistical => (None, BTreeMap::new()),
    };
    let store = Store::new(&args.out, experiment);
    let (mut trainings, mut given) = (Vec::new(), Vec::new());
    for folder in &args.trained {
        let (training, curve) = read_training(folder)?;
        trainings.push(training.clone());
        given.push((Case::Training(training), Figures::Training(curve)));
    }
    let policies = policies(args, &options)?;
    let plan = Plan::new(experiment, options, &policies, hashes, trainings)?;
    let errors = match options.percepts {
        Percepts::Statistical => Some(ErrorModel::builtin()?),
        Percepts::Truth | Percepts::Network => None,
    };
    store.begin(&plan)?;
    for (case, figures) in &given {
        store.keep(&plan, case, figures)?;
    }
    let means = Means {
        policies,
        errors,
        networks,
    };
    drive(&plan, &store, args.shard, &means)?;
    conclude(&plan, &store, args)
}

/// Options that belong to another experiment are refused.
fn check(args: &ExperimentArgs) -> anyhow::Result<()> {
    let (name, learned) = (args.name.name(), args.name.learned());
    if args.perception != PerceptionArg::Truth && args.name == Experiment::Truncation {
        bail!("--perception is for what is driven; truncation is a game on paper");
    }
    if args.perception != PerceptionArg::Truth && args.name == Experiment::EpisodeReward {
        bail!(
            "--perception is for what is driven; for episode-reward set environment.perception in the TOML of `covista train` and give its folder with --trained"
        );
    }
    if args.models.is_some() && args.perception != PerceptionArg::Network {
        bail!("--models is for --perception network");
    }
    if !args.trained.is_empty() && args.name != Experiment::EpisodeReward {
        bail!("--trained is for episode-reward; {name} takes policies from --policies");
    }
    if args.episode.is_some() && args.name == Experiment::Truncation {
        bail!("--episode is for experiments that drive; {name} computes on all states at once");
    }
    let of_training = args.seeds.is_some() || args.episode.is_some() || args.decisions.is_some();
    if !args.trained.is_empty() && of_training {
        bail!(
            "--trained takes trainings as they are; leave out --seeds, --episode and --decisions"
        );
    }
    let trains = args.retrain || args.name == Experiment::EpisodeReward;
    if args.decisions.is_some() && !trains {
        bail!("--decisions is for --retrain and episode-reward");
    }
    if (args.retrain || args.policies.is_some()) && learned.is_empty() {
        bail!(
            "--policies and --retrain are for experiments with trained policies; {name} has none"
        );
    }
    Ok(())
}

fn options(args: &ExperimentArgs) -> ExperimentOptions {
    ExperimentOptions {
        seeds: args.seeds.unwrap_or_default(),
        steps: args.episode.map(|steps| steps.get().into()),
        percepts: match args.perception {
            PerceptionArg::Truth => Percepts::Truth,
            PerceptionArg::Statistical => Percepts::Statistical,
            PerceptionArg::Network => Percepts::Network,
        },
        decisions: args.decisions.map_or(DECISIONS, NonZeroU64::get),
    }
}

/// The trained policies that the experiment needs: those of a folder, or new ones.
fn policies(args: &ExperimentArgs, options: &ExperimentOptions) -> anyhow::Result<Policies> {
    let learned = args.name.learned();
    let named = args.policies.as_deref();
    if !args.retrain {
        return Ok(Policies::load(&models_folder(named), &learned)?);
    }
    let folder = named.map_or_else(|| args.out.join("policies"), Path::to_owned);
    prepare_folder(&folder)?;
    for behaviour in learned {
        retrain(behaviour, &folder, options)?;
    }
    Ok(Policies::load(&folder, &args.name.learned())?)
}

fn retrain(behaviour: Behaviour, folder: &Path, options: &ExperimentOptions) -> anyhow::Result<()> {
    let Some(config) = training_of(behaviour, options.steps, TRAINING_SEED) else {
        return Ok(());
    };
    let decisions = behaviour.decisions_as_long_as(options.decisions);
    let bar = bar(
        decisions,
        &format!("decisions of the training of {}", behaviour.name()),
    );
    let trainer = train(&config, decisions, &mut |trainer, _| {
        bar.set_position(trainer.decisions());
    })?;
    bar.finish_and_clear();
    Ok(trainer.save_policy(&policy_file(folder, behaviour))?)
}

fn bar(length: u64, what: &str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    let template = format!("[{{bar:40}}] {{pos}}/{{len}} {what}, {{eta}} left");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.tick();
    bar
}

/// Drives the cases of the shard that are not there yet, on all threads.
fn drive(plan: &Plan, store: &Store, shard: Shard, means: &Means) -> anyhow::Result<()> {
    let mut left = Vec::new();
    for case in shard.of(plan.cases()?) {
        if store.find(plan, &case)?.is_none() {
            left.push(case);
        }
    }
    let bar = bar(left.len() as u64, "cases");
    means.drive_all(&left, |case, figures| {
        store.keep(plan, case, figures)?;
        bar.inc(1);
        anyhow::Ok(())
    })?;
    bar.finish_and_clear();
    Ok(())
}

/// Tells what all cases come to, or how many are missing.
fn conclude(plan: &Plan, store: &Store, args: &ExperimentArgs) -> anyhow::Result<()> {
    let (driven, missing) = store.cases(plan)?;
    let name = plan.experiment.name();
    if !missing.is_empty() {
        return say(&format!(
            "{} of {} cases of {name} are in {}; run the other shards, too",
            driven.len(),
            driven.len() + missing.len(),
            store.folder().display()
        ));
    }
    let document = Document::new(plan, &driven, &missing);
    say(&document.text())?;
    let file = |ending: &str| -> PathBuf { args.out.join(format!("{name}.{ending}")) };
    pictures(&file("png"), &document.results)?;
    document.write_markdown(&file("md"))?;
    let report = document.report();
    write_json(&file("json"), &report)?;
    if let Some(json) = &args.json {
        write_json(json, &report).context("the experiment is done, but --json failed")?;
    }
    say(&format!("written to {}", file("{json,md,png}").display()))
}
