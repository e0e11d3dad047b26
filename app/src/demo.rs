use std::{collections::BTreeMap, path::Path, time::Duration};

use anyhow::bail;
use covista_drive::{
    ChannelSettings, ControlMode, ControlSettings, RunConfig, RunSummary, Scenario, Senses,
    Snapshot, TRACE_HEADER, VehicleKind, load_control_settings, run,
};
use covista_perception::Provider;
use covista_viewer::{open_viewer, plot_speeds, plot_trajectories};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::{
    cli::{DemoArgs, ModeArg, PerceptionArg, ProviderArg, SharingArg},
    frames::{error_model, network_hashes, networks},
    output::{prepare_file, prepare_folder, say, write_json, write_whole},
    record::{Recorded, Recorder},
    replay::{self, is_recorded},
    table::side_by_side,
};

/// `summary.json`.
#[derive(Serialize)]
struct Summary<'a> {
    version: &'static str,
    scenario: &'a str,
    seed: u64,
    perception: &'static str,
    settings: ControlSettings,
    #[serde(skip_serializing_if = "Option::is_none")]
    provider: Option<&'static str>,
    models: BTreeMap<String, String>,
    runs: &'a [RunSummary],
}

/// `covista demo`.
pub fn run_demo(args: &DemoArgs) -> anyhow::Result<()> {
    if Scenario::builtin(&args.scenario).is_err() && is_recorded(&args.scenario) {
        return replay::run(args);
    }
    if args.calibration.is_some() {
        bail!("--calibration is for recorded frames; a scenario has its own sensors");
    }
    let scenario = load_scenario(&args.scenario)?;
    let duration_s = duration_s(args.duration, &scenario)?;
    let is_folder_name = !scenario.name.is_empty()
        && scenario
            .name
            .chars()
            .all(|c| c.is_alphanumeric() || "-_. ".contains(c))
        && scenario.name.chars().any(char::is_alphanumeric);
    if args.out.is_none() && !is_folder_name {
        bail!(
            "the scenario's name {:?} can't name the output folder; give --out or another name",
            scenario.name
        );
    }
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| Path::new("out").join(&scenario.name));
    prepare_folder(&out)?;
    for name in ["sharing-on.rrd", "sharing-off.rrd", "summary.json"] {
        // An earlier run's; what this one does not write again would stand beside it.
        let _ = std::fs::remove_file(out.join(name));
    }
    if let Some(trace) = &args.trace {
        prepare_file(trace)?;
    }
    let control = control_settings(args.control.as_deref(), args.mode)?;
    let mut source = source(
        args.perception,
        args.models.as_deref(),
        args.errors.as_deref(),
        args.provider,
        count_cavs(&scenario),
    )?;
    let sharings: &[bool] = match args.sharing {
        SharingArg::On => &[true],
        SharingArg::Off => &[false],
        SharingArg::Both => &[true, false],
    };
    let mut runs = Vec::new();
    let mut recorded = Vec::new();
    let mut recordings = Vec::new();
    let mut trace = format!("{TRACE_HEADER}\n");
    for &sharing in sharings {
        let config = RunConfig {
            scenario: scenario.clone(),
            seed: args.seed,
            sharing,
            channel: ChannelSettings::default(),
            duration_s,
            control,
        };
        let rrd = format!("sharing-{}.rrd", if sharing { "on" } else { "off" });
        let path = out.join(&rrd);
        let mut recorder = Recorder::new(&path, &config);
        let bar = progress_bar(
            if sharing {
                "sharing on "
            } else {
                "sharing off"
            },
            duration_s,
        );
        let mut summary = run(&config, &mut source.senses, &mut |snapshot: &Snapshot<
            '_,
        >| {
            bar.set_position((snapshot.time_s * 10.0).round() as u64);
            recorder.log(snapshot)?;
            if args.trace.is_some() {
                for row in &snapshot.rows {
                    trace.push_str(&row.to_string());
                    trace.push('\n');
                }
            }
            Ok(())
        })?;
        bar.finish_and_clear();
        recorded.push(recorder.finish(&summary)?);
        summary.rrd = rrd;
        runs.push(summary);
        recordings.push(path);
    }
    plot(&out, &recorded)?;
    if let Some(path) = &args.trace {
        write_whole(path, trace.as_bytes())?;
    }
    write_json(
        &out.join("summary.json"),
        &Summary {
            version: env!("CARGO_PKG_VERSION"),
            scenario: &scenario.name,
            seed: args.seed,
            perception: perception_name(args.perception),
            settings: ControlSettings::default(),
            provider: source.provider.map(Provider::name),
            models: source.models,
            runs: &runs,
        },
    )?;
    let text = side_by_side(&runs);
    say(&format!("{text}\nwritten to {}", out.display()))?;
    if args.view {
        open_viewer(&recordings)?;
    }
    Ok(())
}

/// The scenario of a built-in name or a TOML file.
pub fn load_scenario(name: &str) -> anyhow::Result<Scenario> {
    let path = Path::new(name);
    if path
        .extension()
        .is_some_and(|extension| extension == "toml")
    {
        Ok(Scenario::load(path)?)
    } else {
        Ok(Scenario::builtin(name)?)
    }
}

/// How long a run lasts.
pub fn duration_s(named: Option<f64>, scenario: &Scenario) -> anyhow::Result<f64> {
    let duration_s = named.unwrap_or(scenario.duration_s);
    if !(0.01..=100_000.0).contains(&duration_s) {
        bail!("--duration {duration_s:e} is out of range; take 0.01 to 100000 seconds");
    }
    Ok(duration_s)
}

/// Perception as files name it.
pub fn perception_name(perception: PerceptionArg) -> &'static str {
    match perception {
        PerceptionArg::Network => "network",
        PerceptionArg::Statistical => "statistical",
        PerceptionArg::Truth => "truth",
    }
}

/// How many CAVs a scenario has.
pub fn count_cavs(scenario: &Scenario) -> usize {
    let vehicles = scenario.vehicles.iter();
    vehicles
        .filter(|vehicle| vehicle.kind == VehicleKind::Cav)
        .count()
}

/// Where percepts come from, what computes the networks, and their hashes.
pub struct Source {
    pub senses: Senses,
    pub provider: Option<Provider>,
    pub models: BTreeMap<String, String>,
}

/// What `perception` asks for; `errors` are for statistical perception, `provider` for networks.
pub fn source(
    perception: PerceptionArg,
    models: Option<&Path>,
    errors: Option<&Path>,
    provider: ProviderArg,
    cavs: usize,
) -> anyhow::Result<Source> {
    if errors.is_some() && perception != PerceptionArg::Statistical {
        bail!("--errors is for --perception statistical");
    }
    if provider != ProviderArg::default() && perception != PerceptionArg::Network {
        bail!("--provider is for --perception network");
    }
    Ok(match perception {
        PerceptionArg::Truth => Source {
            senses: Senses::Truth,
            provider: None,
            models: BTreeMap::new(),
        },
        PerceptionArg::Statistical => {
            let model = error_model(errors)?;
            Source {
                models: model.source.networks.clone(),
                provider: None,
                senses: Senses::Statistical(Box::new(model)),
            }
        }
        PerceptionArg::Network => {
            let networks = networks(models, cavs, provider)?;
            Source {
                provider: Some(networks.provider()),
                senses: Senses::Network(networks),
                models: network_hashes(models)?,
            }
        }
    })
}

/// Progress by simulated time, on stderr.
pub fn progress_bar(what: &'static str, duration_s: f64) -> ProgressBar {
    let bar = ProgressBar::new((duration_s * 10.0).round() as u64);
    if let Ok(style) = ProgressStyle::with_template(
        "{msg} [{bar:40}] {percent:>3} % of the simulated time, {eta} left",
    ) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message(what);
    bar.enable_steady_tick(Duration::from_millis(250));
    bar
}

fn plot(out: &Path, recorded: &[Recorded]) -> anyhow::Result<()> {
    let Some(first) = recorded.first() else {
        return Ok(());
    };
    let series: Vec<_> = recorded.iter().map(|run| run.series.clone()).collect();
    plot_trajectories(
        &out.join("trajectories.png"),
        &first.road,
        &first.scenery,
        &series,
    )?;
    plot_speeds(&out.join("speeds.png"), &series)?;
    Ok(())
}

/// The controller's settings: those of a file, in the mode that is asked for.
fn control_settings(file: Option<&Path>, mode: Option<ModeArg>) -> anyhow::Result<ControlSettings> {
    let mut settings = file.map_or(Ok(ControlSettings::default()), load_control_settings)?;
    if let Some(mode) = mode {
        settings.mode = match mode {
            ModeArg::Safe => ControlMode::Safe,
            ModeArg::Paper => ControlMode::Paper,
            ModeArg::Off => ControlMode::Off,
        };
    }
    Ok(settings)
}
