//! What both networks and their fusion do to vehicles that are there: the measurements that the
//! statistical error model is fitted to and compared with.

mod compare;
mod fit;
mod lasting;
mod matching;

use covista_perception::Perceiver;
use covista_sensors::kitti::{KittiFrame, read_cloud, read_rig};
use covista_sensors::{
    ErrorModel, Observer, RayScene, SceneFile, SeenVehicle, Viewpoint, read_scene, seen_vehicles,
};
use covista_traffic::{VehicleId, VehicleKind};
use covista_world::{Calibration, Detection3d, LaneIndex, Percept, Se2Pose, SensorFrame};
use nalgebra::{Point3, Vector3};

pub use compare::{ErrorFigures, figures_by_distance};
pub use fit::{FitError, fit_errors};

use super::{EvaluateError, Evaluated, Progress, file_of};
use crate::Networks;
use crate::recorded::{FittedPicture, Lacking, with_files};
use crate::run::{RunConfig, RunError, run};
use crate::senses::Senses;
use crate::snapshot::Snapshot;
use matching::matched;

/// A box that was found, in the LIDAR frame, and the lane that it was given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundBox {
    /// The box.
    pub detection: Detection3d,
    /// Its lane.
    pub lane: Option<LaneIndex>,
}

/// The truth and what was found of it in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorFrame {
    /// Who looked.
    pub ego: VehicleId,
    /// When, in seconds.
    pub time_s: f64,
    /// From where: the LIDAR in the world.
    pub lidar: Se2Pose,
    /// The vehicles that are there.
    pub truth: Vec<SeenVehicle>,
    /// What was found.
    pub found: Vec<FoundBox>,
}

/// Frames with the detector's range that they were perceived in.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorFrames {
    /// Least x and y, greatest x and y in the LIDAR frame, in metres.
    pub range_m: [f64; 4],
    /// The frames, those of one ego in the order of time.
    pub frames: Vec<ErrorFrame>,
}

/// The data set that frames are from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DataOrigin {
    /// Its seed.
    pub seed: u64,
    /// Its split.
    pub split: String,
}

/// A vehicle that counts, and its box where it was found.
#[derive(Clone, Copy)]
struct Sample<'a> {
    frame: &'a ErrorFrame,
    truth: &'a SeenVehicle,
    found: Option<&'a FoundBox>,
}

impl ErrorFrames {
    /// The same frames as `model` would find them, `times` over, each with draws of its own.
    pub fn drawn(&self, model: &ErrorModel, times: u64) -> Self {
        let drawn = (0..times).flat_map(|time| {
            self.frames.iter().map(move |frame| {
                let from = Observer {
                    seed: time,
                    ego: frame.ego,
                    time_s: frame.time_s,
                    lidar: frame.lidar,
                    road: None,
                };
                let found = model.draw(&frame.truth, &from).into_iter();
                ErrorFrame {
                    found: found
                        .map(|drawn| FoundBox {
                            detection: drawn.detection,
                            lane: drawn.lane,
                        })
                        .collect(),
                    ..frame.clone()
                }
            })
        });
        Self {
            range_m: self.range_m,
            frames: drawn.collect(),
        }
    }

    /// The vehicles in range and in sight, and the false boxes, each with its frame.
    fn sorted(&self) -> (Vec<Sample<'_>>, Vec<(&ErrorFrame, &FoundBox)>) {
        let (mut samples, mut false_boxes) = (Vec::new(), Vec::new());
        let [least_x, least_y, most_x, most_y] = self.range_m;
        for frame in &self.frames {
            let (of_truth, unmatched) = matched(&frame.truth, &frame.found);
            let vehicles = frame.truth.iter().zip(of_truth);
            let counts = |truth: &SeenVehicle| {
                truth.visibility > 0.0
                    && (least_x..=most_x).contains(&truth.truth.center_m.x)
                    && (least_y..=most_y).contains(&truth.truth.center_m.y)
            };
            samples.extend(
                vehicles
                    .filter(|(truth, _)| counts(truth))
                    .map(|(truth, found)| Sample {
                        frame,
                        truth,
                        found,
                    }),
            );
            false_boxes.extend(unmatched.into_iter().map(|found| (frame, found)));
        }
        (samples, false_boxes)
    }
}

/// Runs both networks on the frames of a data set that `covista dataset` wrote: those of roads with
/// painted lanes, as scenarios have them. Streets without are left out, with their parked cars in
/// both directions and lanes that nobody can tell.
///
/// # Errors
/// When no frame has all that is needed, a file is unusable or a network fails.
pub fn perceive_dataset(
    frames: &[KittiFrame],
    perceiver: &mut Perceiver,
    progress: Progress<'_>,
) -> Result<Evaluated<(ErrorFrames, DataOrigin)>, EvaluateError> {
    let (usable, mut lacking) = with_files(
        frames,
        &[
            ("velodyne", |frame| &frame.cloud),
            ("image_2", |frame| &frame.image),
            ("calib", |frame| &frame.calibration),
            ("scenes", |frame| &frame.scene),
        ],
    );
    let mut origin = DataOrigin {
        seed: 0,
        split: String::new(),
    };
    let mut perceived = Vec::new();
    let mut unmarked = 0;
    for (index, frame) in usable.iter().enumerate() {
        let SceneFile {
            seed,
            split,
            marked,
            vehicles,
        } = read_scene(file_of(&frame.scene)?)?;
        progress(index + 1, usable.len());
        if !marked {
            unmarked += 1;
            continue;
        }
        let calibration = read_rig(file_of(&frame.calibration)?)?;
        let Some(picture) = FittedPicture::read(frame, perceiver.image_size_px())? else {
            continue;
        };
        let measured = SensorFrame {
            time_s: 0.0,
            image: picture.image,
            points: read_cloud(file_of(&frame.cloud)?)?,
        };
        let percepts = perceiver.perceive(&measured, &calibration)?.percepts;
        perceived.push(ErrorFrame {
            ego: VehicleId(index as u32),
            time_s: 0.0,
            lidar: Se2Pose::default(),
            truth: vehicles.into_iter().map(|vehicle| vehicle.seen).collect(),
            found: in_lidar(&percepts, &calibration),
        });
        origin = DataOrigin { seed, split };
    }
    if unmarked > 0 {
        lacking.push(Lacking {
            file: "marks between the lanes",
            frames: unmarked,
        });
    }
    let range_m = flat(perceiver.range_m());
    let frames = ErrorFrames {
        range_m,
        frames: perceived,
    };
    Evaluated::new(frames.frames.len(), lacking, (frames, origin))
}

/// Drives a scenario on exact percepts, and runs both networks on what every CAV measures at each
/// of its frames.
///
/// # Errors
/// When the scenario is unusable or a network fails.
pub fn perceive_scenario(
    config: &RunConfig,
    networks: Networks,
    progress: &dyn Fn(f64),
) -> Result<ErrorFrames, RunError> {
    let range_m = flat(networks.range_m());
    let calibration = Calibration::kitti();
    let mut senses = Senses::Network(networks);
    let mut frames: Vec<ErrorFrame> = Vec::new();
    run(config, &mut Senses::Truth, &mut |snapshot: &Snapshot<
        '_,
    >| {
        progress(snapshot.time_s);
        if snapshot.focus.is_none() {
            return Ok(());
        }
        let scene = snapshot.traffic.scene();
        let rays = RayScene::new(&scene);
        let cavs: Vec<VehicleId> = snapshot
            .rows
            .iter()
            .filter(|row| row.kind == VehicleKind::Cav)
            .map(|row| VehicleId(row.id))
            .collect();
        let (sensed, _) = senses.perceive(&scene, &rays, &calibration, &cavs, config.seed)?;
        for (cav, sensed) in cavs.into_iter().zip(sensed) {
            let Some(view) = Viewpoint::new(&scene, &rays, cav, &calibration) else {
                continue;
            };
            let mount = calibration.vehicle_from_lidar.translation.vector;
            frames.push(ErrorFrame {
                ego: cav,
                time_s: scene.time_s,
                lidar: (view.ego.state.pose).compose(Se2Pose::new(mount.x, mount.y, 0.0)),
                truth: seen_vehicles(&view, EVERYWHERE_M),
                found: in_lidar(&sensed.percepts, &calibration),
            });
        }
        Ok(())
    })?;
    // Those of one ego on end.
    frames.sort_by(|a, b| a.ego.cmp(&b.ego).then(a.time_s.total_cmp(&b.time_s)));
    Ok(ErrorFrames { range_m, frames })
}

const EVERYWHERE_M: [f64; 4] = [-1e4, -1e4, 1e4, 1e4];

/// A detector's range, seen from above.
fn flat(range_m: [f32; 6]) -> [f64; 4] {
    let [least_x, least_y, _, most_x, most_y, _] = range_m.map(f64::from);
    [least_x, least_y, most_x, most_y]
}

/// Percepts of the vehicle frame back in the LIDAR's.
fn in_lidar(percepts: &[Percept], calibration: &Calibration) -> Vec<FoundBox> {
    let lidar_from_vehicle = calibration.vehicle_from_lidar.inverse();
    let back = |percept: &Percept| {
        let found = &percept.detection;
        let (sin, cos) = found.yaw_rad.sin_cos();
        let heading = lidar_from_vehicle * Vector3::new(cos, sin, 0.0);
        FoundBox {
            detection: Detection3d {
                center_m: (lidar_from_vehicle * Point3::from(found.center_m)).coords,
                yaw_rad: heading.y.atan2(heading.x),
                ..*found
            },
            lane: percept.lane,
        }
    };
    percepts.iter().map(back).collect()
}
