//! `covista bench control`: the adversarial campaign of the safety filter, the same with each
//! assumption broken on purpose, plants unlike the model, and how long one step takes.

mod rows;

use std::sync::atomic::{AtomicU64, Ordering};

use covista_drive::{
    Broken, COVERS, CampaignSpec, ControlSettings, Nominals, PlantModel, Tally, cover_plants,
    run_campaign, time_control,
};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use crate::{
    cli::ControlBenchArgs,
    output::{Report, prepare_file, say, write_json},
};
use rows::{CampaignRow, Row};

/// Steps of a campaign with one assumption broken: this share of the others', within bounds.
const BROKEN_SHARE: u64 = 50;
const BROKEN_STEPS: [u64; 2] = [30_000, 200_000];
/// Steps in which a candidate for a plant's bounds has to hold.
const PLANT_SHARE: u64 = 200;
/// Timed calls of the closed form.
const CALL_SHARE: u64 = 50;
const CALLS: [u64; 2] = [1_000, 200_000];

/// `covista bench control`.
pub(super) fn run(args: &ControlBenchArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let (seed, steps) = (args.seed, args.steps.get());
    let control = ControlSettings::default();
    let spec = CampaignSpec {
        seed,
        steps,
        control,
        broken: None,
        nominal: Nominals::All,
        plant: PlantModel::Kinematic,
    };
    let mut rows = Vec::new();

    let calls = (steps / CALL_SHARE).clamp(CALLS[0], CALLS[1]);
    let bar = step_bar("timing");
    let timings = time_control(&control, seed, calls as usize, &|done| bar.inc(done))?;
    bar.finish_and_clear();
    rows.extend(timings.iter().map(Row::timing));

    let bar = step_bar("campaign");
    bar.set_length(steps);
    let families = run_campaign(&spec, &progress(&bar))?;
    bar.finish_and_clear();
    rows.push(Row::Campaign(CampaignRow::whole(seed, &families)));

    let broken_steps = (steps / BROKEN_SHARE).clamp(BROKEN_STEPS[0], BROKEN_STEPS[1]);
    let bar = step_bar("broken on purpose");
    bar.set_length(broken_steps * Broken::ALL.len() as u64);
    for broken in Broken::ALL {
        let spec = CampaignSpec {
            steps: broken_steps,
            broken: Some(broken),
            ..spec.clone()
        };
        let mut found = Tally::default();
        for (_, tally) in run_campaign(&spec, &|_| {})? {
            found.add(&tally);
        }
        bar.inc(broken_steps);
        rows.push(Row::Campaign(CampaignRow::broken(seed, broken, &found)));
    }
    bar.finish_and_clear();

    let bar = step_bar("plants");
    bar.set_length(COVERS.len() as u64);
    let covers = cover_plants(&control, seed, steps.div_ceil(PLANT_SHARE), &|_| bar.inc(1))?;
    bar.finish_and_clear();
    rows.extend(covers.iter().map(|cover| Row::plant(seed, cover)));

    for table in rows::tables(&rows) {
        say(&format!("{}\n", table.trim_end()))?;
    }
    let Some(json) = &args.json else {
        return Ok(());
    };
    let settings = json!({ "seed": seed, "steps": steps, "control": control });
    write_json(
        json,
        &Report::new("bench control", rows).with_settings(settings),
    )
}

/// Moves the bar on; steps are told by any thread, not always in order.
fn progress(bar: &ProgressBar) -> impl Fn(u64) + Sync {
    let most = AtomicU64::new(0);
    move |done| {
        let before = most.fetch_max(done, Ordering::Relaxed);
        bar.set_position(done.max(before));
    }
}

fn step_bar(what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(0);
    let template = "{msg} [{bar:40}] {pos}/{len}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message(what);
    bar
}
