use std::{path::Path, time::SystemTime};

use anyhow::{Context, bail};
use covista_drive::{
    ChannelSettings, ControlSettings, DataOrigin, ErrorFigures, ErrorFrames, Evaluated, RunConfig,
    figures_by_distance, fit_errors, perceive_dataset, perceive_scenario,
};
use covista_sensors::{ErrorModel, ErrorSource, kitti::kitti_frames};
use serde::Serialize;

use super::{lacking, with_bar};
use crate::{
    cli::{ErrorsArgs, ProviderArg},
    demo::{count_cavs, duration_s, load_scenario, progress_bar},
    frames::{error_model, network_hashes, networks, perceiver},
    output::{Report, prepare_file, say, write_json, write_whole},
    table::aligned,
};

/// The model draws so many times on each frame, for its figures to have little noise of their own.
const DRAWS: u64 = 20;

/// A row of `--json`: where the frames are from, who found, and what.
#[derive(Serialize)]
struct Row {
    frames_of: String,
    found_by: &'static str,
    #[serde(flatten)]
    figures: ErrorFigures,
}

/// `covista eval errors`.
pub(super) fn run(args: &ErrorsArgs) -> anyhow::Result<()> {
    for file in [&args.out, &args.json].into_iter().flatten() {
        prepare_file(file)?;
    }
    let known = match args.out {
        Some(_) => None,
        None => Some(error_model(args.errors.as_deref())?),
    };
    let config = args.scenario.as_ref().map(|name| {
        let scenario = load_scenario(name)?;
        anyhow::Ok(RunConfig {
            duration_s: duration_s(args.duration, &scenario)?,
            scenario,
            seed: args.seed,
            sharing: true,
            control: ControlSettings::default(),
            channel: ChannelSettings::default(),
        })
    });
    let config = config.transpose()?;
    let data = args.data.as_deref().map(|folder| of_data(folder, args));
    let data = data.transpose()?;
    let closed_loop = config.as_ref().map(|config| of_scenario(config, args));
    let closed_loop = closed_loop.transpose()?;
    let model = match (known, &args.out, &data, &closed_loop) {
        (Some(model), ..) => model,
        (None, Some(out), Some(data), Some(closed_loop)) => fit(out, data, closed_loop, args)?,
        _ => bail!("--out needs --data and --scenario"),
    };
    let mut rows = Vec::new();
    if let Some(data) = &data {
        let (frames, origin) = &data.figures;
        say(&format!(
            "{} frames of seed {}, split {}{}",
            data.frames,
            origin.seed,
            origin.split,
            lacking(&data.lacking)
        ))?;
        rows.extend(compared(&name_of(origin), frames, &model)?);
    }
    if let (Some(frames), Some(name)) = (&closed_loop, &args.scenario) {
        let name = format!("{name}, seed {}", args.seed);
        say(&format!("{} frames of {name}", frames.frames.len()))?;
        rows.extend(compared(&name, frames, &model)?);
    }
    if let Some(path) = &args.json {
        write_json(path, &Report::new("eval errors", rows))?;
    }
    Ok(())
}

type Perceived = Evaluated<(ErrorFrames, DataOrigin)>;

fn of_data(folder: &Path, args: &ErrorsArgs) -> anyhow::Result<Perceived> {
    let frames = kitti_frames(folder)?;
    let mut perceiver = perceiver(args.models.as_deref(), ProviderArg::default())?;
    Ok(with_bar(|progress| {
        perceive_dataset(&frames, &mut perceiver, progress)
    })?)
}

fn of_scenario(config: &RunConfig, args: &ErrorsArgs) -> anyhow::Result<ErrorFrames> {
    let networks = networks(
        args.models.as_deref(),
        count_cavs(&config.scenario),
        ProviderArg::default(),
    )?;
    let bar = progress_bar("closed loop", config.duration_s);
    let frames = perceive_scenario(config, networks, &|time_s| {
        bar.set_position((time_s * 10.0).round() as u64);
    });
    bar.finish_and_clear();
    Ok(frames?)
}

/// Fits the model and writes it.
fn fit(
    out: &Path,
    data: &Perceived,
    closed_loop: &ErrorFrames,
    args: &ErrorsArgs,
) -> anyhow::Result<ErrorModel> {
    let (frames, origin) = &data.figures;
    let scenario = args.scenario.as_deref().unwrap_or_default();
    let folder = args.data.as_deref().unwrap_or(Path::new("")).display();
    let duration = args.duration.map_or_else(String::new, |duration_s| {
        format!(" --duration {duration_s}")
    });
    let source = ErrorSource {
        command: format!(
            "covista eval errors --data {folder} --scenario {scenario} --seed {}{duration} --out {}",
            args.seed,
            out.display()
        ),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        date: today(),
        data_seed: origin.seed,
        data_split: origin.split.clone(),
        frames: data.frames,
        closed_loop: format!(
            "{scenario}, seed {}, {} frames",
            args.seed,
            closed_loop.frames.len()
        ),
        networks: network_hashes(args.models.as_deref())?,
    };
    let model = fit_errors(frames, closed_loop, source)?;
    let mut text = HEADER.to_owned();
    text += &model.to_toml().context("the fit has no place in TOML")?;
    // What is written is what will be read.
    let model = ErrorModel::parse(&text, &out.display().to_string())?;
    write_whole(out, text.as_bytes())?;
    say(&format!("written to {}", out.display()))?;
    Ok(model)
}

const HEADER: &str = "\
# What the networks do to vehicles that are there, and what they see where none is.
# Errors are found minus true, as quantiles at 0, 1, 5, 25, 50, 75, 95, 99 and 100 %.
# docs/perception-errors.md explains every field.
";

/// The networks' figures and the model's on the same frames, told and as rows.
fn compared(name: &str, frames: &ErrorFrames, model: &ErrorModel) -> anyhow::Result<Vec<Row>> {
    let by_networks = figures_by_distance(frames);
    let by_model = figures_by_distance(&frames.drawn(model, DRAWS));
    let mut rows = Vec::new();
    for (networks, model) in by_networks.into_iter().zip(by_model) {
        rows.extend([("networks", networks), ("model", model)]);
    }
    let header = [
        "distance, m",
        "found by",
        "vehicles",
        "recall",
        "centre, m",
        "length, m",
        "heading, rad",
        "flipped",
        "other class",
        "lane right",
        "no lane",
        "score",
        "false/frame",
    ];
    let mut table = vec![header.map(str::to_owned).to_vec()];
    for (found_by, figures) in &rows {
        let two = |[median, most]: [f64; 2]| format!("{median:.2} / {most:.2}");
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        table.push(vec![
            format!("{:.0}-{:.0}", figures.distance_m[0], figures.distance_m[1]),
            (*found_by).to_owned(),
            figures.vehicles.to_string(),
            percent(figures.recall),
            two(figures.center_m),
            two(figures.length_m),
            two(figures.yaw_rad),
            percent(figures.flipped),
            percent(figures.other_class),
            percent(figures.lane_right),
            percent(figures.lane_none),
            format!("{:.2}", figures.mean_score),
            format!("{:.2}", figures.false_per_frame),
        ]);
    }
    say(aligned(&table).trim_end())?;
    Ok(rows
        .into_iter()
        .map(|(found_by, figures)| Row {
            frames_of: name.to_owned(),
            found_by,
            figures,
        })
        .collect())
}

fn name_of(origin: &DataOrigin) -> String {
    format!("data set of seed {}, split {}", origin.seed, origin.split)
}

/// The day in UTC, year-month-day.
fn today() -> String {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    date_of(since.map_or(0, |since| since.as_secs() / 86_400))
}

/// The civil date so many days after 1970-01-01.
fn date_of(mut day: u64) -> String {
    let is_leap = |year: u64| {
        year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
    };
    let mut year = 1970;
    while day >= 365 + u64::from(is_leap(year)) {
        day -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let february = 28 + u64::from(is_leap(year));
    let mut month = 1;
    for length in [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30] {
        if day < length {
            break;
        }
        day -= length;
        month += 1;
    }
    format!("{year}-{month:02}-{:02}", day + 1)
}

#[cfg(test)]
mod tests {
    use super::date_of;

    #[test]
    fn days_are_told_as_dates() {
        for (day, date) in [
            (0, "1970-01-01"),
            (59, "1970-03-01"),
            (789, "1972-02-29"),
            (11_016, "2000-02-29"),
            (20_453, "2025-12-31"),
            (20_779, "2026-11-22"),
        ] {
            assert_eq!(date_of(day), date);
        }
    }
}
