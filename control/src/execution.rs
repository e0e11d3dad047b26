use covista_world::{Action, LaneIndex};

use crate::barriers::ROUNDING_M;
use crate::barriers::lateral::{Lateral, Strip};
use crate::manoeuvre::{Course, lane_of};
use crate::path::LateralPath;
use crate::rows::Rows;
use crate::verdict::{Judge, is_threatened};
use crate::{ControlSettings, Manoeuvre, Mode, ReferenceSettings, SafetySettings, Situation};

/// How an action is carried out: which manoeuvre runs, and along which path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Execution {
    manoeuvre: Manoeuvre,
    action: Action,
    path: Option<LateralPath>,
}

impl Execution {
    /// Keeps `lane`.
    pub fn new(lane: LaneIndex) -> Self {
        Self {
            manoeuvre: Manoeuvre::KeepLane { lane },
            action: Action::KeepLane,
            path: None,
        }
    }

    /// What the vehicle is about.
    pub fn manoeuvre(&self) -> Manoeuvre {
        self.manoeuvre
    }

    /// The action that was taken last.
    pub fn action(&self) -> Action {
        self.action
    }

    /// Takes an action.
    pub fn set_action(&mut self, action: Action, time_s: f64) {
        self.action = action;
        self.manoeuvre = match self.manoeuvre {
            Manoeuvre::KeepLane { lane } | Manoeuvre::Announced { lane, .. } => {
                match lane_of(lane, action) {
                    Some(to) => self.announced(lane, to, time_s),
                    None => Manoeuvre::KeepLane { lane },
                }
            }
            running @ (Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }) => running,
        };
    }

    fn announced(&self, lane: LaneIndex, to: LaneIndex, time_s: f64) -> Manoeuvre {
        match self.manoeuvre {
            same @ Manoeuvre::Announced { to: before, .. } if before == to => same,
            _ => Manoeuvre::Announced {
                lane,
                to,
                since_s: time_s,
            },
        }
    }

    /// Starts an announced change that is safe, gives up one that is threatened by `rows`, those of
    /// the last step, or not wanted any more, ends one that is done.
    pub fn advance(&mut self, judge: &mut Judge<'_>, rows: &Rows, settings: &ControlSettings) {
        let situation = judge.situation;
        let (safety, reference) = (&settings.safety, &settings.reference);
        match self.manoeuvre {
            Manoeuvre::KeepLane { .. } => {}
            Manoeuvre::Announced { lane, to, since_s } => {
                let due = situation.time_s >= since_s + safety.announcement_s - 1e-9;
                let action = self.manoeuvre.action();
                if due && judge.is_safe(settings.mode, &self.manoeuvre, action) {
                    self.manoeuvre = Manoeuvre::ChangeLane {
                        from: lane,
                        to,
                        announced_s: since_s,
                        started_s: situation.time_s,
                    };
                    self.path = Some(change_path(situation, to, reference));
                }
            }
            Manoeuvre::ChangeLane { from, to, .. } => {
                let unwanted = matches!(self.action, Action::EmergencyStop | Action::KeepLane);
                if self.is_done(situation, to, safety) {
                    self.keep(situation, to);
                } else if (unwanted || settings.mode == Mode::Safe && is_threatened(rows))
                    && judge.may_return(settings.mode, from, to)
                {
                    self.manoeuvre = Manoeuvre::Abort {
                        from: to,
                        back: from,
                    };
                    self.path = Some(change_path(situation, from, reference));
                }
            }
            Manoeuvre::Abort { back, .. } => {
                if self.is_done(situation, back, safety) {
                    self.keep(situation, back);
                }
            }
        }
    }

    /// The path to steer along.
    pub fn path(&mut self, situation: &Situation<'_>) -> LateralPath {
        *self.path.get_or_insert_with(|| {
            let lane = self.manoeuvre.lane();
            LateralPath::constant(situation.road().lane_center_m(lane))
        })
    }

    /// The lanes that the manoeuvre takes up.
    pub fn course(&self, situation: &Situation<'_>, safety: &SafetySettings) -> Course {
        match self.manoeuvre {
            Manoeuvre::KeepLane { lane } | Manoeuvre::Announced { lane, .. } => Course::keep(lane),
            Manoeuvre::ChangeLane {
                from,
                to,
                announced_s,
                ..
            } => Course {
                announced_s: Some(announced_s),
                ..running(situation, from, to, safety)
            },
            Manoeuvre::Abort { from, back } => running(situation, from, back, safety),
        }
    }

    /// The lanes that `action` would take up.
    pub fn course_of(
        &self,
        situation: &Situation<'_>,
        action: Action,
        safety: &SafetySettings,
    ) -> Course {
        match self.manoeuvre {
            Manoeuvre::KeepLane { lane } | Manoeuvre::Announced { lane, .. } => {
                lane_of(lane, action).map_or(Course::keep(lane), |to| Course::change(lane, to))
            }
            _ => self.course(situation, safety),
        }
    }

    fn keep(&mut self, situation: &Situation<'_>, lane: LaneIndex) {
        self.manoeuvre = Manoeuvre::KeepLane { lane };
        let center_m = situation.road().lane_center_m(lane);
        self.path = Some(LateralPath::constant(center_m));
    }

    fn is_done(&self, situation: &Situation<'_>, lane: LaneIndex, safety: &SafetySettings) -> bool {
        let frenet = &situation.ego.frenet;
        let path_ends = self.path.is_none_or(|path| frenet.s_m >= path.end_s_m());
        let is_parallel = frenet.psi_rad.abs() < PARALLEL_RAD;
        path_ends && is_parallel && h_lateral_m(situation, lane, safety) >= 0.0
    }
}

/// A heading this small ends a lane change.
const PARALLEL_RAD: f64 = 0.03;

/// The lanes of a change that runs. Once the body can stay within the lane that it enters it has
/// to, and the other counts no more.
pub fn running(
    situation: &Situation<'_>,
    from: LaneIndex,
    to: LaneIndex,
    safety: &SafetySettings,
) -> Course {
    // What still reaches over the edge beside the axle can't stay within.
    let ego = &situation.ego;
    let (right_m, left_m) = situation.road().lane_bounds_m(to);
    let room_m = (left_m - ego.frenet.d_m).min(ego.frenet.d_m - right_m);
    let is_inside = room_m >= 0.5 * ego.dimensions.width_m - ROUNDING_M;
    // Rounding must not let the body back into the other lane.
    if is_inside && h_lateral_m(situation, to, safety) >= -ROUNDING_M {
        Course {
            current: None,
            target: Some(to),
            strip: [to, to],
            announced_s: None,
        }
    } else {
        Course::change(from, to)
    }
}

/// The lateral barriers of one lane.
fn h_lateral_m(situation: &Situation<'_>, lane: LaneIndex, safety: &SafetySettings) -> f64 {
    let ego = &situation.ego;
    let strip = Strip::of(situation.road(), &[lane]);
    Lateral::new(situation.profile, ego, ego.frenet, strip, safety).h_m()
}

/// A quintic to the centre of `to`: as long as a lane change takes in time, but longer where the
/// road's own curvature leaves less lateral acceleration, and no shorter than a vehicle near
/// standstill needs to get round one that stands.
fn change_path(
    situation: &Situation<'_>,
    to: LaneIndex,
    settings: &ReferenceSettings,
) -> LateralPath {
    let (road, ego) = (situation.road(), &situation.ego);
    let v = ego.state.speed_mps;
    let to_m = road.lane_center_m(to);
    let by_time_m = settings.lane_change_s * v;
    let reach_m = ego.frenet.s_m + 2.0 * by_time_m;
    let road_accel = v * v * road.max_abs_curvature(ego.frenet.s_m, reach_m);
    let left_accel = (settings.lateral_accel_mps2 - road_accel).max(0.5);
    // The peak of a quintic's second derivative is 10 / sqrt(3) rise / length^2.
    let rise = (to_m - ego.frenet.d_m).abs();
    let by_accel_m = v * (10.0 / 3.0_f64.sqrt() * rise / left_accel).sqrt();
    let length_m = by_time_m.max(by_accel_m).max(settings.lane_change_min_m);
    let stretch = 1.0 - ego.frenet.curvature_per_m * ego.frenet.d_m;
    let slope = ego.frenet.psi_rad.clamp(-0.5, 0.5).tan() * stretch;
    LateralPath::quintic(ego.frenet.s_m, length_m, ego.frenet.d_m, slope, to_m)
}
