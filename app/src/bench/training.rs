//! `covista bench training`: the closed loop without networks, an episode of Alg. 2, and what one
//! agent's update costs, here and in Python.

mod peer;

use std::time::Instant;

use covista_drive::{
    Algorithm, Hyperparameters, RingEnvironmentSettings, RingSettings, TrainingConfig, UpdateCost,
    time_closed_loop, update_cost,
};
use indicatif::{ProgressBar, ProgressStyle};
use peer::{Peer, PeerRow};
use serde::Serialize;

use crate::{
    cli::TrainingBenchArgs,
    output::{Report, prepare_file, say, write_json},
    table::aligned,
};

/// CAVs of the episode and of the closed loop, as in the paper's.
const CAVS: usize = 30;
/// Decisions of the closed loop alone, at the most.
const LOOP_DECISIONS: u64 = 100;
/// Control steps of 0.01 s between two decisions.
const STEPS_A_DECISION: u64 = 50;
/// Updates that are timed, at the most.
const UPDATES: u64 = 200;
/// CAVs beside which an update is timed.
const SCALES: [usize; 2] = [30, 1000];

/// A row of `--json`.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Row {
    ClosedLoop {
        what: &'static str,
        cavs: usize,
        loops: usize,
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
    Peer(PeerRow),
}

/// `covista bench training`.
pub(super) fn run(args: &TrainingBenchArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let hyperparameters = Hyperparameters::default();
    let neighbours = RingEnvironmentSettings::default().neighbours;
    let folder = tempfile::tempdir()?;
    let peer = match args.against {
        Some(kind) => {
            let sizes = (CAVS, neighbours);
            Some(Peer::start(kind, sizes, hyperparameters, folder.path())?)
        }
        None => None,
    };
    let bar = ProgressBar::new(2 + 2 * SCALES.len() as u64 + u64::from(peer.is_some()));
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message("closed loop");
    let decisions = args.decisions.get();
    let mut rows = vec![closed_loop(decisions.min(LOOP_DECISIONS))?];
    bar.inc(1);
    let updates = decisions.min(UPDATES) as usize;
    for algorithm in [Algorithm::SafeActorCritic, Algorithm::Maddpg] {
        for cavs in SCALES {
            bar.set_message(format!("an update among {cavs} CAVs"));
            let cost = update_cost(algorithm, cavs, neighbours, hyperparameters, updates)?;
            rows.push(Row::Update(cost));
            bar.inc(1);
        }
    }
    if let Some(peer) = peer {
        bar.set_message("updates in turns");
        rows.push(Row::Peer(peer.hold(updates)?));
        bar.inc(1);
    }
    bar.set_message("an episode");
    rows.push(episode(decisions)?);
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
            watched: false,
            ..RingEnvironmentSettings::default()
        },
        ..TrainingConfig::default()
    }
}

/// Random safe actions, a loop on each core.
fn closed_loop(decisions: u64) -> anyhow::Result<Row> {
    let loops = std::thread::available_parallelism().map_or(1, Into::into);
    Ok(Row::ClosedLoop {
        what: "closed loop",
        cavs: CAVS,
        loops,
        control_steps: decisions * STEPS_A_DECISION,
        times_real_time: time_closed_loop(config(decisions).environment, loops)?,
    })
}

fn episode(decisions: u64) -> anyhow::Result<Row> {
    let mut trainer = config(decisions).start(None)?;
    let start = Instant::now();
    let report = trainer.train_round()?;
    Ok(Row::Episode {
        what: "episode of Alg. 2, independent learners",
        cavs: CAVS,
        control_steps: decisions * STEPS_A_DECISION,
        updates: report.updates.updates,
        episode_s: start.elapsed().as_secs_f64(),
    })
}

fn table(rows: &[Row]) -> String {
    let header = ["what", "CAVs", "result", "critic input, bytes"];
    let cells = rows.iter().map(|row| match row {
        Row::Peer(peer) => vec![
            format!("the same update in turns with {}", peer.versions),
            CAVS.to_string(),
            format!(
                "{:.0}/s against its {:.0}/s, {:.2} times as fast",
                peer.covista_updates_per_s, peer.updates_per_s, peer.covista_speed_ratio
            ),
            String::new(),
        ],
        Row::ClosedLoop {
            what,
            cavs,
            times_real_time,
            loops,
            ..
        } => vec![
            format!("{what}, {loops} side by side"),
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
