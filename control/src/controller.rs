use std::collections::BTreeMap;

use covista_world::{
    Action, ActionVerdict, BarrierKind, ControlInput, FilterOutcome, LaneIndex, STEP_S,
};

use crate::barriers::lateral::{Lateral, is_parallel, strip_of, tan_delta_limit};
use crate::barriers::{ROUNDING_M, Row};
use crate::filter::{backup, filter};
use crate::manoeuvre::{Course, lane_of};
use crate::path::LateralPath;
use crate::qp::Bounds;
use crate::reference::reference;
use crate::rows::{Rows, rows};
use crate::situation::LaneSet;
use crate::verdict::verdict;
use crate::{ControlSettings, Manoeuvre, SettingsError, Situation};

/// The control input of one step and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlOutput {
    /// The safe input to apply.
    pub u: ControlInput,
    /// The reference U a.
    pub u_nominal: ControlInput,
    /// What became of the reference.
    pub outcome: FilterOutcome,
    /// Smallest h of the front and sight rows, towards the worst member of each estimate.
    pub h_m: f64,
    /// Smallest h_0 of the front rows; infinite with nobody ahead.
    pub h0_m: f64,
    /// Smaller of h_y,max and h_y,min.
    pub h_lateral_m: f64,
    /// The row that moved the input away from the reference.
    pub binding: Option<BarrierKind>,
    /// Front rows with h < 0, and why that is no fault of the controller.
    pub excused: Vec<Excused>,
    /// Acceleration that the rows towards followers ask for beyond what is applied.
    pub rear_slack_mps2: f64,
}

/// A front row with h < 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Excused {
    /// The neighbour's id.
    pub neighbour: u32,
    /// The assumption that broke.
    pub excuse: Excuse,
}

/// Why h < 0 towards a neighbour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Excuse {
    /// It came into the lane from beside.
    CutIn,
    /// It was not known before.
    Revealed,
    /// It stands, and the ego vehicle leaves the lane round it.
    Leaving,
    /// Its estimate was revised by more than the bounds on the error.
    Revised,
}

/// The controller of one CAV.
#[derive(Debug, Clone)]
pub struct Controller {
    settings: ControlSettings,
    manoeuvre: Manoeuvre,
    action: Action,
    path: Option<LateralPath>,
    last: ControlInput,
    known: BTreeMap<u32, Known>,
}

/// What was known of a neighbour in the step before.
#[derive(Debug, Clone, Copy)]
struct Known {
    lanes: LaneSet,
    excuse: Option<Excuse>,
}

impl Controller {
    /// A controller of a vehicle that keeps `lane`.
    ///
    /// # Errors
    /// When a setting is out of its range.
    pub fn new(settings: ControlSettings, lane: LaneIndex) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            settings,
            manoeuvre: Manoeuvre::KeepLane { lane },
            action: Action::KeepLane,
            path: None,
            last: ControlInput::default(),
            known: BTreeMap::new(),
        })
    }

    /// What the vehicle is about; `manoeuvre().action()` is what it should tell others.
    pub fn manoeuvre(&self) -> Manoeuvre {
        self.manoeuvre
    }

    /// The settings.
    pub fn settings(&self) -> &ControlSettings {
        &self.settings
    }

    /// Whether `action` is safe now (Alg. 1, line 2).
    ///
    /// While a lane change runs, keeping lane and the running change are safe: both mean to go on.
    pub fn verdict(&self, situation: &Situation<'_>, action: Action) -> ActionVerdict {
        verdict(situation, &self.manoeuvre, action, &self.settings.safety)
    }

    /// Takes the behaviour of the coming behaviour step. A lane change is announced first and
    /// starts when its verdict is still safe then; one that runs is finished, whatever the action.
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

    /// One step at 100 Hz: moves the manoeuvre on and gives the input to apply.
    pub fn control(&mut self, situation: &Situation<'_>) -> ControlOutput {
        if !is_usable(situation) {
            return self.blind_backup(situation);
        }
        self.advance(situation);
        let course = self.course(situation);
        let mut rows = rows(situation, &course, &self.settings.safety);
        let path = *self.path.get_or_insert_with(|| {
            let lane = self.manoeuvre.lane();
            LateralPath::constant(situation.road.lane_center_m(lane))
        });
        let mut u_nominal = reference(
            situation,
            &course,
            &path,
            self.last.accel_mps2,
            &self.settings,
        );
        if self.action == Action::EmergencyStop {
            u_nominal.accel_mps2 = rows.bounds.accel_min_mps2;
        }
        let rear_needs_mps2 = rows
            .rear
            .iter()
            .map(|row| row.lower.min(rows.bounds.accel_max_mps2))
            .fold(f64::NEG_INFINITY, f64::max);
        self.yield_to_front(&mut rows);
        let filtered = filter(u_nominal, &rows, self.last.tan_delta);
        self.last = filtered.u;
        let rear_slack_mps2 = (rear_needs_mps2 - filtered.u.accel_mps2).max(0.0);
        ControlOutput {
            u: filtered.u,
            u_nominal,
            outcome: filtered.outcome,
            h_m: smallest(&rows, |row| row.h),
            h0_m: smallest(&rows, |row| row.h0_m),
            h_lateral_m: rows.h_lateral_m,
            binding: filtered.binding,
            excused: self.excuses(situation, &rows),
            rear_slack_mps2,
        }
    }

    /// A lane change that has begun does not brake for comfort before a follower, but speeds up
    /// for none, and an emergency stop heeds none.
    fn yield_to_front(&self, rows: &mut Rows) {
        if self.action == Action::EmergencyStop {
            rows.rear.clear();
        }
        for row in &mut rows.rear {
            row.lower = row.lower.min(0.0);
        }
    }

    fn course(&self, situation: &Situation<'_>) -> Course {
        let change = |from: LaneIndex, to: LaneIndex| {
            let (right_m, left_m) = situation.ego.lateral_extent_m(situation.road);
            let covered = LaneSet::between(situation.road, right_m, left_m, 0.0);
            let heads_away = situation.ego.frenet.d_m;
            let left = !covered.contains(from)
                && (heads_away - situation.road.lane_center_m(to)).abs()
                    < situation.road.lane_width_m() / 2.0;
            Course {
                current: (!left).then_some(from),
                ..Course::change(from, to)
            }
        };
        match self.manoeuvre {
            Manoeuvre::KeepLane { lane } | Manoeuvre::Announced { lane, .. } => Course::keep(lane),
            Manoeuvre::ChangeLane { from, to, .. } => change(from, to),
            Manoeuvre::Abort { from, back } => change(from, back),
        }
    }

    /// Starts an announced change that is safe, aborts one that no longer is, ends one that is
    /// done.
    fn advance(&mut self, situation: &Situation<'_>) {
        match self.manoeuvre {
            Manoeuvre::KeepLane { .. } => {}
            Manoeuvre::Announced { lane, to, since_s } => {
                let due = situation.time_s >= since_s + self.settings.safety.announcement_s - 1e-9;
                let action = self.manoeuvre.action();
                if due && self.verdict(situation, action) == ActionVerdict::Safe {
                    self.manoeuvre = Manoeuvre::ChangeLane {
                        from: lane,
                        to,
                        announced_s: since_s,
                        started_s: situation.time_s,
                    };
                    self.path = Some(self.change_path(situation, to));
                }
            }
            Manoeuvre::ChangeLane { from, to, .. } => {
                if self.is_done(situation, to) {
                    self.keep(situation, to);
                } else if self.must_abort(situation, from, to) {
                    self.manoeuvre = Manoeuvre::Abort {
                        from: to,
                        back: from,
                    };
                    self.path = Some(self.change_path(situation, from));
                }
            }
            Manoeuvre::Abort { back, .. } => {
                if self.is_done(situation, back) {
                    self.keep(situation, back);
                }
            }
        }
    }

    fn keep(&mut self, situation: &Situation<'_>, lane: LaneIndex) {
        self.manoeuvre = Manoeuvre::KeepLane { lane };
        self.path = Some(LateralPath::constant(situation.road.lane_center_m(lane)));
    }

    /// A quintic to the centre of `to`: as long as a lane change takes in time, but longer where
    /// the road's own curvature leaves less lateral acceleration, and no shorter than a vehicle
    /// near standstill needs to get round one that stands.
    fn change_path(&self, situation: &Situation<'_>, to: LaneIndex) -> LateralPath {
        let settings = &self.settings.reference;
        let (road, ego) = (situation.road, &situation.ego);
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

    fn is_done(&self, situation: &Situation<'_>, lane: LaneIndex) -> bool {
        let (road, ego) = (situation.road, &situation.ego);
        let path_ends = self
            .path
            .is_none_or(|path| ego.frenet.s_m >= path.end_s_m());
        let strip = strip_of(road, &[lane]);
        let lateral = Lateral::new(road, ego, strip, &self.settings.safety);
        path_ends && is_parallel(ego.frenet.psi_rad) && lateral.h_m() >= 0.0
    }

    /// A change is aborted when the target lane's collision level breaks, or an emergency stop is
    /// asked for, while the body's greater part is in the old lane and that lane is safe.
    fn must_abort(&self, situation: &Situation<'_>, from: LaneIndex, to: LaneIndex) -> bool {
        let road = situation.road;
        let ego = &situation.ego;
        let middle_m = 0.5 * (road.lane_center_m(from) + road.lane_center_m(to));
        let ahead_m = ego.dimensions.center_ahead_of_axle_m() * ego.frenet.psi_rad.sin();
        let side = ego.frenet.d_m + ahead_m - middle_m;
        let in_old_lane = side * (road.lane_center_m(from) - middle_m) > 0.0;
        if !in_old_lane {
            return false;
        }
        let all = rows(situation, &Course::change(from, to), &self.settings.safety);
        let is_broken = |kind: BarrierKind| {
            all.hard
                .iter()
                .chain(&all.rear)
                .any(|row| row.kind == kind && row.h0_m < -ROUNDING_M)
        };
        let threatened = is_broken(BarrierKind::FrontTarget) || is_broken(BarrierKind::RearTarget);
        (threatened || self.action == Action::EmergencyStop)
            && !is_broken(BarrierKind::FrontCurrent)
    }

    fn excuses(&mut self, situation: &Situation<'_>, rows: &Rows) -> Vec<Excused> {
        let mut excused = Vec::new();
        let mut now = BTreeMap::new();
        for neighbour in situation.neighbours {
            let before = self.known.get(&neighbour.id);
            let broken = rows
                .hard
                .iter()
                .find(|row| row.neighbour == Some(neighbour.id) && row.h < -ROUNDING_M);
            let excuse = broken.map(|row| {
                before
                    .and_then(|known| known.excuse)
                    .unwrap_or_else(|| self.why(row, before, neighbour.lanes, situation))
            });
            excused.extend(excuse.map(|excuse| Excused {
                neighbour: neighbour.id,
                excuse,
            }));
            let known = Known {
                lanes: neighbour.lanes,
                excuse,
            };
            now.insert(neighbour.id, known);
        }
        self.known = now;
        excused
    }

    fn why(
        &self,
        row: &Row,
        before: Option<&Known>,
        lanes: LaneSet,
        situation: &Situation<'_>,
    ) -> Excuse {
        let slow = situation.ego.state.speed_mps <= self.settings.safety.leaving_speed_mps;
        let changes = matches!(self.manoeuvre, Manoeuvre::ChangeLane { .. });
        match before {
            None => Excuse::Revealed,
            Some(known) if known.lanes != lanes => Excuse::CutIn,
            Some(_) if changes && slow && row.kind == BarrierKind::FrontCurrent => Excuse::Leaving,
            Some(_) => Excuse::Revised,
        }
    }

    /// The answer to an input that is no number: brake, and hold the steering.
    fn blind_backup(&mut self, situation: &Situation<'_>) -> ControlOutput {
        let safety = &self.settings.safety;
        let v = situation.ego.state.speed_mps;
        let speed_mps = if v.is_finite() {
            v.max(0.0)
        } else {
            f64::INFINITY
        };
        let wheelbase_m = situation.ego.dimensions.wheelbase_m;
        let limit = if speed_mps.is_finite() && wheelbase_m.is_finite() {
            tan_delta_limit(speed_mps, wheelbase_m, safety)
        } else {
            self.last.tan_delta.abs()
        };
        let bounds = Bounds {
            tan_delta: limit,
            accel_min_mps2: (-safety.brake_mps2).max(-speed_mps / STEP_S),
            accel_max_mps2: safety.accel_max_mps2,
        };
        let u = backup(bounds, self.last.tan_delta);
        self.last = u;
        ControlOutput {
            u,
            u_nominal: u,
            outcome: FilterOutcome::Backup,
            h_m: f64::NEG_INFINITY,
            h0_m: f64::NEG_INFINITY,
            h_lateral_m: f64::NEG_INFINITY,
            binding: None,
            excused: Vec::new(),
            rear_slack_mps2: 0.0,
        }
    }
}

fn is_usable(situation: &Situation<'_>) -> bool {
    situation.ego.is_finite()
        && situation.ego.state.speed_mps >= 0.0
        && situation.time_s.is_finite()
        && situation.desired_speed_mps.is_finite()
        && LaneIndex::all().all(|lane| !situation.sight.clear_s_m(lane).is_nan())
        && situation.neighbours.iter().all(crate::Neighbour::is_finite)
}

fn smallest(rows: &Rows, level: impl Fn(&Row) -> f64) -> f64 {
    rows.hard
        .iter()
        .filter(|row| {
            matches!(
                row.kind,
                BarrierKind::FrontCurrent | BarrierKind::FrontTarget | BarrierKind::Sight
            )
        })
        .map(level)
        .fold(f64::INFINITY, f64::min)
}
