use covista_drive::{RingTiming, time_ring};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::{
    cli::TrafficBenchArgs,
    output::{Report, prepare_file, say, write_json},
    table::aligned,
};

const VEHICLES: [usize; 3] = [30, 90, 1000];
/// Steps of one vehicle that are timed in each row.
const VEHICLE_STEPS: u64 = 10_000_000;

/// A row of `--json`.
#[derive(Debug, Serialize)]
struct Row {
    vehicles: usize,
    vehicle_steps_per_s_core: f64,
    times_real_time: f64,
}

/// `covista bench traffic`.
pub(super) fn run(args: &TrafficBenchArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let bar = ProgressBar::new(VEHICLES.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} rings, {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.tick();
    let mut rows = Vec::new();
    for vehicles in VEHICLES {
        rows.push(row(&time_ring(vehicles, VEHICLE_STEPS)?));
        bar.inc(1);
    }
    bar.finish_and_clear();
    say(table(&rows).trim_end())?;
    match &args.json {
        Some(path) => write_json(path, &Report::new("bench traffic", rows)),
        None => Ok(()),
    }
}

fn row(timing: &RingTiming) -> Row {
    Row {
        vehicles: timing.vehicles,
        vehicle_steps_per_s_core: timing.vehicle_steps_per_s,
        times_real_time: timing.times_real_time,
    }
}

fn table(rows: &[Row]) -> String {
    let header = ["vehicles", "vehicle-steps/s core", "times real time"];
    let cells = rows.iter().map(|row| {
        vec![
            row.vehicles.to_string(),
            format!("{:.0}", row.vehicle_steps_per_s_core),
            format!("{:.0}", row.times_real_time),
        ]
    });
    let rows: Vec<_> = std::iter::once(header.map(String::from).to_vec())
        .chain(cells)
        .collect();
    aligned(&rows)
}
