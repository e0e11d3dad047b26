use std::path::{Path, PathBuf};

use covista_drive::{
    FocusSnapshot, Material, RecordError, RunConfig, RunSummary, Snapshot, TraceRow, Traffic,
    VehicleKind,
};
use covista_perception::lanes::decode::mark_points;
use covista_viewer::{
    FocusFrame, Recording, RunSeries, SceneRecord, SceneryPart, SeenBox, StepRecord, VehicleInfo,
    VehicleSample, VehicleSeries, VehicleStep,
};
use covista_world::{Calibration, ObjectState, Road, Se2Pose, StationId};
use nalgebra::Vector2;

/// Carries the snapshots of a run to its recording and its plots.
pub struct Recorder {
    path: PathBuf,
    scenario: String,
    description: String,
    title: &'static str,
    open: Option<Open>,
}

struct Open {
    recording: Recording,
    road: Road,
    scenery: Vec<SceneryPart>,
    vehicles: Vec<VehicleSeries>,
}

/// What the plots need of a run.
pub struct Recorded {
    /// The road.
    pub road: Road,
    /// What stands beside it.
    pub scenery: Vec<SceneryPart>,
    /// The vehicles over time.
    pub series: RunSeries,
}

impl Recorder {
    /// A recorder into `path`, which is made at the first snapshot.
    pub fn new(path: &Path, config: &RunConfig) -> Self {
        Self {
            path: path.to_owned(),
            scenario: config.scenario.name.clone(),
            description: config.scenario.description.clone(),
            title: if config.sharing {
                "Sharing on"
            } else {
                "Sharing off"
            },
            open: None,
        }
    }

    /// Takes up one snapshot.
    pub fn log(&mut self, snapshot: &Snapshot<'_>) -> Result<(), RecordError> {
        let open = match &mut self.open {
            Some(open) => open,
            None => {
                let scene = self.scene(snapshot);
                self.open.insert(Open {
                    road: scene.road.clone(),
                    scenery: scene.scenery.clone(),
                    vehicles: scene
                        .vehicles
                        .iter()
                        .map(|info| VehicleSeries {
                            info: info.clone(),
                            samples: Vec::new(),
                            lane_change_starts_s: Vec::new(),
                        })
                        .collect(),
                    recording: Recording::create(&self.path, scene)?,
                })
            }
        };
        for (series, row) in open.vehicles.iter_mut().zip(&snapshot.rows) {
            series.samples.push(VehicleSample {
                time_s: row.t_s,
                pose: pose_of(row),
                speed_mps: row.v_mps,
            });
        }
        open.recording.log_step(&step_record(snapshot))?;
        Ok(())
    }

    /// Completes the recording.
    pub fn finish(self, summary: &RunSummary) -> anyhow::Result<Recorded> {
        let Some(mut open) = self.open else {
            anyhow::bail!("the run was shorter than one step; give it a longer --duration");
        };
        open.recording.finish()?;
        for cav in &summary.vehicles {
            if let Some(series) = open.vehicles.iter_mut().find(|v| v.info.id == cav.id) {
                series.lane_change_starts_s.extend(cav.lane_change_start_s);
            }
        }
        Ok(Recorded {
            road: open.road,
            scenery: open.scenery,
            series: RunSeries {
                title: self.title.to_owned(),
                vehicles: open.vehicles,
            },
        })
    }

    fn scene(&self, snapshot: &Snapshot<'_>) -> SceneRecord {
        let traffic = snapshot.traffic;
        let focus = snapshot.focus.as_ref();
        SceneRecord {
            scenario: self.scenario.clone(),
            run: self.title.to_lowercase(),
            description: self.description.clone(),
            road: Road::clone(traffic.road()),
            scenery: scenery(traffic),
            vehicles: traffic
                .vehicles()
                .iter()
                .map(|vehicle| {
                    let (name, kind) = match vehicle.kind {
                        VehicleKind::Cav => ("CAV", covista_viewer::VehicleKind::Cav),
                        VehicleKind::Human => ("human", covista_viewer::VehicleKind::Human),
                        VehicleKind::Obstacle => {
                            ("obstacle", covista_viewer::VehicleKind::Obstacle)
                        }
                    };
                    VehicleInfo {
                        id: vehicle.id.0,
                        label: format!("{name} {}", vehicle.id.0),
                        kind,
                        dimensions: vehicle.dimensions(),
                    }
                })
                .collect(),
            focus: focus.map_or(StationId(0), |focus| focus.station),
            calibration: focus.map_or_else(Calibration::kitti, |focus| *focus.calibration),
        }
    }
}

fn pose_of(row: &TraceRow) -> Se2Pose {
    Se2Pose::new(row.x_m, row.y_m, row.yaw_rad)
}

fn scenery(traffic: &Traffic) -> Vec<SceneryPart> {
    traffic
        .scene()
        .scenery
        .iter()
        .flat_map(|body| &body.parts)
        .map(|part| SceneryPart {
            vertices_m: part.vertices.clone(),
            color: match part.material {
                Material::CarPaint(color)
                | Material::Plaster(color)
                | Material::Cloth(color)
                | Material::Reflector(color) => color,
                Material::Concrete => [150, 150, 145],
                Material::Metal => [120, 125, 130],
                Material::Foliage => [60, 110, 60],
                Material::Glass | Material::Rubber => [50, 55, 60],
            },
        })
        .collect()
}

fn step_record(snapshot: &Snapshot<'_>) -> StepRecord {
    StepRecord {
        time_s: snapshot.time_s,
        vehicles: snapshot.rows.iter().map(vehicle_step).collect(),
        links: snapshot.links.iter().map(|&(a, b)| [a, b]).collect(),
        focus: snapshot
            .focus
            .as_ref()
            .and_then(|focus| focus_frame(snapshot, focus)),
    }
}

fn vehicle_step(row: &TraceRow) -> VehicleStep {
    VehicleStep {
        id: row.id,
        pose: pose_of(row),
        speed_mps: row.v_mps,
        accel_mps2: row.a_mps2,
        lane: row.lane,
        action: row.mapped_action,
        outcome: row.outcome,
        h_m: row.h_m,
        headway_m: row.headway_m,
    }
}

fn focus_frame(snapshot: &Snapshot<'_>, focus: &FocusSnapshot<'_>) -> Option<FocusFrame> {
    let row = snapshot.rows.iter().find(|row| row.id == focus.station.0)?;
    let (frame, marks) = focus.frame.map_or((None, None), |(frame, marks)| {
        (Some(frame), Some(mark_points(&marks.pixels)))
    });
    let own = focus.percepts.iter().map(|percept| SeenBox {
        state: world_state(pose_of(row), percept),
        seen_by: focus.station,
    });
    let own_position = pose_of(row).position();
    let heard = focus.heard.iter().flat_map(|message| {
        message
            .objects
            .iter()
            .map(|object| SeenBox {
                state: carried_on(object, snapshot.time_s),
                seen_by: message.station,
            })
            // Others see the focus CAV, too; its own box would stand around its camera.
            .filter(|seen| (seen.state.center.position() - own_position).norm() > row.length_m)
    });
    Some(FocusFrame {
        pose: pose_of(row),
        image: frame.map(|frame| frame.image.clone()),
        cloud: frame.map(|frame| frame.points.clone()),
        marks,
        boxes: own.chain(heard).collect(),
        tracks: focus.tracks.clone(),
    })
}

fn world_state(own: Se2Pose, percept: &covista_world::Percept) -> ObjectState {
    let detection = &percept.detection;
    ObjectState {
        center: own.compose(Se2Pose::new(
            detection.center_m.x,
            detection.center_m.y,
            detection.yaw_rad,
        )),
        velocity_mps: Vector2::zeros(),
        length_m: detection.size_m.x,
        width_m: detection.size_m.y,
        height_m: detection.size_m.z,
        class: detection.class,
    }
}

fn carried_on(object: &covista_world::PerceivedObject, time_s: f64) -> ObjectState {
    let mut state = object.state;
    let moved = state.velocity_mps * (time_s - object.measured_s);
    state.center.x_m += moved.x;
    state.center.y_m += moved.y;
    state
}
