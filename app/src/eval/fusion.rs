use covista_drive::{FusionEvaluation, LaneIndexFigures, Origin, evaluate_fusion};
use serde::Serialize;

use super::{Row, lacking, with_bar};
use crate::{
    cli::FusionArgs,
    frames::{perceiver, recorded_frames},
    output::{Report, prepare_file, say, write_json},
    table::{aligned, optional},
};

/// What the figures were taken on, and one of them.
#[derive(Serialize)]
struct Figures<T> {
    seed: Option<u64>,
    split: Option<String>,
    #[serde(flatten)]
    figures: T,
}

/// `covista eval fusion`.
pub(super) fn run(args: &FusionArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let frames = recorded_frames(&args.data, None, None)?;
    let mut perceiver = perceiver(args.models.as_deref(), args.provider)?;
    let evaluated = with_bar(|progress| evaluate_fusion(&frames, &mut perceiver, progress))?;
    let figures = &evaluated.figures;
    say(&format!(
        "fusion on {} frames{}: vehicles with 5 returns or more, shares in percent",
        evaluated.frames,
        lacking(&evaluated.lacking)
    ))?;
    say(aligned(&lane_rows(figures)).trim_end())?;
    say("")?;
    say(aligned(&geometry_rows(figures)).trim_end())?;
    let Some(path) = &args.json else {
        return Ok(());
    };
    let rows = figures.rows().into_iter().map(|row| Row {
        model: "fusion",
        provider: perceiver.provider().name(),
        frames: evaluated.frames,
        lacking: evaluated.lacking.clone(),
        figures: Figures {
            seed: figures.seed,
            split: figures.split.clone(),
            figures: row,
        },
    });
    write_json(path, &Report::new("eval fusion", rows.collect()))
}

/// Within 50 m by what the fusion was given, and with both networks by road, view and distance.
fn lane_rows(figures: &FusionEvaluation) -> Vec<Vec<String>> {
    let header = [
        "marks, boxes",
        "road",
        "view",
        "m",
        "vehicles",
        "right",
        "undetected",
        "undecided",
        "wrong",
        "right of detected",
        "elsewhere",
        "given a lane",
    ];
    let is_shown = |row: &&LaneIndexFigures| {
        let networks = (row.marks, row.boxes) == (Origin::Network, Origin::Network);
        let is_near = row.to_m - row.from_m > 10.0;
        let is_whole = (row.road, row.view) == ("marked", "all");
        match (networks, is_near) {
            (true, true) => true,
            (true, false) => row.view == "all" && row.road != "unmarked",
            (false, true) => is_whole,
            (false, false) => false,
        }
    };
    let rows = figures.lane_indices.iter().filter(is_shown).map(|row| {
        vec![
            format!("{}, {}", said(row.marks), said(row.boxes)),
            row.road.to_owned(),
            row.view.to_owned(),
            format!("{:.0}-{:.0}", row.from_m, row.to_m),
            row.vehicles.to_string(),
            optional(row.lane_index_accuracy, 1),
            optional(row.undetected, 1),
            optional(row.undecided, 1),
            optional(row.wrong, 1),
            optional(row.lane_index_accuracy_detected, 1),
            row.elsewhere.to_string(),
            optional(row.elsewhere_given_lane, 1),
        ]
    });
    std::iter::once(header.map(str::to_owned).to_vec())
        .chain(rows)
        .collect()
}

fn geometry_rows(figures: &FusionEvaluation) -> Vec<Vec<String>> {
    let header = [
        "error, median / 95 %",
        "vehicles",
        "distance, m",
        "observation angle, deg",
        "rotation, deg",
        "reversed, %",
    ];
    let rows = figures.geometry.iter().map(|row| {
        let pair = |median, p95, digits| {
            format!("{} / {}", optional(median, digits), optional(p95, digits))
        };
        vec![
            format!("{:.0}-{:.0} m", row.from_m, row.to_m),
            row.vehicles.to_string(),
            pair(row.median_distance_m, row.p95_distance_m, 2),
            pair(
                row.median_observation_angle_deg,
                row.p95_observation_angle_deg,
                1,
            ),
            pair(row.median_rotation_y_deg, row.p95_rotation_y_deg, 1),
            optional(row.reversed, 1),
        ]
    });
    std::iter::once(header.map(str::to_owned).to_vec())
        .chain(rows)
        .collect()
}

fn said(origin: Origin) -> &'static str {
    match origin {
        Origin::Network => "network",
        Origin::Exact => "exact",
    }
}
