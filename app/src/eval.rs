use anyhow::bail;
use covista_drive::{
    ClassEvaluation, Evaluated, FittedPicture, Lacking, evaluate_detector, evaluate_lanes,
};
use covista_perception::{DETECTOR_MODEL, LANE_MODEL, Perceiver};
use covista_sensors::kitti::{KittiFrame, read_cloud};
use covista_world::ROW_ANCHORS;
use serde::Serialize;

use crate::{
    cli::{EvalArgs, EvalWhat},
    dataset::frame_bar,
    frames::{perceiver, recorded_frames},
    output::{Report, prepare_file, say, write_json},
    table::{aligned, box_rows},
};

/// A row of `--json`: the model, the frames, and its figures.
#[derive(Serialize)]
struct Row<T> {
    model: &'static str,
    frames: usize,
    lacking: Vec<Lacking>,
    #[serde(flatten)]
    figures: T,
}

/// `covista eval`.
pub fn run(args: &EvalArgs) -> anyhow::Result<()> {
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let frames = recorded_frames(
        &args.data,
        args.calibration.as_deref(),
        args.labels.as_deref(),
    )?;
    let mut perceiver = perceiver(args.models.as_deref())?;
    let is_single = args.data.is_file();
    match (args.what, &*frames) {
        (EvalWhat::Lanes, [frame]) if is_single => {
            print_marks(frame, &mut perceiver)?;
            if frame.lanes.is_none() {
                return without_labels(args, "lanes");
            }
        }
        (EvalWhat::Detector, [frame]) if is_single => {
            print_boxes(frame, &mut perceiver)?;
            if frame.labels.is_none() {
                return without_labels(args, "labels");
            }
            if frame.calibration.is_none() {
                bail!("labels are in the camera's frame: name the --calibration, too");
            }
        }
        _ => {}
    }
    match args.what {
        EvalWhat::Lanes => lanes(args, &frames, &mut perceiver),
        EvalWhat::Detector => detector(args, &frames, &mut perceiver),
    }
}

fn without_labels(args: &EvalArgs, what: &str) -> anyhow::Result<()> {
    if args.json.is_some() {
        bail!("--json holds figures, and there are no {what} beside the file to take them on");
    }
    Ok(())
}

fn lanes(args: &EvalArgs, frames: &[KittiFrame], perceiver: &mut Perceiver) -> anyhow::Result<()> {
    let bar = frame_bar();
    let evaluated = evaluate_lanes(frames, perceiver, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let figures = &evaluated.figures;
    say(&format!(
        "{LANE_MODEL} on {} frames{}: TuSimple accuracy {:.2} %, UFLD's variant {:.2} %",
        evaluated.frames,
        lacking(&evaluated.lacking),
        figures.accuracy_tusimple,
        figures.accuracy_ufld
    ))?;
    let rows = vec![figures.clone()];
    report(args, "eval lanes", LANE_MODEL, &evaluated, rows)
}

fn detector(
    args: &EvalArgs,
    frames: &[KittiFrame],
    perceiver: &mut Perceiver,
) -> anyhow::Result<()> {
    let bar = frame_bar();
    let evaluated = evaluate_detector(frames, perceiver, &|done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    let figures = &evaluated.figures;
    for ClassEvaluation {
        class,
        boxes,
        ap_bev_50_r40,
        ap_bev_70_r40,
    } in &figures.classes
    {
        let percent = |ap: &Option<f64>| ap.map_or("-".into(), |ap| format!("{ap:.1} %"));
        say(&format!(
            "{DETECTOR_MODEL} on {} frames{}, {boxes} boxes of class {class:?}: \
             AP (BEV, R40) {} at IoU 0.5, {} at IoU 0.7",
            evaluated.frames,
            lacking(&evaluated.lacking),
            percent(ap_bev_50_r40),
            percent(ap_bev_70_r40)
        ))?;
    }
    if figures.picture_only {
        say("all labels lie before the camera: boxes found outside the picture are left out")?;
    }
    let rows = figures.classes.clone();
    report(args, "eval detector", DETECTOR_MODEL, &evaluated, rows)
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

/// The boxes found in a single sweep.
fn print_boxes(frame: &KittiFrame, perceiver: &mut Perceiver) -> anyhow::Result<()> {
    let Some(path) = &frame.cloud else {
        bail!("the detector needs a point cloud: name a .bin");
    };
    let found = perceiver.detect(&read_cloud(path)?)?;
    say(aligned(&box_rows(&found)).trim_end())
}

/// The marks found in a single picture, as its own pixels.
fn print_marks(frame: &KittiFrame, perceiver: &mut Perceiver) -> anyhow::Result<()> {
    let Some(picture) = FittedPicture::read(frame, perceiver.image_size_px())? else {
        bail!("the lane network needs a picture: name a .png or .jpg");
    };
    let marks = perceiver.find_marks(&picture.image)?;
    let mut rows = vec![Vec::new()];
    rows[0].extend((0..marks.len()).map(|mark| format!("mark_{mark}_px")));
    for (index, anchor) in ROW_ANCHORS.iter().enumerate() {
        let places = marks.iter().map(|mark| {
            let u_px = f64::from(mark[index]?);
            picture.in_file([u_px, f64::from(anchor.0)])
        });
        let said = |place: Option<[f64; 2]>| {
            place.map_or("-".to_owned(), |[u, v]| format!("{u:.1},{v:.1}"))
        };
        rows.push(places.map(said).collect());
    }
    say(aligned(&rows).trim_end())
}

fn report<T: Serialize, F>(
    args: &EvalArgs,
    command: &str,
    model: &'static str,
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
            frames: evaluated.frames,
            lacking: evaluated.lacking.clone(),
            figures,
        })
        .collect();
    write_json(path, &Report::new(command, rows))
}
