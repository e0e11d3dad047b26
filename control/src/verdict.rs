use covista_world::{Action, ActionVerdict, BarrierKind, LaneIndex};

use crate::barriers::front::{Ahead, Front};
use crate::barriers::rear::Rear;
use crate::barriers::sight::Sight;
use crate::barriers::{Barrier, Input, ROUNDING_M, Row};
use crate::execution::running;
use crate::manoeuvre::{Course, lane_of};
use crate::memory::Memory;
use crate::rows::{Rows, ahead_in};
use crate::{Manoeuvre, Mode, Neighbour, SafetySettings, Situation};

/// What a verdict rests on.
#[derive(Debug)]
pub struct Judge<'a> {
    /// All that is known now.
    pub situation: &'a Situation<'a>,
    /// What was known before.
    pub memory: &'a Memory,
    /// The assumptions.
    pub safety: &'a SafetySettings,
    /// Storage of the rows that are looked at.
    pub rows: &'a mut Rows,
}

impl Judge<'_> {
    /// Whether `action` is safe now (Alg. 1, line 2): the CBF-QP with its rows is feasible with no
    /// slack.
    pub fn verdict(&mut self, manoeuvre: &Manoeuvre, action: Action) -> ActionVerdict {
        let against = match (*manoeuvre, action) {
            (_, Action::EmergencyStop) => None,
            (Manoeuvre::ChangeLane { from, to, .. }, Action::KeepLane) => {
                self.against_return(from, to)
            }
            (Manoeuvre::Abort { from, back }, Action::KeepLane) => {
                self.against_going_on(from, back)
            }
            (Manoeuvre::ChangeLane { from, to, .. } | Manoeuvre::Abort { from, back: to }, _) => {
                if action == manoeuvre.action() {
                    self.against_going_on(from, to)
                } else {
                    Some(BarrierKind::Manoeuvre)
                }
            }
            (Manoeuvre::KeepLane { lane } | Manoeuvre::Announced { lane, .. }, _) => {
                match lane_of(lane, action) {
                    Some(to) => self.against_change(lane, to, self.announced_s(manoeuvre, to)),
                    None if action == Action::KeepLane => self.against_course(&Course::keep(lane)),
                    None => Some(BarrierKind::Manoeuvre),
                }
            }
        };
        against.map_or(ActionVerdict::Safe, ActionVerdict::Unsafe)
    }

    /// Whether there is such a lane and no manoeuvre excludes the action: all that is asked without
    /// a filter.
    pub fn possible(&self, manoeuvre: &Manoeuvre, action: Action) -> ActionVerdict {
        let excluded = match (*manoeuvre, action) {
            (_, Action::EmergencyStop | Action::KeepLane) => false,
            (Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }, _) => {
                action != manoeuvre.action()
            }
            _ => lane_of(manoeuvre.lane(), action).is_none(),
        };
        if excluded {
            ActionVerdict::Unsafe(BarrierKind::Manoeuvre)
        } else {
            ActionVerdict::Safe
        }
    }

    /// Whether a mode starts `action` now.
    pub fn is_safe(&mut self, mode: Mode, manoeuvre: &Manoeuvre, action: Action) -> bool {
        let verdict = match mode {
            Mode::Safe => self.verdict(manoeuvre, action),
            Mode::Paper | Mode::Off => self.possible(manoeuvre, action),
        };
        verdict == ActionVerdict::Safe
    }

    /// Whether a mode gives up the change from `from` to `to` now, if that is wanted.
    pub fn may_return(&mut self, mode: Mode, from: LaneIndex, to: LaneIndex) -> bool {
        match mode {
            Mode::Safe => self.against_return(from, to).is_none(),
            Mode::Paper | Mode::Off => self.is_nearer_to(from, to),
        }
    }

    /// What stands against giving a lane change to `to` up: the body has left `from` by more than
    /// half, or somebody is in the way back.
    fn against_return(&mut self, from: LaneIndex, to: LaneIndex) -> Option<BarrierKind> {
        if !self.is_nearer_to(from, to) {
            return Some(BarrierKind::Manoeuvre);
        }
        let rows = self.collect(&Course::change(to, from));
        let in_the_way = |row: &&Row| row.kind != BarrierKind::FrontCurrent;
        broken(
            rows.hard.iter().chain(&rows.rear).filter(in_the_way),
            |row| row.h0_m,
        )
    }

    /// A change that runs goes on while no collision level is broken and there is an input.
    fn against_going_on(&mut self, from: LaneIndex, to: LaneIndex) -> Option<BarrierKind> {
        let course = running(self.situation, from, to, self.safety);
        let rows = self.collect(&course);
        rows.rear.clear();
        broken(&rows.hard, |row| row.h0_m).or_else(|| infeasible(rows))
    }

    fn against_course(&mut self, course: &Course) -> Option<BarrierKind> {
        let rows = self.collect(course);
        broken(&rows.hard, |row| row.h0_m).or_else(|| infeasible(rows))
    }

    /// A lane change may start when every vehicle that is in the target lane, enters it or may
    /// enter it leaves room: h >= 0 at the start, and lower <= upper bounds on the input. In the
    /// lane that is left the distance level may be recovering, and its end may be seen.
    fn against_change(
        &mut self,
        from: LaneIndex,
        to: LaneIndex,
        announced_s: f64,
    ) -> Option<BarrierKind> {
        let course = Course::change(from, to);
        self.collect(&course);
        let target = ahead_in(self.situation, &course)
            .find(|ahead| ahead.kind == BarrierKind::FrontTarget)?;
        self.add_entering(&target, announced_s);
        let rows = &*self.rows;
        let level = |row: &Row| match row.kind {
            BarrierKind::FrontCurrent => row.h0_m,
            BarrierKind::Sight => f64::INFINITY,
            _ => row.h,
        };
        let sight = Sight::new(&target, self.situation.sight.clear_s_m(to), self.safety);
        broken(rows.hard.iter().chain(&rows.rear), level)
            .or_else(|| (sight.h() < -ROUNDING_M).then_some(BarrierKind::Sight))
            .or_else(|| infeasible(rows))
    }

    fn collect(&mut self, course: &Course) -> &mut Rows {
        self.rows
            .collect(self.situation, course, self.memory, self.safety);
        self.rows
    }

    /// Whether the greater part of the body is on `lane`'s side of the line to `other`.
    fn is_nearer_to(&self, lane: LaneIndex, other: LaneIndex) -> bool {
        let (road, ego) = (self.situation.road(), &self.situation.ego);
        let line_m = 0.5 * (road.lane_center_m(lane) + road.lane_center_m(other));
        let ahead_m = ego.dimensions.center_ahead_of_axle_m() * ego.frenet.psi_rad.sin();
        let offset_m = ego.frenet.d_m + ahead_m - line_m;
        offset_m * (road.lane_center_m(lane) - line_m) > 0.0
    }

    fn announced_s(&self, manoeuvre: &Manoeuvre, to: LaneIndex) -> f64 {
        match *manoeuvre {
            Manoeuvre::Announced {
                to: wanted,
                since_s,
                ..
            } if wanted == to => since_s,
            _ => self.situation.time_s,
        }
    }

    /// Rows for those that are not in the target lane yet.
    fn add_entering(&mut self, target: &Ahead<'_>, announced_s: f64) {
        let ego = &self.situation.ego;
        for neighbour in self.situation.neighbours {
            let kind = match self.may_enter(neighbour, target.lane, announced_s) {
                Some(kind) if !neighbour.lanes.contains(target.lane) => kind,
                _ => continue,
            };
            if neighbour.is_ahead_of(ego) {
                let closing = target.closing(self.safety);
                let row = Front::new(target, closing, neighbour, self.safety).row();
                self.rows.hard.push(Row { kind, ..row });
            } else {
                let row = Rear::new(target, neighbour, self.safety).row();
                if kind == BarrierKind::Arbitration {
                    self.rows.hard.push(Row { kind, ..row });
                } else {
                    self.rows.rear.push(row);
                }
            }
        }
    }

    /// Why a vehicle has to be counted to lane `to`: a CAV announced it before the ego vehicle did
    /// (ties by station id), or the intention of a vehicle on the lane's far side is unknown: a
    /// human's, and a CAV's that was not heard lately. One that surely stands stays where it is.
    fn may_enter(
        &self,
        neighbour: &Neighbour,
        to: LaneIndex,
        announced_s: f64,
    ) -> Option<BarrierKind> {
        let situation = self.situation;
        match neighbour.station.filter(|_| neighbour.action.is_some()) {
            Some(_) => {
                let precedes = neighbour.precedes(&situation.ego, announced_s, situation.time_s);
                (neighbour.entering(situation.road()) == Some(to) && precedes)
                    .then_some(BarrierKind::Arbitration)
            }
            None => {
                let beside = [to.left(), to.right()]
                    .into_iter()
                    .flatten()
                    .any(|lane| neighbour.lanes.contains(lane) && self.is_far_side(to, lane));
                (neighbour.may_move() && beside).then_some(BarrierKind::FrontTarget)
            }
        }
    }

    /// Whether `lane` lies on the other side of `to` than the ego vehicle.
    fn is_far_side(&self, to: LaneIndex, lane: LaneIndex) -> bool {
        let road = self.situation.road();
        let own_side = self.situation.ego.frenet.d_m - road.lane_center_m(to);
        let their_side = road.lane_center_m(lane) - road.lane_center_m(to);
        own_side * their_side < 0.0
    }
}

/// Whether, by the rows of a change that runs, h_0 of the lane that is entered is broken.
pub fn is_threatened(rows: &Rows) -> bool {
    let entered = |row: &&Row| row.kind != BarrierKind::FrontCurrent;
    broken(rows.hard.iter().chain(&rows.rear).filter(entered), |row| {
        row.h0_m
    })
    .is_some()
}

/// The first row whose level is broken.
fn broken<'r>(
    rows: impl IntoIterator<Item = &'r Row>,
    level: impl Fn(&Row) -> f64,
) -> Option<BarrierKind> {
    rows.into_iter()
        .find(|row| level(row) < -ROUNDING_M)
        .map(|row| row.kind)
}

/// The row against which there is no input, if the rows exclude each other.
fn infeasible(rows: &Rows) -> Option<BarrierKind> {
    let every = || rows.hard.iter().chain(&rows.rear);
    let of = |input: Input, limit: (f64, f64)| {
        let rows = || every().filter(move |row| row.input == input);
        let upper = rows().min_by(|a, b| a.upper.total_cmp(&b.upper))?;
        let lower = rows().max_by(|a, b| a.lower.total_cmp(&b.lower))?;
        if upper.upper < limit.0 - 1e-9 {
            Some(upper.kind)
        } else if lower.lower > upper.upper.min(limit.1) + 1e-9 {
            Some(lower.kind)
        } else {
            None
        }
    };
    let bounds = rows.bounds;
    of(Input::Accel, (bounds.accel_min_mps2, bounds.accel_max_mps2))
        .or_else(|| of(Input::TanDelta, (-bounds.tan_delta, bounds.tan_delta)))
}
