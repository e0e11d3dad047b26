use covista_drive::{DetectorEvaluation, LaneEvaluation, evaluate};
use covista_perception::{DETECTOR_MODEL, LANE_MODEL, OnnxRuntime, Perceiver};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::{
    cli::{EvalArgs, EvalWhat},
    output::{Report, models_folder, prepare_file, say, write_json},
};

/// A row of `--json`: the model, the frames, and its figures.
#[derive(Serialize)]
struct Row<T> {
    model: &'static str,
    frames: usize,
    #[serde(flatten)]
    figures: T,
}

/// `covista eval`.
pub fn run(args: &EvalArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let runtime = OnnxRuntime::acquire(&|message| eprintln!("covista: {message}"))?;
    let threads = std::thread::available_parallelism().map_or(1, Into::into);
    let folder = models_folder(args.models.as_deref());
    let mut perceiver = Perceiver::new(&runtime, &folder, threads)?;
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} frames, {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    let evaluation = evaluate(&args.data, &mut perceiver, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let frames = evaluation.frames;
    match args.what {
        EvalWhat::Lanes => {
            let LaneEvaluation {
                accuracy_tusimple,
                accuracy_ufld,
            } = evaluation.lanes;
            say(&format!(
                "{LANE_MODEL} on {frames} frames: TuSimple accuracy {accuracy_tusimple:.2} %, \
                 UFLD's variant {accuracy_ufld:.2} %"
            ))?;
            report(
                args,
                "eval lanes",
                LANE_MODEL,
                frames,
                vec![evaluation.lanes],
            )
        }
        EvalWhat::Detector => {
            for DetectorEvaluation {
                class,
                boxes,
                ap_bev_50_r40,
                ap_bev_70_r40,
            } in &evaluation.detector
            {
                let percent = |ap: &Option<f64>| ap.map_or("-".into(), |ap| format!("{ap:.1} %"));
                say(&format!(
                    "{DETECTOR_MODEL} on {frames} frames, {boxes} boxes of class {class:?}: \
                     AP (BEV, R40) {} at IoU 0.5, {} at IoU 0.7",
                    percent(ap_bev_50_r40),
                    percent(ap_bev_70_r40)
                ))?;
            }
            report(
                args,
                "eval detector",
                DETECTOR_MODEL,
                frames,
                evaluation.detector,
            )
        }
    }
}

fn report<T: Serialize>(
    args: &EvalArgs,
    command: &str,
    model: &'static str,
    frames: usize,
    figures: Vec<T>,
) -> anyhow::Result<()> {
    let Some(path) = &args.json else {
        return Ok(());
    };
    let rows = figures
        .into_iter()
        .map(|figures| Row {
            model,
            frames,
            figures,
        })
        .collect();
    write_json(path, &Report::new(command, rows))
}
