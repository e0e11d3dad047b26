use covista_control::{ControlOutput, LaneSet, Manoeuvre, SafetySettings};
use covista_world::{ControlInput, FilterOutcome, FrenetPose, LANE_COUNT, Road, STEP_S};

use super::{
    exact::SafeSet,
    pair::{Pair, Scene, Seen, TOLERANCE_M},
    tally::Tally,
};
use crate::TrueVehicle;

/// What of the controller a step is judged by.
#[derive(Debug, Clone, Copy)]
pub(super) struct Judged<'a> {
    pub step: usize,
    pub ego: &'a TrueVehicle,
    pub manoeuvre: Manoeuvre,
    pub output: &'a ControlOutput,
}

/// Watches one episode on the truth.
pub(super) struct Watch<'a> {
    set: SafeSet<'a>,
    /// Whether cut-ins and reveals inside the set count as violations: they were made on purpose.
    excuses_nothing: bool,
    pairs: Vec<Pair>,
    claimed: LaneSet,
    was_changing: bool,
    pub tally: Tally,
}

impl<'a> Watch<'a> {
    pub fn new(
        settings: &'a SafetySettings,
        road: &'a Road,
        others: usize,
        excuses_nothing: bool,
    ) -> Self {
        Self {
            set: SafeSet { settings, road },
            excuses_nothing,
            pairs: vec![Pair::default(); others],
            claimed: LaneSet::default(),
            was_changing: false,
            tally: Tally::default(),
        }
    }

    /// One step: the truth at its begin, and the input that the controller gave for it.
    pub fn observe(&mut self, judged: &Judged<'_>, others: &[Seen]) {
        let &Judged {
            step,
            ego,
            manoeuvre,
            output,
        } = judged;
        let changing = matches!(
            manoeuvre,
            Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }
        );
        self.tally.campaign_steps += 1;
        self.tally.lane_changes += u64::from(changing && !self.was_changing);
        self.was_changing = changing;
        let within_lane = self.judge_place(step, ego, manoeuvre);
        let mut own = LaneSet::between(
            self.set.road,
            ego.d_range_m[0],
            ego.d_range_m[1],
            TOLERANCE_M,
        );
        own.insert(match manoeuvre {
            Manoeuvre::Announced { lane, .. } => lane,
            _ => manoeuvre.destination(),
        });
        let mut claimed = own;
        claimed.insert(manoeuvre.lane());
        let scene = Scene {
            set: self.set,
            step,
            ego,
            manoeuvre,
            changing,
            within_lane,
            own,
            claimed,
            claimed_before: std::mem::replace(&mut self.claimed, claimed),
            excuses_nothing: self.excuses_nothing,
        };
        for (pair, seen) in self.pairs.iter_mut().zip(others) {
            pair.step(&scene, seen, &mut self.tally);
        }
        let excused = self.pairs.iter().any(Pair::is_excused);
        self.tally.excused_steps += u64::from(excused);
        self.judge_input(step, ego, output, changing, excused);
    }

    fn judge_input(
        &mut self,
        step: usize,
        ego: &TrueVehicle,
        output: &ControlOutput,
        changing: bool,
        excused: bool,
    ) {
        let settings = self.set.settings;
        let ControlInput {
            tan_delta,
            accel_mps2,
        } = output.u;
        let v = ego.speed_mps;
        let within = tan_delta.abs() <= settings.tan_delta_max + 1e-9
            && accel_mps2 >= -settings.brake_mps2 - 1e-9
            && accel_mps2 <= settings.accel_max_mps2 + 1e-9;
        let lateral_mps2 = v.powi(2) * tan_delta.abs() / ego.dimensions.wheelbase_m;
        let tally = &mut self.tally;
        // A NaN is not within.
        tally.bad_inputs += u64::from(!within);
        tally.lateral_accel_steps +=
            u64::from(lateral_mps2 > settings.lateral_accel_max_mps2 + 1e-6);
        let failed = matches!(
            output.outcome,
            FilterOutcome::Relaxed | FilterOutcome::Backup
        );
        if !failed {
            return;
        }
        // A vehicle ahead explains a step without an input only where braking is not enough.
        let hardest_mps2 = (-settings.brake_mps2).max(-v / STEP_S);
        let brakes = accel_mps2 <= hardest_mps2 + 1e-6 && output.h_lateral_m >= -TOLERANCE_M;
        if changing {
            tally.infeasible_changing += 1;
        } else if excused && brakes {
            tally.infeasible_excused += 1;
        } else {
            tally.infeasible += 1;
            tally.log(|| format!("step {step}: infeasible at {v:.3} m/s, {output:?}"));
        }
    }

    /// The body within its lane, or both lanes of a change, and the speed within the curve's. Whether
    /// it is within the lane that it keeps, or has yet to leave.
    fn judge_place(&mut self, step: usize, ego: &TrueVehicle, manoeuvre: Manoeuvre) -> bool {
        let (road, settings) = (self.set.road, self.set.settings);
        let lanes = [manoeuvre.lane(), manoeuvre.destination()];
        let lanes = match manoeuvre {
            Manoeuvre::Announced { lane, .. } => [lane, lane],
            _ => lanes,
        };
        let bounds = lanes.map(|lane| road.lane_bounds_m(lane));
        let right_m = bounds[0].0.min(bounds[1].0);
        let left_m = bounds[0].1.max(bounds[1].1);
        let excess_m = (ego.d_range_m[1] - left_m).max(right_m - ego.d_range_m[0]);
        let curvature = road.curvature(ego.frenet.s_m).abs();
        let half_road_m = 0.5 * f64::from(LANE_COUNT) * road.lane_width_m();
        let sharpest = curvature / (1.0 - curvature * half_road_m);
        let lateral_mps2 =
            ego.speed_mps.powi(2) * (sharpest + settings.counter_curvature_min_per_m);
        let is_too_fast = lateral_mps2 > settings.lateral_accel_max_mps2 * (1.0 + 1e-6);
        let tally = &mut self.tally;
        tally.largest_lane_excess_m = tally.largest_lane_excess_m.max(excess_m);
        let is_outside = excess_m > TOLERANCE_M;
        tally.lane_excess_steps += u64::from(is_outside);
        tally.curve_speed_steps += u64::from(is_too_fast);
        if is_outside || is_too_fast {
            tally.log(|| {
                let FrenetPose { s_m, d_m, psi_rad, .. } = ego.frenet;
                format!(
                    "step {step}: {excess_m:.6} m over the line, too fast {is_too_fast}, {manoeuvre:?}, \
                     at {:.3} m/s, s {s_m:.2} m, d {d_m:.4} m, psi {psi_rad:.5}",
                    ego.speed_mps
                )
            });
        }
        let home = match manoeuvre {
            Manoeuvre::Abort { back, .. } => back,
            _ => manoeuvre.lane(),
        };
        let (right_m, left_m) = road.lane_bounds_m(home);
        ego.d_range_m[0] >= right_m - TOLERANCE_M && ego.d_range_m[1] <= left_m + TOLERANCE_M
    }
}
