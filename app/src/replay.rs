use std::{
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::bail;
use covista_drive::{FittedPicture, calibration_of};
use covista_perception::{Perceiver, lanes::decode::mark_points};
use covista_sensors::kitti::{KittiFrame, read_cloud};
use covista_viewer::{FocusFrame, FrameRecording, SeenBox, open_viewer};
use covista_world::{Calibration, Detection3d, ObjectClass, ObjectState, Se2Pose, StationId};
use nalgebra::{Point3, Vector2};

use crate::{
    cli::{DemoArgs, PerceptionArg},
    dataset::frame_bar,
    frames::{perceiver, recorded_frames},
    output::{prepare_folder, say},
    table::aligned,
};

const RECORDING: &str = "frames.rrd";
/// More rows than this say no more to anybody.
const MOST_ROWS: usize = 20;

/// Whether the demo's argument names recorded frames and no scenario.
pub fn is_recorded(name: &str) -> bool {
    let path = Path::new(name);
    path.is_dir()
        || [".bin", ".png", ".jpg"]
            .iter()
            .any(|end| name.ends_with(end))
}

/// `covista demo PATH`: the networks on recorded frames.
pub fn run(args: &DemoArgs) -> anyhow::Result<()> {
    let path = Path::new(&args.scenario);
    if args.perception != PerceptionArg::Network
        || args.duration.is_some()
        || args.trace.is_some()
        || args.errors.is_some()
    {
        bail!(
            "--perception truth or statistical, --errors, --duration and --trace are for \
             scenarios, and {} is recorded",
            path.display()
        );
    }
    let frames = recorded_frames(path, args.calibration.as_deref(), None)?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let out = args.out.clone().unwrap_or_else(|| match &*name {
        "" => PathBuf::from("out/frames"),
        name => Path::new("out").join(name),
    });
    prepare_folder(&out)?;
    let mut perceiver = perceiver(args.models.as_deref(), args.provider)?;
    let rrd = out.join(RECORDING);
    let mut recording = FrameRecording::create(&rrd, &name)?;
    let mut rows = vec![
        [
            "frame",
            "marks",
            "cars",
            "trucks",
            "nearest_m",
            "lanes_ms",
            "detector_ms",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    let bar = frame_bar();
    bar.set_length(frames.len() as u64);
    for frame in &frames {
        let seen = Seen::new(frame, &mut perceiver)?;
        recording.log(&seen.recorded, &seen.calibration, OWN)?;
        rows.push(seen.row(&frame.name));
        bar.inc(1);
    }
    bar.finish_and_clear();
    recording.finish()?;
    let more = rows.len().saturating_sub(MOST_ROWS + 1);
    rows.truncate(MOST_ROWS + 1);
    say(aligned(&rows).trim_end())?;
    if more > 0 {
        say(&format!("and {more} frames more"))?;
    }
    say(&format!("written to {}", rrd.display()))?;
    if args.view {
        open_viewer(&[rrd])?;
    }
    Ok(())
}

/// The recorded vehicle.
const OWN: StationId = StationId(0);

/// A frame and what the networks see in it.
struct Seen {
    calibration: Calibration,
    recorded: FocusFrame,
    /// Wall time of each network that had something to see, in milliseconds.
    lanes_ms: Option<f64>,
    detector_ms: Option<f64>,
}

impl Seen {
    fn new(frame: &KittiFrame, perceiver: &mut Perceiver) -> anyhow::Result<Self> {
        let mut seen = Self {
            calibration: calibration_of(frame)?,
            recorded: FocusFrame::default(),
            lanes_ms: None,
            detector_ms: None,
        };
        if let Some(picture) = FittedPicture::read(frame, perceiver.image_size_px())? {
            let began = Instant::now();
            let pixels = perceiver.find_marks(&picture.image)?.pixels;
            seen.lanes_ms = Some(1e3 * began.elapsed().as_secs_f64());
            let in_file = |points: Vec<[f64; 2]>| {
                let points = points.into_iter();
                points.filter_map(|point| picture.in_file(point)).collect()
            };
            seen.recorded.marks = Some(mark_points(&pixels).map(in_file));
            // KITTI's text doesn't say how large its pictures are.
            seen.calibration.intrinsics.width_px = picture.original.width_px;
            seen.calibration.intrinsics.height_px = picture.original.height_px;
            seen.recorded.image = Some(picture.original);
        }
        if let Some(path) = &frame.cloud {
            let cloud = read_cloud(path)?;
            let began = Instant::now();
            let found = perceiver.detect(&cloud)?;
            seen.detector_ms = Some(1e3 * began.elapsed().as_secs_f64());
            let in_vehicle = found.iter().map(|found| SeenBox {
                state: in_vehicle(found, &seen.calibration),
                seen_by: OWN,
            });
            seen.recorded.boxes = in_vehicle.collect();
            seen.recorded.cloud = Some(cloud);
        }
        Ok(seen)
    }

    fn row(&self, name: &str) -> Vec<String> {
        let states = || self.recorded.boxes.iter().map(|seen| &seen.state);
        let count = |class| states().filter(|state| state.class == class).count();
        let nearest_m = states()
            .map(|state| state.center.position().norm())
            .min_by(f64::total_cmp);
        let marks = self
            .recorded
            .marks
            .as_ref()
            .map(|marks| marks.iter().filter(|mark| mark.len() >= 2).count());
        let number =
            |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.1}"));
        let counted = |class| match self.recorded.cloud {
            Some(_) => count(class).to_string(),
            None => "-".to_owned(),
        };
        vec![
            name.to_owned(),
            marks.map_or("-".to_owned(), |marks| marks.to_string()),
            counted(ObjectClass::Car),
            counted(ObjectClass::Truck),
            number(nearest_m),
            number(self.lanes_ms),
            number(self.detector_ms),
        ]
    }
}

/// A box in the LIDAR frame, standing still in the vehicle frame.
fn in_vehicle(found: &Detection3d, calibration: &Calibration) -> ObjectState {
    let center = calibration.vehicle_from_lidar * Point3::from(found.center_m);
    ObjectState {
        center: Se2Pose::new(center.x, center.y, found.yaw_rad),
        velocity_mps: Vector2::zeros(),
        length_m: found.size_m.x,
        width_m: found.size_m.y,
        height_m: found.size_m.z,
        class: found.class,
    }
}
