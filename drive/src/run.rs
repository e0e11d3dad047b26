use std::{
    collections::{BTreeMap, BTreeSet},
    time::Instant,
};

use covista_control::{ControlSettings, RoadProfile, SettingsError};
use covista_perception::PerceiveError;
use covista_planner::InvalidObservation;
use covista_sensors::{RayScene, in_line_of_sight};
use covista_sharing::{Channel, ChannelSettings, Delivery, TrackerSettings};
use covista_traffic::{Scenario, ScenarioError, Traffic, VehicleId, VehicleKind};
use covista_world::{Calibration, ControlInput, FilterOutcome, LaneIndex, STEP_S};
use nalgebra::Point3;

use crate::{
    cav::{Cav, Odometry},
    monitor::{CavView, Monitor, PlacedTrack},
    senses::{Sensed, Senses},
    snapshot::{CavSnapshot, FocusSnapshot, Observe, RecordError, Snapshot},
    summary::RunSummary,
    tally::Tally,
    trace::TraceRow,
    truth::TrueVehicle,
};

/// Steps of the plant between two behaviour steps (0.5 s), messages (0.1 s) and trace rows (0.1 s).
const BEHAVIOUR_STEPS: u64 = 50;
const MESSAGE_STEPS: u64 = 10;
const TRACE_STEPS: u64 = 10;
/// CAVs decide one after the other, this far apart, so that each hears what the one before did.
const STAGGER_STEPS: u64 = 8;

/// What to run.
#[derive(Debug, Clone)]
pub struct RunConfig {
    /// The scene.
    pub scenario: Scenario,
    /// Seed of everything random.
    pub seed: u64,
    /// Whether the CAVs share what they see and do.
    pub sharing: bool,
    /// How their messages pass. Their trackers are told how wrong senders may be about their
    /// poses.
    pub channel: ChannelSettings,
    /// Simulated seconds.
    pub duration_s: f64,
    /// Assumptions of the promise and comfort of the reference.
    pub control: ControlSettings,
}

/// Why a run ends early.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scenario can't be built.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A setting of the controller is unusable.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A frame is refused or a network fails.
    #[error(transparent)]
    Perception(#[from] PerceiveError),
    /// A CAV's own state is unusable.
    #[error(transparent)]
    Observation(#[from] InvalidObservation),
    /// There is nobody to run.
    #[error("scenario {0} has no CAV; give it a vehicle of kind \"cav\"")]
    NoCav(String),
    /// The observer refused a snapshot.
    #[error("cannot record the run: {0}")]
    Record(#[source] RecordError),
}

/// Drives `config.scenario` once. `observe` is called every 0.1 s of simulated time.
///
/// # Errors
/// When the scenario or a setting is unusable, perception fails or `observe` does.
pub fn run(
    config: &RunConfig,
    senses: &mut Senses,
    observe: &mut Observe<'_>,
) -> Result<RunSummary, RunError> {
    let mut loop_ = Loop::new(config)?;
    let steps = (config.duration_s / STEP_S).round().max(0.0) as u64;
    for step in 0..steps {
        loop_.step(step, senses, observe)?;
    }
    Ok(loop_.summary())
}

struct Loop<'a> {
    config: &'a RunConfig,
    calibration: Calibration,
    traffic: Traffic,
    profile: RoadProfile,
    cavs: Vec<Cav>,
    channel: Channel,
    monitor: Monitor,
    perception_steps: u64,
    focus: usize,
    sensed: Vec<Sensed>,
    delivery: Delivery,
    in_sight: BTreeSet<(VehicleId, VehicleId)>,
    tally: Tally,
    start: Instant,
}

impl<'a> Loop<'a> {
    fn new(config: &'a RunConfig) -> Result<Self, RunError> {
        let traffic = Traffic::new(&config.scenario, config.seed)?;
        let tracker = TrackerSettings {
            pose_noise: config.channel.pose_noise,
            ..TrackerSettings::default()
        };
        let cavs: Vec<Cav> = traffic
            .vehicles()
            .iter()
            .filter(|vehicle| vehicle.kind == VehicleKind::Cav)
            .map(|vehicle| Cav::new(vehicle, traffic.road(), config.control, tracker))
            .collect::<Result<_, _>>()?;
        let obstacle_lanes: Vec<LaneIndex> = TrueVehicle::all(&traffic)
            .iter()
            .filter(|vehicle| vehicle.kind == VehicleKind::Obstacle)
            .filter_map(|vehicle| vehicle.lane)
            .collect();
        if cavs.is_empty() {
            return Err(RunError::NoCav(config.scenario.name.clone()));
        }
        let perception_steps = (config.scenario.perception_period_s / STEP_S)
            .round()
            .max(1.0);
        Ok(Self {
            config,
            calibration: Calibration::kitti(),
            focus: (cavs.len() - 1) / 2,
            cavs,
            channel: Channel::new(config.channel, config.seed),
            profile: RoadProfile::new(traffic.road().clone(), &config.control),
            monitor: Monitor::new(config.control.safety),
            perception_steps: perception_steps as u64,
            sensed: Vec::new(),
            delivery: Delivery::default(),
            in_sight: BTreeSet::new(),
            tally: Tally::new(obstacle_lanes),
            traffic,
            start: Instant::now(),
        })
    }

    /// One step of 0.01 s, from the truth to the truth.
    fn step(
        &mut self,
        step: u64,
        senses: &mut Senses,
        observe: &mut Observe<'_>,
    ) -> Result<(), RunError> {
        let has_frame = step.is_multiple_of(self.perception_steps);
        if has_frame {
            self.perceive(senses)?;
        }
        if self.config.sharing && step.is_multiple_of(MESSAGE_STEPS) {
            self.share();
        }
        self.decide(step)?;
        let inputs = self.control();
        self.watch(step, &inputs);
        if step.is_multiple_of(TRACE_STEPS) {
            self.record(has_frame, observe)?;
        }
        let start = Instant::now();
        self.traffic.step(&inputs);
        self.tally.stages.traffic_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn odometry(&self, cav: VehicleId) -> Odometry {
        self.traffic
            .vehicle(cav)
            .map(Odometry::from)
            .unwrap_or_default()
    }

    fn perceive(&mut self, senses: &mut Senses) -> Result<(), RunError> {
        let start = Instant::now();
        let scene = self.traffic.scene();
        let rays = RayScene::new(&scene);
        let ids: Vec<VehicleId> = self.cavs.iter().map(|cav| cav.id).collect();
        self.tally.stages.sensors_s += start.elapsed().as_secs_f64();
        let (sensed, times) =
            senses.perceive(&scene, &rays, &self.calibration, &ids, self.config.seed)?;
        self.tally.stages.sensors_s += times.sensors_s;
        self.tally.stages.perception_s += times.perception_s;
        self.tally.frames_perceived += sensed.len();
        let start = Instant::now();
        for (index, sensed) in sensed.iter().enumerate() {
            let own = self.odometry(self.cavs[index].id);
            self.cavs[index].perceive(
                scene.time_s,
                self.traffic.road(),
                &self.calibration,
                &own,
                sensed,
            );
        }
        self.sensed = sensed;
        self.tally.stages.sharing_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Every CAV broadcasts, and hears those within range.
    fn share(&mut self) {
        let start = Instant::now();
        let time_s = self.traffic.time_s();
        let own: Vec<Odometry> = self.cavs.iter().map(|cav| self.odometry(cav.id)).collect();
        let messages = self
            .cavs
            .iter_mut()
            .zip(&own)
            .map(|(cav, own)| cav.message(time_s, self.traffic.road(), own))
            .collect();
        let delivery = self.channel.exchange(time_s, messages);
        for cav in &mut self.cavs {
            if let Some(inbox) = delivery.inboxes.get(&cav.station) {
                cav.tracker.receive(time_s, inbox.iter().map(AsRef::as_ref));
            }
        }
        self.tally.bytes_shared += delivery.bytes_sent;
        self.delivery = delivery;
        self.tally.stages.sharing_s += start.elapsed().as_secs_f64();
    }

    fn decide(&mut self, step: u64) -> Result<(), RunError> {
        let start = Instant::now();
        let time_s = self.traffic.time_s();
        for index in 0..self.cavs.len() {
            if (step + STAGGER_STEPS * index as u64).is_multiple_of(BEHAVIOUR_STEPS) {
                let own = self.odometry(self.cavs[index].id);
                let cav = &mut self.cavs[index];
                cav.decide(time_s, &self.profile, &own)?;
                self.tally
                    .takes(cav.id, cav.preferred, cav.mapped, own.accel_mps2);
            }
        }
        self.tally.stages.planner_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn control(&mut self) -> BTreeMap<VehicleId, ControlInput> {
        let start = Instant::now();
        let time_s = self.traffic.time_s();
        let mut inputs = BTreeMap::new();
        for index in 0..self.cavs.len() {
            let own = self.odometry(self.cavs[index].id);
            let cav = &mut self.cavs[index];
            let output = cav.control(time_s, &self.profile, &own);
            self.tally.filtered(output.outcome);
            inputs.insert(cav.id, output.u);
        }
        self.tally.stages.control_s += start.elapsed().as_secs_f64();
        inputs
    }

    /// Shows the truth to the monitor.
    fn watch(&mut self, step: u64, inputs: &BTreeMap<VehicleId, ControlInput>) {
        let start = Instant::now();
        let time_s = self.traffic.time_s();
        let truth = TrueVehicle::all(&self.traffic);
        if step.is_multiple_of(TRACE_STEPS) {
            self.watch_sight(time_s, &truth);
        }
        let road = self.traffic.road();
        let placed = |cav: &Cav| -> Vec<PlacedTrack> {
            let tracks = cav.tracks(time_s).into_iter();
            tracks.map(|track| PlacedTrack::new(track, road)).collect()
        };
        let tracks: Vec<Vec<PlacedTrack>> = self.cavs.iter().map(placed).collect();
        let views: Vec<CavView<'_>> = self
            .cavs
            .iter()
            .zip(&tracks)
            .map(|(cav, tracks)| CavView {
                id: cav.id,
                tracks,
                sight: cav.sight(),
                manoeuvre: cav.manoeuvre(),
                state: self.odometry(cav.id).state,
                wheelbase_m: cav.wheelbase_m(),
                input: inputs.get(&cav.id).copied(),
            })
            .collect();
        let overlapping = self.traffic.overlapping_pairs();
        self.monitor
            .observe(time_s, self.traffic.road(), &truth, &views, overlapping);
        for vehicle in self.traffic.vehicles() {
            self.tally.moves(vehicle);
        }
        self.tally.stages.record_s += start.elapsed().as_secs_f64();
    }

    /// Who has line of sight to whom, from the LIDAR's place.
    fn watch_sight(&mut self, time_s: f64, truth: &[TrueVehicle]) {
        let scene = self.traffic.scene();
        let rays = RayScene::new(&scene);
        self.in_sight.clear();
        for cav in &self.cavs {
            let pose = self.odometry(cav.id).state.pose.to_isometry();
            let sensor = pose * self.calibration.vehicle_from_lidar;
            let from = Point3::from(sensor.translation.vector);
            for other in truth.iter().filter(|other| other.id != cav.id) {
                let visible = in_line_of_sight(&scene, &rays, from, cav.id, other.id) > 0.0;
                self.monitor.sight(cav.id, other.id, visible, time_s);
                if visible {
                    self.in_sight.insert((cav.id, other.id));
                }
                if visible && other.kind == VehicleKind::Obstacle {
                    self.tally.sees_obstacle(cav.id, time_s);
                }
            }
        }
    }

    fn record(&mut self, has_frame: bool, observe: &mut Observe<'_>) -> Result<(), RunError> {
        let start = Instant::now();
        let time_s = self.traffic.time_s();
        let focus = has_frame.then(|| {
            let cav = &self.cavs[self.focus];
            FocusSnapshot {
                station: cav.station,
                calibration: &self.calibration,
                frame: self
                    .sensed
                    .get(self.focus)
                    .and_then(|sensed| sensed.frame.as_ref()),
                percepts: self
                    .sensed
                    .get(self.focus)
                    .map_or(&[], |sensed| sensed.percepts.as_slice()),
                tracks: cav.tracks(time_s),
                heard: (self
                    .delivery
                    .inboxes
                    .get(&cav.station)
                    .into_iter()
                    .flatten())
                .map(AsRef::as_ref)
                .collect(),
            }
        });
        let snapshot = Snapshot {
            time_s,
            traffic: &self.traffic,
            rows: self.rows(time_s),
            links: &self.delivery.links,
            cavs: self.cav_snapshots(has_frame),
            in_sight: &self.in_sight,
            focus,
        };
        observe(&snapshot).map_err(RunError::Record)?;
        self.tally.stages.record_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn cav_snapshots(&self, has_frame: bool) -> Vec<CavSnapshot<'_>> {
        let road = self.traffic.road();
        let snapshots = self
            .cavs
            .iter()
            .enumerate()
            .map(|(index, cav)| CavSnapshot {
                id: cav.id,
                own: cav.own_state(road, &self.odometry(cav.id)),
                percepts: (self.sensed.get(index))
                    .filter(|_| has_frame)
                    .map(|sensed| sensed.percepts.as_slice()),
            });
        snapshots.collect()
    }

    fn rows(&self, time_s: f64) -> Vec<TraceRow> {
        let run = if self.config.sharing {
            "sharing"
        } else {
            "alone"
        };
        let road = self.traffic.road();
        self.traffic
            .vehicles()
            .iter()
            .map(|vehicle| {
                let cav = self.cavs.iter().find(|cav| cav.id == vehicle.id);
                let barriers = self.monitor.barriers_of(vehicle.id);
                let dimensions = vehicle.dimensions();
                let center = dimensions.center_pose(vehicle.state.pose).position();
                let outcome: Option<FilterOutcome> = cav
                    .and_then(|cav| cav.last_output.as_ref())
                    .map(|output| output.outcome);
                TraceRow {
                    run,
                    t_s: time_s,
                    id: vehicle.id.0,
                    kind: vehicle.kind,
                    x_m: vehicle.state.pose.x_m,
                    y_m: vehicle.state.pose.y_m,
                    yaw_rad: vehicle.state.pose.yaw_rad,
                    s_m: vehicle.frenet.s_m,
                    d_m: vehicle.frenet.d_m,
                    lane: road.lane_at(road.to_frenet_near(center, vehicle.frenet.s_m).d_m),
                    v_mps: vehicle.state.speed_mps,
                    a_mps2: vehicle.accel_mps2,
                    length_m: dimensions.length_m,
                    width_m: dimensions.width_m,
                    action: cav.map(|cav| cav.preferred),
                    mapped_action: cav.map(|cav| cav.mapped),
                    outcome,
                    h_m: barriers.map(|barriers| barriers.h_m),
                    h0_m: barriers.map(|barriers| barriers.h0_m),
                    headway_m: barriers.map(|barriers| barriers.headway_m),
                    excused: barriers
                        .and_then(|barriers| barriers.cause)
                        .map_or("", |cause| cause.excuse()),
                }
            })
            .collect()
    }

    fn summary(self) -> RunSummary {
        let wall_s = self.start.elapsed().as_secs_f64();
        self.tally
            .summary(self.config, &self.cavs, &self.monitor, wall_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summarys_figures_fit_together() {
        let scenario = Scenario::builtin("mixed-traffic").expect("a scenario");
        let config = RunConfig {
            scenario,
            seed: 3,
            sharing: true,
            channel: ChannelSettings::default(),
            duration_s: 3.0,
            control: ControlSettings::default(),
        };
        let summary = run(&config, &mut Senses::Truth, &mut |_| Ok(())).expect("a run");
        let driven_km =
            summary.cav_mean_velocity_mps * 3.0 / 1000.0 * summary.vehicles.len() as f64;
        assert!((summary.cav_km - driven_km).abs() < 1e-9);
        let lane_changes = summary.lane_changes_per_km * summary.cav_km;
        assert!((lane_changes - summary.lane_changes as f64).abs() < 1e-9);
        assert!((0.0..=1.0).contains(&summary.actions_overruled_share));
        assert!(summary.ttc_p1_s <= summary.ttc_p5_s && summary.ttc_p5_s <= summary.ttc_p50_s);
        assert!(summary.jerk_p50_mps3.is_some());
        assert_eq!(summary.violations_unattributed, 0);
    }
}
