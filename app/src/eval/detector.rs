use anyhow::bail;
use covista_drive::{Bar, ClassEvaluation, evaluate_detector};
use covista_perception::{DETECTOR_MODEL, Detector};
use covista_sensors::kitti::{KittiFrame, read_cloud};

use super::{frames_of, lacking, report, with_bar, without_labels};
use crate::{
    cli::NetworkArgs,
    frames::detector,
    output::say,
    table::{aligned, box_rows, optional},
};

/// `covista eval detector`.
pub(super) fn run(args: &NetworkArgs) -> anyhow::Result<()> {
    let model = args.model.as_deref().unwrap_or(DETECTOR_MODEL);
    let args = &args.recorded;
    let frames = frames_of(args)?;
    let mut detector = detector(args.models.as_deref(), model, args.provider)?;
    if let [frame] = &*frames
        && args.data.is_file()
    {
        print_boxes(frame, &mut detector)?;
        if frame.labels.is_none() {
            return without_labels(args, "labels");
        }
        if frame.calibration.is_none() {
            bail!("labels are in the camera's frame: name the --calibration, too");
        }
    }
    let evaluated = with_bar(|progress| evaluate_detector(&frames, &mut detector, progress))?;
    let figures = &evaluated.figures;
    for of in &figures.classes {
        say(&format!(
            "{model} on {} frames{}, {} boxes of class {:?}: \
             AP (BEV, R40) {} % at IoU 0.5, {} % at IoU 0.7",
            evaluated.frames,
            lacking(&evaluated.lacking),
            of.boxes,
            of.class,
            optional(of.ap_bev_50_r40, 1),
            optional(of.ap_bev_70_r40, 1)
        ))?;
        if of.boxes + of.hardness.labelled == 0 {
            continue;
        }
        for table in [benchmark_rows(of), recall_rows(of), hardness_rows(of)] {
            say(aligned(&table).trim_end())?;
        }
        let at = &of.operating_point;
        say(&format!(
            "from a score of {}: precision {} %, {:.2} false boxes a frame, mean BEV IoU {}, {} % \
             of the headings flipped",
            at.score_threshold,
            optional(at.precision, 1),
            at.false_per_frame,
            optional(at.mean_bev_iou, 3),
            optional(at.flipped_headings, 1)
        ))?;
    }
    if figures.picture_only {
        say("all labels lie before the camera: boxes found outside the picture are left out")?;
    }
    let rows = figures.classes.clone();
    let model = (model, detector.provider());
    report(args, "eval detector", model, &evaluated, rows)
}

/// KITTI's average precisions, by difficulty.
fn benchmark_rows(of: &ClassEvaluation) -> Vec<Vec<String>> {
    const LEVELS: [&str; 3] = ["easy", "moderate", "hard"];
    let class = format!("{:?}", of.class).to_lowercase();
    let boxes = LEVELS.map(|level| of.kitti_boxes.get(&format!("boxes_{level}")));
    let boxes = boxes.map(|boxes| boxes.copied().unwrap_or(0).to_string());
    let mut rows = vec![
        row(
            "KITTI, in the picture",
            LEVELS.map(str::to_owned).into_iter(),
        ),
        row("boxes", boxes.into_iter()),
    ];
    for (view, view_name) in [("3d", "3D"), ("bev", "BEV")] {
        for (suffix, iou) in [("", "0.7"), ("_iou50", "0.5")] {
            for samples in [40, 11] {
                let values = LEVELS.map(|level| {
                    let key = format!("ap_{view}_{class}_{level}_r{samples}{suffix}");
                    optional(of.kitti.get(&key).copied().flatten(), 1)
                });
                let name = format!("AP {view_name} IoU {iou} R{samples}, %");
                rows.push(row(&name, values.into_iter()));
            }
        }
    }
    rows
}

/// Recall at the score threshold, by distance and by occlusion.
fn recall_rows(of: &ClassEvaluation) -> Vec<Vec<String>> {
    let at = &of.operating_point;
    let bars = || {
        at.recall_by_distance_m
            .iter()
            .chain(&at.recall_by_occlusion)
    };
    let spans = at
        .recall_by_distance_m
        .iter()
        .map(|bar| span(bar.from, Some(bar.below), " m"));
    let levels = at
        .recall_by_occlusion
        .iter()
        .map(|bar| format!("occluded {}", bar.from));
    vec![
        row("all around", spans.chain(levels)),
        row("vehicles", bars().map(|bar| bar.boxes.to_string())),
        row("recall, %", bars().map(|bar| optional(bar.recall, 1))),
    ]
}

/// The labels in the picture, by distance, occlusion and points.
fn hardness_rows(of: &ClassEvaluation) -> Vec<Vec<String>> {
    let hardness = &of.hardness;
    let histogram = |name: &str, bars: &[Bar], unit: &str| {
        [
            row(name, bars.iter().map(|bar| span(bar.from, bar.below, unit))),
            row(
                "  labels, %",
                bars.iter().map(|bar| optional(bar.percent, 1)),
            ),
        ]
    };
    [
        histogram("in the picture", &hardness.labelled_by_distance_m, " m"),
        histogram("  occluded", &hardness.labelled_by_occlusion, ""),
        histogram("  points", &hardness.labelled_by_points, ""),
    ]
    .concat()
}

fn row(name: &str, cells: impl Iterator<Item = String>) -> Vec<String> {
    std::iter::once(name.to_owned()).chain(cells).collect()
}

/// `10-20 m`, `70- m`; `2` where nothing lies between.
fn span(from: u32, below: Option<u32>, unit: &str) -> String {
    match below {
        Some(below) if below == from + 1 => format!("{from}{unit}"),
        Some(below) => format!("{from}-{below}{unit}"),
        None => format!("{from}-{unit}"),
    }
}

/// The boxes found in a single sweep.
fn print_boxes(frame: &KittiFrame, detector: &mut Detector) -> anyhow::Result<()> {
    let Some(path) = &frame.cloud else {
        bail!("the detector needs a point cloud: name a .bin");
    };
    let found = detector.detect(&read_cloud(path)?)?;
    say(aligned(&box_rows(&found)).trim_end())
}
