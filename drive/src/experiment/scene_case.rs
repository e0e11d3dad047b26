use std::collections::{BTreeMap, BTreeSet};

use covista_traffic::{Scenario, VehicleKind};

use super::{ExperimentError, Means, Percepts, SceneCase, SceneFigures};
use crate::{ChannelSettings, RunConfig, RunSummary, Senses, Snapshot, run};

/// Drives the scenario of the case once.
pub(super) fn drive(case: &SceneCase, means: &Means) -> Result<SceneFigures, ExperimentError> {
    let mut senses = match case.percepts {
        Percepts::Truth => Senses::Truth,
        Percepts::Statistical => {
            let errors = means.errors.clone();
            Senses::Statistical(Box::new(errors.ok_or(ExperimentError::NoErrorModel)?))
        }
        Percepts::Network => {
            let networks = means.networks.clone();
            Senses::Network(networks.ok_or(ExperimentError::NoNetworks)?)
        }
    };
    let config = RunConfig {
        scenario: Scenario::builtin(&case.scenario)?,
        seed: case.seed,
        sharing: case.sharing,
        channel: ChannelSettings::default(),
        duration_s: case.duration_s,
        control: case.control,
    };
    let mut ways = Ways::default();
    let summary = run(&config, &mut senses, &mut |snapshot| {
        ways.note(snapshot);
        Ok(())
    })?;
    Ok(ways.figures(&summary))
}

/// Where everybody was, every 0.1 s.
#[derive(Default)]
struct Ways {
    vehicles: BTreeMap<u32, Way>,
    /// Where obstacles stand: lane and metres along the road.
    obstacles: Vec<(u8, f64)>,
}

#[derive(Default)]
struct Way {
    desired_speed_mps: f64,
    /// Time in seconds and metres along the road.
    samples: Vec<(f64, f64)>,
}

impl Ways {
    fn note(&mut self, snapshot: &Snapshot<'_>) {
        let is_first = self.vehicles.is_empty() && self.obstacles.is_empty();
        for (row, vehicle) in snapshot.rows.iter().zip(snapshot.traffic.vehicles()) {
            if row.kind != VehicleKind::Obstacle {
                let way = self.vehicles.entry(row.id).or_default();
                way.desired_speed_mps = vehicle.desired_speed_mps;
                way.samples.push((row.t_s, row.s_m));
            } else if let Some(lane) = row.lane.filter(|_| is_first) {
                self.obstacles.push((lane.get(), row.s_m));
            }
        }
    }

    fn figures(&self, summary: &RunSummary) -> SceneFigures {
        let lanes: BTreeSet<u8> = self.obstacles.iter().map(|&(lane, _)| lane).collect();
        let cavs = summary.vehicles.iter();
        let blocked: Vec<_> = cavs
            .filter(|cav| lanes.contains(&cav.initial_lane))
            .collect();
        let changed = blocked
            .iter()
            .filter(|cav| cav.lane_change_start_s.is_some())
            .count();
        let before_m = blocked.iter().filter_map(|cav| {
            let start_s = cav.lane_change_start_s?;
            let from_m = self.vehicles.get(&cav.id)?.at(start_s)?;
            let in_lane = self
                .obstacles
                .iter()
                .filter(|(lane, _)| *lane == cav.initial_lane);
            let ahead_m = in_lane.map(|(_, s_m)| s_m - from_m);
            ahead_m.min_by(f64::total_cmp)
        });
        let of_blocked = blocked.iter().filter_map(|cav| self.vehicles.get(&cav.id));
        SceneFigures {
            vehicles_stuck: summary.vehicles_stuck,
            mean_velocity_mps: summary.mean_velocity_mps,
            delay_s: mean(self.vehicles.values().map(Way::delay_s)).unwrap_or(0.0),
            blocked_delay_s: mean(of_blocked.map(Way::delay_s)),
            blocked_cavs: blocked.len(),
            blocked_cavs_changed: changed,
            changed_before_sight: summary.lane_changes_before_sight,
            change_before_obstacle_m: mean(before_m),
            mean_comfort: summary.mean_comfort,
            hardest_braking_mps2: summary.hardest_braking_mps2,
            collisions: summary.collisions,
            unsafe_actions: summary.unsafe_actions,
            violations_unattributed: summary.violations_unattributed,
        }
    }
}

impl Way {
    /// Time that was lost against driving at the desired speed, in seconds.
    fn delay_s(&self) -> f64 {
        let (Some(first), Some(last)) = (self.samples.first(), self.samples.last()) else {
            return 0.0;
        };
        (last.0 - first.0) - (last.1 - first.1) / self.desired_speed_mps.max(f64::MIN_POSITIVE)
    }

    /// Where it was at `time_s`, in metres along the road.
    fn at(&self, time_s: f64) -> Option<f64> {
        let nearest = (self.samples.iter())
            .min_by(|a, b| (a.0 - time_s).abs().total_cmp(&(b.0 - time_s).abs()));
        nearest.map(|&(_, s_m)| s_m)
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standing_ten_seconds_loses_ten() {
        let samples = vec![(0.0, 0.0), (5.0, 50.0), (15.0, 50.0), (20.0, 100.0)];
        let way = Way {
            desired_speed_mps: 10.0,
            samples,
        };
        assert!((way.delay_s() - 10.0).abs() < 1e-12);
        assert_eq!(way.at(5.04), Some(50.0));
        assert!(Way::default().delay_s().abs() < 1e-12);
    }
}
