use std::collections::{BTreeMap, BTreeSet};

use covista_traffic::{TrafficVehicle, VehicleId, VehicleKind};
use covista_world::{Action, FilterOutcome, LaneIndex, STEP_S};

use crate::{
    RunConfig,
    cause::Cause,
    cav::Cav,
    monitor::{Distributions, Monitor},
    summary::{CavSummary, RunSummary, StageWallTimes},
};

/// Sums over a run.
#[derive(Default)]
pub(crate) struct Tally {
    pub stages: StageWallTimes,
    pub frames_perceived: usize,
    pub bytes_shared: usize,
    obstacle_lanes: BTreeSet<u8>,
    relaxed_steps: usize,
    backup_steps: usize,
    first_sight_s: BTreeMap<VehicleId, f64>,
    hardest_braking_mps2: BTreeMap<VehicleId, f64>,
    emergency_stop_steps: usize,
    emergency_stops: usize,
    /// CAVs in an emergency stop.
    stopping: BTreeSet<VehicleId>,
    speed: Mean,
    cav_speed: Mean,
    comfort: Mean,
    overruled: Mean,
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn get(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

impl Tally {
    /// Sums for a road whose obstacles stand in `obstacle_lanes`.
    pub fn new(obstacle_lanes: impl IntoIterator<Item = LaneIndex>) -> Self {
        Self {
            obstacle_lanes: obstacle_lanes.into_iter().map(LaneIndex::get).collect(),
            ..Self::default()
        }
    }

    /// What became of a CAV's nominal input in one step.
    pub fn filtered(&mut self, outcome: FilterOutcome) {
        self.relaxed_steps += usize::from(outcome == FilterOutcome::Relaxed);
        self.backup_steps += usize::from(outcome == FilterOutcome::Backup);
    }

    /// `cav` has line of sight to an obstacle.
    pub fn sees_obstacle(&mut self, cav: VehicleId, time_s: f64) {
        self.first_sight_s.entry(cav).or_insert(time_s);
    }

    /// A behaviour step: `cav` takes `mapped` where its policy preferred another action or the same,
    /// while it accelerates with `accel_mps2`.
    pub fn takes(&mut self, cav: VehicleId, preferred: Action, mapped: Action, accel_mps2: f64) {
        let comfort = covista_planner::comfort(accel_mps2, mapped);
        self.comfort.add(comfort);
        self.overruled.add(f64::from(u8::from(mapped != preferred)));
        if mapped != Action::EmergencyStop {
            self.stopping.remove(&cav);
            return;
        }
        self.emergency_stop_steps += 1;
        self.emergency_stops += usize::from(self.stopping.insert(cav));
    }

    /// One step of a vehicle's motion.
    pub fn moves(&mut self, vehicle: &TrafficVehicle) {
        if vehicle.kind == VehicleKind::Obstacle {
            return;
        }
        self.speed.add(vehicle.state.speed_mps);
        if vehicle.kind == VehicleKind::Cav {
            self.cav_speed.add(vehicle.state.speed_mps);
        }
        let hardest = self.hardest_braking_mps2.entry(vehicle.id).or_default();
        *hardest = hardest.max(-vehicle.accel_mps2);
    }

    pub fn summary(
        self,
        config: &RunConfig,
        cavs: &[Cav],
        monitor: &Monitor,
        wall_s: f64,
    ) -> RunSummary {
        let vehicles: Vec<CavSummary> = cavs.iter().map(|cav| self.cav(cav, monitor)).collect();
        let before_sight = |cav: &&CavSummary| {
            self.obstacle_lanes.contains(&cav.initial_lane)
                && cav.lane_change_start_s.is_some_and(|start_s| {
                    cav.first_line_of_sight_s
                        .is_none_or(|sight_s| start_s < sight_s)
                })
        };
        let violations = monitor.violations();
        let cav_steps = monitor.cav_steps() as f64;
        let cav_km = self.cav_speed.sum * STEP_S / 1000.0;
        let lane_changes = cavs.iter().map(|cav| cav.lane_changes_s.len()).sum();
        let Distributions { ttc_s, jerk_mps3 } = monitor.distributions();
        RunSummary {
            sharing: config.sharing,
            duration_s: config.duration_s,
            mean_velocity_mps: self.speed.get(),
            mean_comfort: self.comfort.get(),
            vehicles_stuck: monitor.stuck(),
            lane_changes_before_sight: vehicles.iter().filter(before_sight).count(),
            lane_changes,
            cav_km,
            cav_mean_velocity_mps: self.cav_speed.get(),
            lane_changes_per_km: share(lane_changes as f64, cav_km),
            emergency_stops_per_km: share(self.emergency_stops as f64, cav_km),
            actions_overruled_share: self.overruled.get(),
            min_headway_m: vehicles
                .iter()
                .filter_map(|cav| cav.min_headway_m)
                .reduce(f64::min),
            hardest_braking_mps2: vehicles
                .iter()
                .map(|cav| cav.hardest_braking_mps2)
                .fold(0.0, f64::max),
            collisions: monitor.collisions(),
            unsafe_actions: monitor.unsafe_actions(),
            violations: violations.values().sum(),
            collision_set_left: monitor.collision_set_left(),
            violations_unattributed: violations.get(&Cause::Unattributed).copied().unwrap_or(0),
            violations_by_cause: by_name(violations),
            excused_share: monitor
                .steps_violated()
                .map(|(cause, steps)| (cause.name().to_owned(), share(steps as f64, cav_steps)))
                .collect(),
            rear_gaps_lost_by_cause: by_name(monitor.rear_losses()),
            ttc_p1_s: ttc_s.quantile(0.01),
            ttc_p5_s: ttc_s.quantile(0.05),
            ttc_p50_s: ttc_s.quantile(0.5),
            ttc_below_1_5_s_share: share(ttc_s.below(1.5) as f64, cav_steps),
            jerk_p50_mps3: jerk_mps3.quantile(0.5),
            jerk_p95_mps3: jerk_mps3.quantile(0.95),
            jerk_p99_mps3: jerk_mps3.quantile(0.99),
            jerk_above_10_share: {
                let all = jerk_mps3.count();
                share((all - jerk_mps3.below(10.0)) as f64, all as f64)
            },
            relaxed_steps: self.relaxed_steps,
            backup_steps: self.backup_steps,
            emergency_stop_steps: self.emergency_stop_steps,
            emergency_stops: self.emergency_stops,
            frames_perceived: self.frames_perceived,
            bytes_shared: self.bytes_shared,
            wall_s,
            stages: self.stages,
            rrd: String::new(),
            vehicles,
        }
    }

    fn cav(&self, cav: &Cav, monitor: &Monitor) -> CavSummary {
        let hardest = self.hardest_braking_mps2.get(&cav.id);
        CavSummary {
            id: cav.station.0,
            initial_lane: cav.initial_lane.get(),
            first_line_of_sight_s: self.first_sight_s.get(&cav.id).map(to_step),
            lane_change_start_s: cav.lane_changes_s.first().map(to_step),
            hardest_braking_mps2: hardest.copied().unwrap_or(0.0),
            min_headway_m: monitor.min_headway_m(cav.id),
        }
    }
}

fn by_name(counts: &BTreeMap<Cause, usize>) -> BTreeMap<String, usize> {
    counts
        .iter()
        .map(|(cause, count)| (cause.name().to_owned(), *count))
        .collect()
}

/// `part` of `whole`; zero where there is none.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// A time without the rounding of its sum of steps.
fn to_step(time_s: &f64) -> f64 {
    (time_s * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn emergency_stops_in_a_row_of_one_vehicle_are_one() {
        use Action::{ChangeLeft, EmergencyStop, KeepLane};
        let mut tally = Tally::new([]);
        let (one, two) = (VehicleId(1), VehicleId(2));
        for (cav, preferred, mapped) in [
            (one, KeepLane, EmergencyStop),
            (two, KeepLane, EmergencyStop),
            (one, ChangeLeft, EmergencyStop),
            (one, ChangeLeft, KeepLane),
            (one, KeepLane, EmergencyStop),
            (two, KeepLane, KeepLane),
        ] {
            tally.takes(cav, preferred, mapped, 0.0);
        }
        assert_eq!((tally.emergency_stop_steps, tally.emergency_stops), (4, 3));
        assert!((tally.overruled.get() - 5.0 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn a_share_of_nothing_is_none() {
        assert!(share(0.0, 0.0).abs() < 1e-12);
        assert!((share(1.0, 4.0) - 0.25).abs() < 1e-12);
    }
}
