//! `covista eval`: how good the networks are, and what sharing adds.

mod cooperative;
mod detector;
mod errors;
mod fusion;
mod lanes;

use anyhow::bail;
use covista_drive::{Evaluated, Lacking, Progress};
use covista_perception::Provider;
use covista_sensors::kitti::KittiFrame;
use indicatif::ProgressBar;
use serde::Serialize;

use crate::{
    cli::{EvalArgs, EvalWhat, RecordedArgs},
    dataset::frame_bar,
    frames::recorded_frames,
    output::{Report, prepare_file, write_json},
};

/// A row of `--json`: the model, what computed it, the frames, and its figures.
#[derive(Serialize)]
struct Row<'a, T> {
    model: &'a str,
    provider: &'static str,
    frames: usize,
    lacking: Vec<Lacking>,
    #[serde(flatten)]
    figures: T,
}

/// `covista eval`.
pub fn run(args: &EvalArgs) -> anyhow::Result<()> {
    match &args.what {
        EvalWhat::Lanes(args) => lanes::run(args),
        EvalWhat::Detector(args) => detector::run(args),
        EvalWhat::Fusion(args) => fusion::run(args),
        EvalWhat::Cooperative(args) => cooperative::run(args),
        EvalWhat::Errors(args) => errors::run(args),
    }
}

/// Runs `work`, which tells how many frames are done, under a progress bar.
fn with_bar<T>(work: impl FnOnce(Progress<'_>) -> T) -> T {
    let bar: ProgressBar = frame_bar();
    let result = work(&|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    result
}

/// The frames to measure on, once it is known that the figures can be written.
fn frames_of(args: &RecordedArgs) -> anyhow::Result<Vec<KittiFrame>> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    recorded_frames(
        &args.data,
        args.calibration.as_deref(),
        args.labels.as_deref(),
    )
}

fn without_labels(args: &RecordedArgs, what: &str) -> anyhow::Result<()> {
    if args.json.is_some() {
        bail!("--json holds figures, and there are no {what} beside the file to take them on");
    }
    Ok(())
}

/// ` (3 others lack label_2)`.
fn lacking(lacking: &[Lacking]) -> String {
    let each = lacking
        .iter()
        .map(|Lacking { file, frames }| format!("{frames} others lack {file}"));
    match each.collect::<Vec<_>>().join(", ") {
        said if said.is_empty() => said,
        said => format!(" ({said})"),
    }
}

fn report<T: Serialize, F>(
    args: &RecordedArgs,
    command: &str,
    (model, provider): (&str, Provider),
    evaluated: &Evaluated<F>,
    figures: Vec<T>,
) -> anyhow::Result<()> {
    let Some(path) = &args.json else {
        return Ok(());
    };
    let rows = figures
        .into_iter()
        .map(|figures| Row {
            model,
            provider: provider.name(),
            frames: evaluated.frames,
            lacking: evaluated.lacking.clone(),
            figures,
        })
        .collect();
    write_json(path, &Report::new(command, rows))
}
