use covista_world::{LANE_COUNT, STEP_S};
use serde::Serialize;

const MPH_PER_MPS: f64 = 3600.0 / 1609.344;

/// What an episode on a ring came to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RingReport {
    /// Its length in seconds.
    pub time_s: f64,
    /// Mean speed of all vehicles over all steps.
    pub mean_velocity_mps: f64,
    /// The same in miles per hour.
    pub mean_velocity_mph: f64,
    /// Vehicles that pass a line across a lane in an hour: density per lane times mean speed.
    pub flow_per_h_lane: f64,
    /// Times that two bodies came to overlap; looked for every 0.1 s.
    pub collisions: u64,
    /// Least distance of a vehicle to the one it follows, between the bodies' centres along the
    /// road; `None` while nobody follows anybody.
    pub min_headway_m: Option<f64>,
    /// Lane changes that human drivers began.
    pub human_lane_changes: u64,
}

/// Sums over an episode.
#[derive(Debug, Clone, Default)]
pub(super) struct Sums {
    pub steps: u64,
    pub speed_mps: f64,
    pub collisions: u64,
    pub min_headway_m: Option<f64>,
    pub human_lane_changes: u64,
}

impl Sums {
    pub fn headway(&mut self, headway_m: f64) {
        let least_m = self.min_headway_m.unwrap_or(f64::INFINITY);
        self.min_headway_m = Some(least_m.min(headway_m));
    }

    pub fn report(&self, vehicles: usize, period_m: f64) -> RingReport {
        let summands = (self.steps as f64 * vehicles as f64).max(1.0);
        let mean_velocity_mps = self.speed_mps / summands;
        let per_m_lane = vehicles as f64 / (f64::from(LANE_COUNT) * period_m);
        RingReport {
            time_s: self.steps as f64 * STEP_S,
            mean_velocity_mps,
            mean_velocity_mph: mean_velocity_mps * MPH_PER_MPS,
            flow_per_h_lane: per_m_lane * mean_velocity_mps * 3600.0,
            collisions: self.collisions,
            min_headway_m: self.min_headway_m,
            human_lane_changes: self.human_lane_changes,
        }
    }
}
