//! The fusion on frames of a data set: which lane each vehicle is put into, against the truth.

mod figures;
mod geometry;
mod truth;

use covista_perception::{
    Perceiver,
    fusion::fuse,
    ground::Ground,
    lanes::decode::{FoundMarks, MarkPixels},
    lanes::ground::to_lane_marks,
    pointpillars::nms::bev_iou,
};
use covista_sensors::kitti::{KittiFrame, read_cloud};
use covista_sensors::read_tusimple_line;
use covista_world::{Calibration, Detection3d, LaneIndex, Percept, PointCloud, wrap_angle};

pub use figures::{FusionEvaluation, FusionFigures, LaneIndexFigures, Reliability};
pub use geometry::GeometryErrors;

use self::geometry::Deviation;
use self::truth::{SceneTruth, TrueVehicle, read_scene};
use super::{EvaluateError, Evaluated, Progress, file_of};
use crate::recorded::{FittedPicture, calibration_of, with_files};

/// A box is of the vehicle that it overlaps most, seen from above, and at least so much.
const LEAST_IOU: f64 = 0.3;
/// A vehicle is visible that sends back so many of the LIDAR's pulses.
const LEAST_POINTS: usize = 5;
/// A road bends between the own vehicle and another that points away from it by more.
const BENT_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;

/// Where marks or boxes come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// The network.
    Network,
    /// The labels: what fusion makes of it if the network is perfect.
    Exact,
}

/// What fusion said of one vehicle, or of a box where there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Verdict {
    marks: Origin,
    boxes: Origin,
    subject: Subject,
    road: Road,
    in_camera: bool,
    distance_m: f64,
    /// `None` where the vehicle was not found.
    found: Option<Found>,
}

/// Whom it is about.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Subject {
    /// A vehicle in one of the three lanes.
    InLane(LaneIndex),
    /// A vehicle elsewhere: beyond the three lanes, on the shoulder, on the other carriageway.
    Elsewhere,
    /// Nothing: a false box.
    Nothing,
}

/// The road between the own vehicle and another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Road {
    Straight,
    Bent,
    /// At least one of the two marks between the three lanes is not labelled: lanes can't be seen.
    Unmarked,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Found {
    lane: Option<LaneIndex>,
    probability: f64,
}

/// Runs both networks and the fusion on the frames that have all that is needed, once as they are
/// and once with exact marks, exact boxes or both in their place.
///
/// # Errors
/// When there is no such frame, a file is unusable or a network fails.
pub fn evaluate_fusion(
    frames: &[KittiFrame],
    perceiver: &mut Perceiver,
    progress: Progress<'_>,
) -> Result<Evaluated<FusionEvaluation>, EvaluateError> {
    let (usable, lacking) = with_files(
        frames,
        &[
            ("velodyne", |frame| &frame.cloud),
            ("image_2", |frame| &frame.image),
            ("label_2", |frame| &frame.labels),
            ("calib", |frame| &frame.calibration),
            ("lanes", |frame| &frame.lanes),
            ("scenes", |frame| &frame.scene),
        ],
    );
    let (mut verdicts, mut deviations, mut origin) = (Vec::new(), Vec::new(), None);
    for (index, frame) in usable.iter().enumerate() {
        let frame = Frame::read(frame, perceiver)?;
        frame.judge(&mut verdicts, &mut deviations);
        origin.get_or_insert((frame.truth.seed, frame.truth.split));
        progress(index + 1, usable.len());
    }
    let evaluation = FusionEvaluation::new(origin, &verdicts, &deviations);
    Evaluated::new(usable.len(), lacking, evaluation)
}

/// One frame: what the networks find in it and what is there.
struct Frame {
    calibration: Calibration,
    points: PointCloud,
    found_marks: FoundMarks,
    true_marks: MarkPixels,
    found_boxes: Vec<Detection3d>,
    truth: SceneTruth,
}

impl Frame {
    fn read(frame: &KittiFrame, perceiver: &mut Perceiver) -> Result<Self, EvaluateError> {
        let picture = FittedPicture::read(frame, perceiver.image_size_px())?
            .ok_or_else(|| EvaluateError::NoLabelledFrame("its picture is gone".to_owned()))?;
        let mut calibration = calibration_of(frame)?;
        let camera = &mut calibration.intrinsics;
        let across = f64::from(picture.image.width_px) / f64::from(picture.original.width_px);
        let down = f64::from(picture.image.height_px) / f64::from(picture.original.height_px);
        (camera.fx_px, camera.cx_px) = (camera.fx_px * across, camera.cx_px * across);
        (camera.fy_px, camera.cy_px) = (camera.fy_px * down, camera.cy_px * down);
        camera.width_px = picture.image.width_px;
        camera.height_px = picture.image.height_px;
        let points = read_cloud(file_of(&frame.cloud)?)?;
        let labels = file_of(&frame.lanes)?;
        let text =
            std::fs::read_to_string(labels).map_err(|error| EvaluateError::file(labels, error))?;
        let true_marks = read_tusimple_line(&text, |pixel| picture.in_network(pixel))
            .map_err(|reason| EvaluateError::file(labels, reason))?;
        Ok(Self {
            found_marks: perceiver.find_marks(&picture.image)?,
            true_marks,
            found_boxes: perceiver.detect(&points)?,
            truth: read_scene(frame, &calibration)?,
            calibration,
            points,
        })
    }

    fn judge(&self, verdicts: &mut Vec<Verdict>, deviations: &mut Vec<Deviation>) {
        let ground = Ground::fit(&self.points, &self.calibration);
        let visible: Vec<&TrueVehicle> = self
            .truth
            .vehicles
            .iter()
            .filter(|vehicle| vehicle.lidar_points >= LEAST_POINTS)
            .collect();
        let exact_boxes: Vec<Detection3d> = visible.iter().map(|vehicle| vehicle.body).collect();
        // Whose each box is: of the vehicles in order, hidden ones after the visible.
        let hidden = self.truth.vehicles.iter();
        let hidden = hidden.filter(|vehicle| vehicle.lidar_points < LEAST_POINTS);
        let all: Vec<&TrueVehicle> = visible.iter().copied().chain(hidden).collect();
        let owners = owners(&self.found_boxes, &all);
        for (marks, found) in [
            (Origin::Network, self.found_marks),
            (Origin::Exact, self.true_marks.into()),
        ] {
            let lane_marks = to_lane_marks(&found, &ground, &self.calibration);
            let percepts =
                |boxes: &[Detection3d]| fuse(&lane_marks, boxes, &self.calibration).percepts;
            let exact = percepts(&exact_boxes);
            let by_network = percepts(&self.found_boxes);
            let mut add = |boxes: Origin, subject, percept: Option<&Percept>, at: &Place| {
                verdicts.push(Verdict {
                    marks,
                    boxes,
                    subject,
                    road: at.road,
                    in_camera: at.in_camera,
                    distance_m: at.distance_m,
                    found: percept.map(|percept| Found {
                        lane: percept.lane,
                        probability: percept.lane_probability,
                    }),
                });
            };
            for (index, vehicle) in visible.iter().enumerate() {
                let place = self.place(&vehicle.body);
                let subject = vehicle.lane.map_or(Subject::Elsewhere, Subject::InLane);
                add(Origin::Exact, subject, exact.get(index), &place);
                let own = owners.iter().position(|owner| *owner == Some(index));
                let percept = own.and_then(|own| by_network.get(own));
                add(Origin::Network, subject, percept, &place);
                if marks == Origin::Network
                    && let (Some(percept), Some(angles)) = (percept, vehicle.angles)
                {
                    deviations.push(Deviation {
                        true_distance_m: place.distance_m,
                        distance_m: percept.distance_m - place.distance_m,
                        observation_angle_rad: wrap_angle(
                            percept.observation_angle_rad - angles.alpha_rad,
                        ),
                        rotation_y_rad: wrap_angle(percept.rotation_y_rad - angles.rotation_y_rad),
                    });
                }
            }
            for ((body, owner), percept) in self.found_boxes.iter().zip(&owners).zip(&by_network) {
                if owner.is_none() {
                    let place = self.place(body);
                    add(Origin::Network, Subject::Nothing, Some(percept), &place);
                }
            }
        }
    }

    fn place(&self, body: &Detection3d) -> Place {
        let camera = &self.calibration.intrinsics;
        let center = self.calibration.camera_from_lidar() * nalgebra::Point3::from(body.center_m);
        let in_camera = camera
            .project(&center)
            .is_some_and(|[u, _]| (0.0..f64::from(camera.width_px)).contains(&u));
        let between_lanes = [1, 2].map(|mark: usize| &self.true_marks[mark]);
        let is_marked = between_lanes
            .iter()
            .all(|mark| mark.iter().any(Option::is_some));
        let turned_rad = body.yaw_rad.sin().atan2(body.yaw_rad.cos().abs());
        Place {
            road: match turned_rad.abs() {
                _ if !is_marked => Road::Unmarked,
                turned if turned > BENT_RAD => Road::Bent,
                _ => Road::Straight,
            },
            in_camera,
            distance_m: body.center_m.xy().norm(),
        }
    }
}

struct Place {
    road: Road,
    in_camera: bool,
    distance_m: f64,
}

/// For each box the vehicle that it is of, the surest box first.
fn owners(boxes: &[Detection3d], vehicles: &[&TrueVehicle]) -> Vec<Option<usize>> {
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    order.sort_by(|&a, &b| boxes[b].score.total_cmp(&boxes[a].score));
    let mut owners = vec![None; boxes.len()];
    let mut taken = vec![false; vehicles.len()];
    for index in order {
        let overlaps = vehicles
            .iter()
            .enumerate()
            .filter(|(vehicle, _)| !taken[*vehicle]);
        let best = overlaps
            .map(|(vehicle, truth)| (vehicle, bev_iou(&boxes[index], &truth.body)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((vehicle, iou)) = best
            && iou >= LEAST_IOU
        {
            taken[vehicle] = true;
            owners[index] = Some(vehicle);
        }
    }
    owners
}

#[cfg(test)]
mod tests;
