//! `covista bench training`: the closed loop without networks, an episode of Alg. 2, and what one
//! agent's update costs.

use std::time::Instant;

use covista_drive::{
    Algorithm, Hyperparameters, RingEnvironmentSettings, RingSettings, TrainingConfig, UpdateCost,
    update_cost,
};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::{
    cli::TrafficBenchArgs,
    output::{Report, prepare_file, say, write_json},
    table::aligned,
};

/// CAVs of the episode and of the closed loop, as in the paper's.
const CAVS: usize = 30;
/// Control steps of the episode: 800 decisions.
const EPISODE_DECISIONS: u64 = 800;
/// Decisions of the closed loop alone.
const LOOP_DECISIONS: u64 = 100;
/// Updates that are timed.
const UPDATES: usize = 200;
/// CAVs beside which an update is timed.
const SCALES: [usize; 2] = [30, 1000];

/// A row of `--json`.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Row {
    ClosedLoop {
        what: &'static str,
        cavs: usize,
        control_steps: u64,
        times_real_time: f64,
    },
    Episode {
        what: &'static str,
        cavs: usize,
        control_steps: u64,
        updates: u64,
        episode_s: f64,
    },
    Update(UpdateCost),
}

/// `covista bench training`.
pub(super) fn run(args: &TrafficBenchArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let bar = ProgressBar::new(2 + 2 * SCALES.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message("closed loop");
    let mut rows = vec![closed_loop()?];
    bar.inc(1);
    let hyperparameters = Hyperparameters::default();
    let neighbours = RingEnvironmentSettings::default().neighbours;
    for algorithm in [Algorithm::SafeActorCritic, Algorithm::Maddpg] {
        for cavs in SCALES {
            bar.set_message(format!("an update among {cavs} CAVs"));
            let cost = update_cost(algorithm, cavs, neighbours, hyperparameters, UPDATES)?;
            rows.push(Row::Update(cost));
            bar.inc(1);
        }
    }
    bar.set_message("an episode");
    rows.push(episode()?);
    bar.finish_and_clear();
    say(table(&rows).trim_end())?;
    match &args.json {
        Some(path) => write_json(path, &Report::new("bench training", rows)),
        None => Ok(()),
    }
}

fn config(decisions: u64) -> TrainingConfig {
    let ring = RingSettings {
        vehicles: CAVS,
        cavs: CAVS,
        ..RingSettings::default()
    };
    TrainingConfig {
        environment: RingEnvironmentSettings {
            ring,
            steps: decisions,
            ..RingEnvironmentSettings::default()
        },
        ..TrainingConfig::default()
    }
}

/// Untrained actors drive: what the environment and their decisions cost.
fn closed_loop() -> anyhow::Result<Row> {
    let mut trainer = config(LOOP_DECISIONS).start()?;
    let start = Instant::now();
    trainer.evaluate(0)?;
    let control_steps = LOOP_DECISIONS * 50;
    Ok(Row::ClosedLoop {
        what: "closed loop",
        cavs: CAVS,
        control_steps,
        times_real_time: control_steps as f64 * 0.01 / start.elapsed().as_secs_f64(),
    })
}

fn episode() -> anyhow::Result<Row> {
    let mut trainer = config(EPISODE_DECISIONS).start()?;
    let start = Instant::now();
    let report = trainer.train_round()?;
    Ok(Row::Episode {
        what: "episode of Alg. 2, independent learners",
        cavs: CAVS,
        control_steps: EPISODE_DECISIONS * 50,
        updates: report.updates.updates,
        episode_s: start.elapsed().as_secs_f64(),
    })
}

fn table(rows: &[Row]) -> String {
    let header = ["what", "CAVs", "result", "critic input, bytes"];
    let cells = rows.iter().map(|row| match row {
        Row::ClosedLoop {
            what,
            cavs,
            times_real_time,
            ..
        } => vec![
            (*what).to_owned(),
            cavs.to_string(),
            format!("{times_real_time:.1} x real time"),
            String::new(),
        ],
        Row::Episode {
            what,
            cavs,
            updates,
            episode_s,
            ..
        } => vec![
            (*what).to_owned(),
            cavs.to_string(),
            format!("{episode_s:.1} s, {updates} updates"),
            String::new(),
        ],
        Row::Update(cost) => vec![
            format!("update, {:?}", cost.algorithm),
            cost.agents.to_string(),
            format!("{:.2} ms, {:.0}/s", cost.median_ms, cost.updates_per_s),
            cost.critic_input_bytes.to_string(),
        ],
    });
    let rows: Vec<Vec<String>> = std::iter::once(header.map(str::to_owned).to_vec())
        .chain(cells)
        .collect();
    aligned(&rows)
}
