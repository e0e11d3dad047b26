use anyhow::bail;
use covista_drive::{ClassEvaluation, evaluate_detector};
use covista_perception::{DETECTOR_MODEL, Detector};
use covista_sensors::kitti::{KittiFrame, read_cloud};

use super::{lacking, report, with_bar, without_labels};
use crate::{
    cli::NetworkArgs,
    frames::{detector, recorded_frames},
    output::{prepare_file, say},
    table::{aligned, box_rows},
};

/// `covista eval detector`.
pub(super) fn run(args: &NetworkArgs) -> anyhow::Result<()> {
    let model = args.model.as_deref().unwrap_or(DETECTOR_MODEL);
    let args = &args.recorded;
    if let Some(json) = &args.json {
        prepare_file(json)?;
    }
    let frames = recorded_frames(
        &args.data,
        args.calibration.as_deref(),
        args.labels.as_deref(),
    )?;
    let mut detector = detector(args.models.as_deref(), model)?;
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
    for ClassEvaluation {
        class,
        boxes,
        ap_bev_50_r40,
        ap_bev_70_r40,
    } in &figures.classes
    {
        let percent = |ap: &Option<f64>| ap.map_or("-".into(), |ap| format!("{ap:.1} %"));
        say(&format!(
            "{model} on {} frames{}, {boxes} boxes of class {class:?}: \
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
    report(args, "eval detector", model, &evaluated, rows)
}

/// The boxes found in a single sweep.
fn print_boxes(frame: &KittiFrame, detector: &mut Detector) -> anyhow::Result<()> {
    let Some(path) = &frame.cloud else {
        bail!("the detector needs a point cloud: name a .bin");
    };
    let found = detector.detect(&read_cloud(path)?)?;
    say(aligned(&box_rows(&found)).trim_end())
}
