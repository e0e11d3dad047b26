use covista_world::{LANE_COUNT, LaneIndex, Road};
use serde::{Deserialize, Serialize};

use super::cav::{RingCav, nearest_lane};

/// Steps of 0.01 s that a sample is the mean of: what a passenger feels, not what a step gives.
const SAMPLE_STEPS: u32 = 10;
const SAMPLE_S: f64 = 0.1;
/// A turn back of the front wheels by less than this is none: 2 degrees at the steering wheel, the
/// usual gap of the steering reversal rate (Markkula and Engstrom, 2006), at a ratio of 15.
const REVERSAL_GAP_RAD: f64 = 2.0 / 15.0 * std::f64::consts::PI / 180.0;
/// Way of which the offset is kept.
const TRACE_M: f64 = 1000.0;

/// How smoothly the CAVs of an episode drove, all of them together, beside what the road itself
/// asks for: lateral acceleration, heading, steering are those relative to the line along the road.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RingMotion {
    /// Way of all CAVs in km.
    pub way_km: f64,
    /// Root mean square of the lateral acceleration in m/s^2.
    pub lateral_accel_rms_mps2: f64,
    /// What 99 of 100 samples of its amount stay below.
    pub lateral_accel_p99_mps2: f64,
    /// The same of its change, in m/s^3.
    pub lateral_jerk_rms_mps3: f64,
    /// See above.
    pub lateral_jerk_p99_mps3: f64,
    /// Root mean square of the heading in degrees.
    pub heading_rms_deg: f64,
    /// Root mean square of the heading's rate in degrees a second.
    pub heading_rate_rms_degps: f64,
    /// Times a km that the steering turned back by more than 2 degrees at the steering wheel.
    pub steering_reversals_per_km: f64,
    /// Way to the side in m a km, less the width of the lanes that were changed.
    pub lateral_way_m_per_km: f64,
    /// Lanes changed a km: a lane counts when its middle half is reached.
    pub lane_changes_per_km: f64,
    /// Way along the road and offset d in metres of the CAV that moved most to the side, on its
    /// first kilometre.
    pub trace: Vec<[f64; 2]>,
    /// Offsets of the lines between the lanes and of the road's edges in metres.
    pub lane_lines_m: Vec<f64>,
}

/// Watches how smoothly CAVs drive.
#[derive(Default)]
pub(super) struct Motion {
    cavs: Vec<Course>,
    steps: u32,
    lateral_accels: Vec<f64>,
    jerks: Vec<f64>,
    headings: Vec<f64>,
    heading_rates: Vec<f64>,
}

/// One CAV's.
struct Course {
    sums: Sample,
    before: Option<Sample>,
    start_s_m: f64,
    s_m: f64,
    d_m: f64,
    lane: LaneIndex,
    lanes_changed: u32,
    lateral_way_m: f64,
    reversals: Reversals,
    trace: Vec<[f64; 2]>,
}

/// Sums, or means, over a sample.
#[derive(Clone, Copy, Default)]
struct Sample {
    lateral_accel_mps2: f64,
    heading_rad: f64,
    heading_rate_radps: f64,
    steering_rad: f64,
}

impl Motion {
    /// One step of 0.01 s, with the input that was driven.
    pub fn step(&mut self, cavs: &[RingCav], road: &Road) {
        if self.cavs.is_empty() {
            self.cavs
                .extend(cavs.iter().map(|cav| Course::new(cav, road)));
            return;
        }
        for (course, cav) in self.cavs.iter_mut().zip(cavs) {
            course.sums.add(cav);
        }
        self.steps += 1;
        if self.steps.is_multiple_of(SAMPLE_STEPS) {
            self.sample(cavs, road);
        }
    }

    fn sample(&mut self, cavs: &[RingCav], road: &Road) {
        for (course, cav) in self.cavs.iter_mut().zip(cavs) {
            let sample = std::mem::take(&mut course.sums).mean();
            self.lateral_accels.push(sample.lateral_accel_mps2);
            self.headings.push(sample.heading_rad.to_degrees());
            self.heading_rates
                .push(sample.heading_rate_radps.to_degrees());
            if let Some(before) = course.before.replace(sample) {
                let gained_mps2 = sample.lateral_accel_mps2 - before.lateral_accel_mps2;
                self.jerks.push(gained_mps2 / SAMPLE_S);
            }
            course.reversals.turn_to(sample.steering_rad);
            course.moves(cav, road);
        }
    }

    /// What it came to so far.
    pub fn figures(&self, road: &Road) -> RingMotion {
        let sum = |of: fn(&Course) -> f64| self.cavs.iter().map(of).sum::<f64>();
        let way_km = sum(|course| course.s_m - course.start_s_m) / 1e3;
        let a_km = |count: f64| if way_km > 0.0 { count / way_km } else { 0.0 };
        let lanes_changed = sum(|course| f64::from(course.lanes_changed));
        let width_m = lane_width_m(road);
        let by_way = |a: &&Course, b: &&Course| a.lateral_way_m.total_cmp(&b.lateral_way_m);
        let most = self.cavs.iter().max_by(by_way);
        RingMotion {
            way_km,
            lateral_accel_rms_mps2: rms(&self.lateral_accels),
            lateral_accel_p99_mps2: p99(&self.lateral_accels),
            lateral_jerk_rms_mps3: rms(&self.jerks),
            lateral_jerk_p99_mps3: p99(&self.jerks),
            heading_rms_deg: rms(&self.headings),
            heading_rate_rms_degps: rms(&self.heading_rates),
            steering_reversals_per_km: a_km(sum(|course| f64::from(course.reversals.count))),
            lateral_way_m_per_km: a_km(
                (sum(|course| course.lateral_way_m) - width_m * lanes_changed).max(0.0),
            ),
            lane_changes_per_km: a_km(lanes_changed),
            trace: most.map(|course| course.trace.clone()).unwrap_or_default(),
            lane_lines_m: lane_lines_m(road),
        }
    }
}

impl Course {
    fn new(cav: &RingCav, road: &Road) -> Self {
        let frenet = cav.frenet;
        Self {
            sums: Sample::default(),
            before: None,
            start_s_m: frenet.s_m,
            s_m: frenet.s_m,
            d_m: frenet.d_m,
            lane: nearest_lane(road, frenet.d_m),
            lanes_changed: 0,
            lateral_way_m: 0.0,
            reversals: Reversals::default(),
            trace: vec![[0.0, frenet.d_m]],
        }
    }

    fn moves(&mut self, cav: &RingCav, road: &Road) {
        let (s_m, d_m) = (cav.frenet.s_m, cav.frenet.d_m);
        self.lateral_way_m += (d_m - self.d_m).abs();
        (self.s_m, self.d_m) = (s_m, d_m);
        let lane = nearest_lane(road, d_m);
        let is_inside = (d_m - road.lane_center_m(lane)).abs() < lane_width_m(road) / 4.0;
        if lane != self.lane && is_inside {
            self.lanes_changed += u32::from(lane.get().abs_diff(self.lane.get()));
            self.lane = lane;
        }
        if s_m - self.start_s_m <= TRACE_M {
            self.trace.push([s_m - self.start_s_m, d_m]);
        }
    }
}

impl Sample {
    fn add(&mut self, cav: &RingCav) {
        let (v, frenet, wheelbase_m) =
            (cav.state.speed_mps, cav.frenet, cav.dimensions.wheelbase_m);
        let stretch = 1.0 - frenet.curvature_per_m * frenet.d_m;
        let along_per_m = frenet.curvature_per_m * frenet.psi_rad.cos() / stretch;
        let turn_per_m = cav.input.tan_delta / wheelbase_m - along_per_m;
        self.lateral_accel_mps2 += v * v * turn_per_m;
        self.heading_rad += frenet.psi_rad;
        self.heading_rate_radps += v * turn_per_m;
        self.steering_rad += cav.input.tan_delta.atan() - (along_per_m * wheelbase_m).atan();
    }

    fn mean(self) -> Self {
        let mean = |sum: f64| sum / f64::from(SAMPLE_STEPS);
        Self {
            lateral_accel_mps2: mean(self.lateral_accel_mps2),
            heading_rad: mean(self.heading_rad),
            heading_rate_radps: mean(self.heading_rate_radps),
            steering_rad: mean(self.steering_rad),
        }
    }
}

/// Counts how often an angle turns back by more than the gap.
#[derive(Default)]
struct Reversals {
    count: u32,
    extreme_rad: f64,
    /// The side that it turns to; 0 before it has turned by the gap.
    side: f64,
}

impl Reversals {
    fn turn_to(&mut self, rad: f64) {
        let turned = rad - self.extreme_rad;
        if self.side * turned > 0.0 {
            self.extreme_rad = rad;
        } else if turned.abs() >= REVERSAL_GAP_RAD {
            self.count += u32::from(self.side != 0.0);
            (self.side, self.extreme_rad) = (turned.signum(), rad);
        }
    }
}

fn lane_lines_m(road: &Road) -> Vec<f64> {
    let (_, left_m) = road.lane_bounds_m(LaneIndex::LEFTMOST);
    let right = LaneIndex::all().map(|lane| road.lane_bounds_m(lane).0);
    std::iter::once(left_m).chain(right).collect()
}

fn lane_width_m(road: &Road) -> f64 {
    let (right_m, left_m) = (
        road.lane_center_m(LaneIndex::RIGHTMOST),
        road.lane_center_m(LaneIndex::LEFTMOST),
    );
    (left_m - right_m) / f64::from(LANE_COUNT - 1)
}

fn rms(values: &[f64]) -> f64 {
    let squares: f64 = values.iter().map(|value| value * value).sum();
    (squares / values.len().max(1) as f64).sqrt()
}

fn p99(values: &[f64]) -> f64 {
    let mut amounts: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    amounts.sort_by(f64::total_cmp);
    let place = amounts.len() * 99 / 100;
    amounts.get(place).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_turns_back_beyond_the_gap_are_reversals() {
        let count = |angles: &[f64]| {
            let mut reversals = Reversals::default();
            let turns = angles.iter().map(|share| share * REVERSAL_GAP_RAD);
            turns.for_each(|rad| reversals.turn_to(rad));
            reversals.count
        };
        assert_eq!(count(&[0.5, 1.5, 3.0, 2.5, 4.0]), 0);
        assert_eq!(count(&[2.0, 0.9, 0.5, 2.0, 1.2, 3.0]), 2);
        assert_eq!(count(&[-2.0, 2.0, -2.0, 2.0]), 3);
    }

    #[test]
    fn one_in_a_hundred_lies_above_p99() {
        let values: Vec<f64> = (0..1000).map(|n| -f64::from(n)).collect();
        assert!((p99(&values) - 990.0).abs() < 1e-9);
        assert!((rms(&[3.0, -4.0]) - 12.5_f64.sqrt()).abs() < 1e-12);
        assert!(p99(&[]).abs() + rms(&[]).abs() < 1e-12);
    }
}
