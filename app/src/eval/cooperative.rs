use std::collections::BTreeMap;

use anyhow::bail;
use covista_drive::{
    CooperativeEvaluation, CooperativeRuns, KnownVehicles, SharingCondition, evaluate_cooperative,
};
use covista_perception::Provider;
use serde::Serialize;

use super::with_bar;
use crate::{
    cli::CooperativeArgs,
    demo::{count_cavs, duration_s, load_scenario, perception_name, source},
    output::{Report, prepare_file, say, write_json},
    table::{aligned, optional},
};

/// A row of `--json`: one scenario under one condition.
#[derive(Serialize)]
struct Row<'a> {
    scenario: &'a str,
    seed: u64,
    seeds: u64,
    duration_s: f64,
    perception: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    provider: Option<&'static str>,
    models: &'a BTreeMap<String, String>,
    #[serde(flatten)]
    figures: &'a CooperativeEvaluation,
}

/// `covista eval cooperative`.
pub(super) fn run(args: &CooperativeArgs) -> anyhow::Result<()> {
    let Some(end) = args.seed.checked_add(args.seeds).filter(|_| args.seeds > 0) else {
        bail!(
            "--seeds {} from --seed {} on makes no runs; give at least 1",
            args.seeds,
            args.seed
        );
    };
    let runs = args
        .scenarios
        .iter()
        .map(|name| {
            let scenario = load_scenario(name)?;
            Ok(CooperativeRuns {
                duration_s: duration_s(args.duration, &scenario)?,
                seeds: args.seed..end,
                scenario,
            })
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let most_cavs = runs.iter().map(|runs| count_cavs(&runs.scenario)).max();
    let mut source = source(
        args.perception,
        args.models.as_deref(),
        None,
        args.provider,
        most_cavs.unwrap_or(0),
    )?;
    let mut evaluations = Vec::new();
    for runs in &runs {
        let found = with_bar(|progress| evaluate_cooperative(runs, &mut source.senses, progress))?;
        say(&table(runs, args, &found))?;
        evaluations.push(found);
    }
    let Some(path) = &args.json else {
        return Ok(());
    };
    let rows = runs.iter().zip(&evaluations).flat_map(|(runs, found)| {
        found.iter().map(|figures| Row {
            scenario: &runs.scenario.name,
            seed: args.seed,
            seeds: args.seeds,
            duration_s: runs.duration_s,
            perception: perception_name(args.perception),
            provider: source.provider.map(Provider::name),
            models: &source.models,
            figures,
        })
    });
    write_json(path, &Report::new("eval cooperative", rows.collect()))
}

/// Picks the figures of a set of vehicles.
type Set = fn(&CooperativeEvaluation) -> &KnownVehicles;

/// The conditions side by side.
fn table(
    runs: &CooperativeRuns,
    args: &CooperativeArgs,
    found: &[CooperativeEvaluation],
) -> String {
    let mut rows = vec![row("", found, |row| name(row.sharing).to_owned())];
    let sets: [(&str, Set); 5] = [
        ("all within 100 m", |row| &row.all),
        ("of these, not CAVs", |row| &row.not_cavs),
        ("seen by a CAV", |row| &row.seen_by_a_cav),
        ("seen by the ego", |row| &row.seen_by_ego),
        ("hidden from the ego", |row| &row.hidden_from_ego),
    ];
    for (set, known) in sets {
        let vehicles = found.first().map_or(0, |row| known(row).vehicles);
        rows.push(vec![format!("{set}: {vehicles} vehicles")]);
        let mut add = |name: &str, digits: usize, value: fn(&KnownVehicles) -> Option<f64>| {
            rows.push(row(name, found, |row| optional(value(known(row)), digits)));
        };
        add("  AP (BEV, R40) at IoU 0.5, %", 1, |known| {
            known.ap_bev_50_r40
        });
        add("  AP (BEV, R40) at IoU 0.7, %", 1, |known| {
            known.ap_bev_70_r40
        });
        add("  shown by a track within 2 m, %", 1, |known| {
            known.shown_percent
        });
        add("  position RMSE, m", 2, |known| known.position_rmse_m);
        add("  velocity RMSE, m/s", 2, |known| known.velocity_rmse_mps);
    }
    rows.push(row("identity switches", found, |row| {
        row.identity_switches.to_string()
    }));
    rows.push(row("fragmentations", found, |row| {
        row.fragmentations.to_string()
    }));
    rows.push(row("false tracks", found, |row| {
        row.false_tracks.to_string()
    }));
    let frames = found.first().map_or(0, |row| row.frames);
    format!(
        "{}, {} runs from seed {} on, {frames} frames of CAVs, perception: {}\n{}",
        runs.scenario.name,
        args.seeds,
        args.seed,
        perception_name(args.perception),
        aligned(&rows)
    )
}

fn name(sharing: SharingCondition) -> &'static str {
    match sharing {
        SharingCondition::Alone => "alone",
        SharingCondition::Ideal => "ideal",
        SharingCondition::Latency => "100 ms",
        SharingCondition::PoseNoise => "pose noise",
        SharingCondition::LatencyAndPoseNoise => "both",
    }
}

fn row(
    name: &str,
    found: &[CooperativeEvaluation],
    cell: impl Fn(&CooperativeEvaluation) -> String,
) -> Vec<String> {
    std::iter::once(name.to_owned())
        .chain(found.iter().map(cell))
        .collect()
}
