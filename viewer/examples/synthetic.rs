//! Writes a made-up run, recording and plots, to a folder: for work on the viewer alone.
//!
//! `cargo run --release -p covista-viewer --example synthetic -- FOLDER`

use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::{Path, PathBuf};

use covista_viewer::{
    FocusFrame, Recording, RunSeries, SceneRecord, SceneryPart, SeenBox, StepRecord, VehicleInfo,
    VehicleKind, VehicleSample, VehicleSeries, VehicleStep, ViewerError, plot_speeds,
    plot_trajectories,
};
use covista_world::{
    Action, Calibration, CameraImage, FilterOutcome, MARK_COUNT, ObjectClass, ObjectState,
    PointCloud, ROW_ANCHORS, Road, RoadError, RoadSegment, Se2Pose, Sighting, StationId, Track,
    VehicleDimensions, wrap_angle,
};
use nalgebra::{Point3, Vector2};

const SEDAN: VehicleDimensions = VehicleDimensions {
    length_m: 4.6,
    width_m: 1.85,
    height_m: 1.5,
    wheelbase_m: 2.7,
    rear_overhang_m: 0.95,
};
const FOCUS: StationId = StationId(2);
const OBSTACLE_S_M: f64 = 265.0;
const WALL_D_M: f64 = 6.2;

#[derive(Debug, thiserror::Error)]
enum Error {
    #[error(transparent)]
    Road(#[from] RoadError),
    #[error(transparent)]
    Viewer(#[from] ViewerError),
}

fn main() -> Result<(), Error> {
    let folder = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| ".".to_owned()));
    let arc = |length_m| RoadSegment::Arc {
        length_m,
        curvature_per_m: 1.0 / 80.0,
    };
    let straight = RoadSegment::Straight { length_m: 200.0 };
    let road = Road::new(
        Se2Pose::default(),
        &[
            straight,
            arc(100.0),
            RoadSegment::Straight { length_m: 120.0 },
        ],
        3.5,
    )?;
    let runs: Vec<_> = [true, false].map(|sharing| run(&road, sharing)).into();
    let scenery = wall(&road);
    plot_trajectories(&folder.join("trajectories.png"), &road, &scenery, &runs)?;
    plot_speeds(&folder.join("speeds.png"), &runs)?;
    record(&folder.join("synthetic.rrd"), road, scenery, &runs[0])?;
    Ok(())
}

fn wall(road: &Road) -> Vec<SceneryPart> {
    let part = |from_s: f64, to_s: f64, d: [f64; 2], height_m: f64, color| {
        let base = [(from_s, d[0]), (from_s, d[1]), (to_s, d[1]), (to_s, d[0])];
        SceneryPart {
            vertices_m: [0.0, height_m]
                .iter()
                .flat_map(|&z| base.map(|(s, d)| (s, d, z)))
                .map(|(s, d, z)| {
                    let pose = road.pose_from_frenet(s, d, 0.0);
                    Point3::new(pose.x_m, pose.y_m, z)
                })
                .collect(),
            color,
        }
    };
    let segments = (0..36).map(|i| f64::from(i) * 4.0 + 180.0);
    let mut parts: Vec<_> = segments
        .map(|s| part(s, s + 4.0, [WALL_D_M, WALL_D_M + 0.3], 3.0, [140, 140, 138]))
        .collect();
    for (s, color) in [(60.0, [150, 110, 90]), (110.0, [120, 130, 150])] {
        parts.push(part(s, s + 22.0, [14.0, 30.0], 9.0, color));
        parts.push(part(s + 40.0, s + 55.0, [-30.0, -18.0], 7.0, color));
    }
    parts
}

fn infos() -> Vec<VehicleInfo> {
    let info = |id, kind, name: &str, number| VehicleInfo {
        id,
        label: format!("{name} {number}"),
        kind,
        dimensions: SEDAN,
    };
    let cavs = (1..=6).map(|id| info(id, VehicleKind::Cav, "CAV", id));
    let humans = (7..=8).map(|id| info(id, VehicleKind::Human, "human", id - 6));
    let obstacles = (9..=10).map(|id| info(id, VehicleKind::Obstacle, "obstacle", id - 8));
    cavs.chain(humans).chain(obstacles).collect()
}

/// Station, offset and speed of a vehicle whose lane change begins at `change_s_m`, if at all.
fn run(road: &Road, sharing: bool) -> RunSeries {
    let vehicles = infos().into_iter().map(|info| {
        let index = f64::from(info.id);
        let left = info.id <= 4;
        let obstacle = info.kind == VehicleKind::Obstacle;
        let mut s = if obstacle {
            OBSTACLE_S_M + (index - 9.0) * 7.0
        } else if left {
            75.0 - index * 17.0
        } else {
            90.0 - index * 11.0
        };
        let mut d: f64 = match (left || obstacle, info.id % 2) {
            (true, _) => 3.5,
            (false, 0) => 0.0,
            (false, _) => -3.5,
        };
        let mut speed: f64 = if obstacle { 0.0 } else { 14.0 };
        let change_s_m = if sharing { 150.0 + index * 4.0 } else { 222.0 };
        let stuck = !sharing && left && info.id > 2;
        let mut series = VehicleSeries {
            info,
            samples: Vec::new(),
            lane_change_starts_s: Vec::new(),
        };
        for i in 0..250 {
            let time_s = f64::from(i) * 0.1;
            let before = d;
            if left && s > change_s_m && !stuck {
                d -= (d * 0.06).max(0.0);
                if (before - 3.5).abs() < 1e-9 {
                    series.lane_change_starts_s.push(time_s);
                }
            }
            if stuck {
                let gap = OBSTACLE_S_M - 10.0 - (index - 3.0) * 8.0 - s;
                speed = speed.min((2.0 * 3.5 * gap.max(0.0)).sqrt());
            }
            let psi = ((d - before) / (0.1 * speed.max(1.0))).atan();
            series.samples.push(VehicleSample {
                time_s,
                pose: road.pose_from_frenet(s, d, psi),
                speed_mps: speed,
            });
            s += 0.1 * speed;
        }
        series
    });
    RunSeries {
        title: if sharing { "Sharing on" } else { "Sharing off" }.to_owned(),
        vehicles: vehicles.collect(),
    }
}

fn record(
    path: &Path,
    road: Road,
    scenery: Vec<SceneryPart>,
    run: &RunSeries,
) -> Result<(), ViewerError> {
    let mut recording = Recording::create(
        path,
        SceneRecord {
            scenario: "synthetic corner".to_owned(),
            run: "sharing on".to_owned(),
            description: "A made-up run: nothing in it is measured.".to_owned(),
            road: road.clone(),
            scenery,
            vehicles: infos(),
            focus: FOCUS,
            calibration: Calibration::kitti(),
        },
    )?;
    for step in 0..250 {
        let vehicles: Vec<_> = run
            .vehicles
            .iter()
            .map(|vehicle| vehicle_step(&road, vehicle, step))
            .collect();
        let focus = (step % 5 == 0).then(|| focus_frame(&road, run, step));
        recording.log_step(&StepRecord {
            time_s: step as f64 * 0.1,
            vehicles,
            links: (1..6).map(|i| [StationId(i), StationId(i + 1)]).collect(),
            focus,
        })?;
    }
    recording.finish()
}

fn vehicle_step(road: &Road, vehicle: &VehicleSeries, step: usize) -> VehicleStep {
    let sample = vehicle.samples[step];
    let cav = vehicle.info.kind == VehicleKind::Cav;
    let point = road.to_frenet(sample.pose.position());
    let changing = vehicle
        .lane_change_starts_s
        .iter()
        .any(|start_s| (0.0..4.0).contains(&(sample.time_s - start_s)));
    VehicleStep {
        id: vehicle.info.id,
        pose: sample.pose,
        speed_mps: sample.speed_mps,
        accel_mps2: 0.0,
        lane: road.lane_at(point.d_m),
        action: cav.then_some(if changing {
            Action::ChangeRight
        } else {
            Action::KeepLane
        }),
        outcome: cav.then_some(if changing {
            FilterOutcome::Filtered
        } else {
            FilterOutcome::Nominal
        }),
        h_m: cav.then_some(12.0 + f64::from(vehicle.info.id) + (sample.time_s * 0.5).sin()),
        headway_m: (cav && sample.time_s < 15.0).then_some(17.0 + sample.time_s * 0.2),
    }
}

fn state_of(vehicle: &VehicleSeries, step: usize) -> ObjectState {
    let sample = vehicle.samples[step];
    ObjectState {
        center: SEDAN.center_pose(sample.pose),
        velocity_mps: sample.pose.forward() * sample.speed_mps,
        length_m: SEDAN.length_m,
        width_m: SEDAN.width_m,
        height_m: SEDAN.height_m,
        class: ObjectClass::Car,
    }
}

fn focus_frame(road: &Road, run: &RunSeries, step: usize) -> FocusFrame {
    let focus = &run.vehicles[FOCUS.0 as usize - 1];
    let pose = focus.samples[step].pose;
    let time_s = focus.samples[step].time_s;
    let others = run
        .vehicles
        .iter()
        .filter(|vehicle| vehicle.info.id != FOCUS.0);
    let mut frame = FocusFrame {
        pose,
        image: Some(image(road, pose)),
        cloud: Some(cloud(road, pose)),
        marks: Some(marks(road, pose)),
        ..FocusFrame::default()
    };
    for vehicle in others {
        let state = state_of(vehicle, step);
        let own = (state.center.position() - pose.position()).norm() < 35.0;
        let shared = vehicle.info.id != 8;
        let seers = [(own, FOCUS), (shared, StationId(1))];
        let seen: Vec<_> = seers.iter().filter(|(seen, _)| *seen).collect();
        frame
            .boxes
            .extend(seen.iter().take(1).map(|(_, station)| SeenBox {
                state,
                seen_by: *station,
            }));
        frame.tracks.push(Track {
            id: vehicle.info.id,
            station: None,
            state,
            time_s,
            position_std_m: 0.3,
            velocity_std_mps: 0.3,
            confidence: 1.0,
            lane: None,
            action: None,
            announced_s: None,
            sightings: seen
                .iter()
                .map(|(_, station)| Sighting {
                    station: *station,
                    measured_s: time_s,
                })
                .collect(),
        });
    }
    frame.tracks.retain(|track| !track.sightings.is_empty());
    frame
}

/// Rings on the ground and what they meet of the wall.
fn cloud(road: &Road, pose: Se2Pose) -> PointCloud {
    const HEIGHT_M: f64 = 1.73;
    let s_hint = road.to_frenet(pose.position()).s_m;
    let points = (0..32).flat_map(|ring| {
        let elevation = (2.0 - f64::from(ring) * 0.8).to_radians();
        (0..800).filter_map(move |i| {
            let azimuth = f64::from(i) / 800.0 * TAU;
            let ground = if elevation < 0.0 {
                HEIGHT_M / -elevation.tan()
            } else {
                f64::INFINITY
            };
            let (sin, cos) = azimuth.sin_cos();
            let to_wall = (1..80).map(f64::from).find(|range| {
                let at = pose.transform(Vector2::new(range * cos, range * sin));
                let point = road.to_frenet_near(at, s_hint + range * cos);
                point.d_m > WALL_D_M && (180.0..324.0).contains(&point.s_m)
            });
            let range = ground.min(to_wall.unwrap_or(f64::INFINITY));
            let z = range * elevation.tan();
            (range < 80.0 && z < 1.3).then_some([
                (range * cos) as f32,
                (range * sin) as f32,
                z as f32,
                0.3,
            ])
        })
    });
    PointCloud {
        points: points.collect(),
    }
}

/// Sky, grass and asphalt with painted edge lines.
fn image(road: &Road, pose: Se2Pose) -> CameraImage {
    let calibration = Calibration::kitti();
    let camera = calibration.intrinsics;
    let s_hint = road.to_frenet(pose.position()).s_m;
    let vehicle = pose.to_isometry();
    let color = |u: u32, v: u32| -> [u8; 3] {
        let ray = calibration.vehicle_from_camera.rotation
            * camera.ray(f64::from(u) + 0.5, f64::from(v) + 0.5);
        if ray.z > -0.01 {
            return [150, 185 - (v / 4) as u8, 225];
        }
        let origin = calibration.vehicle_from_camera.translation.vector;
        let hit = vehicle * Point3::from(origin - ray * (origin.z / ray.z));
        let point = road.to_frenet_near(hit.xy().coords, s_hint + 20.0);
        let on_mark = (0..MARK_COUNT).any(|mark| {
            let solid = mark == 0 || mark == MARK_COUNT - 1;
            (point.d_m - road.mark_offset_m(mark)).abs() < 0.08
                && (solid || point.s_m.rem_euclid(12.0) < 4.0)
        });
        match (on_mark, point.d_m.abs() < 5.75) {
            (true, _) => [225, 225, 215],
            (false, true) => [88, 88, 92],
            _ => [96, 120, 70],
        }
    };
    let pixels = (0..camera.height_px).flat_map(|v| (0..camera.width_px).map(move |u| (u, v)));
    CameraImage {
        width_px: camera.width_px,
        height_px: camera.height_px,
        rgb: pixels.flat_map(|(u, v)| color(u, v)).collect(),
    }
}

/// Where the marks of a straight road would be seen.
fn marks(road: &Road, pose: Se2Pose) -> [Vec<[f64; 2]>; MARK_COUNT] {
    let camera = Calibration::kitti().intrinsics;
    let point = road.to_frenet_pose(pose);
    std::array::from_fn(|mark| {
        let seen = ROW_ANCHORS.iter().filter_map(|row| {
            let v = f64::from(row.0);
            let below = v - camera.cy_px;
            let depth_m = camera.fy_px * 1.65 / below;
            let lateral_m = point.d_m - road.mark_offset_m(mark);
            let u = camera.cx_px + camera.fx_px * lateral_m / depth_m;
            let straight = wrap_angle(point.psi_rad).abs() < FRAC_PI_2;
            (below > 25.0 && (0.0..1242.0).contains(&u) && straight).then_some([u, v])
        });
        seen.collect()
    })
}
