use anyhow::bail;
use covista_drive::{FittedPicture, evaluate_lanes};
use covista_perception::{LANE_MODEL, LaneFinder};
use covista_sensors::kitti::KittiFrame;
use covista_world::ROW_ANCHORS;

use super::{frames_of, lacking, report, with_bar, without_labels};
use crate::{cli::NetworkArgs, frames::lane_finder, output::say, table::aligned};

/// `covista eval lanes`.
pub(super) fn run(args: &NetworkArgs) -> anyhow::Result<()> {
    let model = args.model.as_deref().unwrap_or(LANE_MODEL);
    let args = &args.recorded;
    let frames = frames_of(args)?;
    let mut finder = lane_finder(args.models.as_deref(), model, args.provider)?;
    if let [frame] = &*frames
        && args.data.is_file()
    {
        print_marks(frame, &mut finder)?;
        if frame.lanes.is_none() {
            return without_labels(args, "lanes");
        }
    }
    let evaluated = with_bar(|progress| evaluate_lanes(&frames, &mut finder, progress))?;
    let figures = &evaluated.figures;
    say(&format!(
        "{model} on {} frames{}: TuSimple accuracy {:.2} %, UFLD's variant {:.2} %, the paper's \
         {:.2} %; false positives {:.2} %, false negatives {:.2} %",
        evaluated.frames,
        lacking(&evaluated.lacking),
        figures.accuracy_tusimple,
        figures.accuracy_ufld,
        figures.accuracy_paper,
        figures.false_positive,
        figures.false_negative
    ))?;
    let rows = vec![figures.clone()];
    let model = (model, finder.provider());
    report(args, "eval lanes", model, &evaluated, rows)
}

/// The marks found in a single picture, as its own pixels.
fn print_marks(frame: &KittiFrame, finder: &mut LaneFinder) -> anyhow::Result<()> {
    let Some(picture) = FittedPicture::read(frame, finder.image_size_px())? else {
        bail!("the lane network needs a picture: name a .png or .jpg");
    };
    let marks = finder.find_marks(&picture.image)?.pixels;
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
