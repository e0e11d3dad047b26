use covista_world::{Action, ActionVerdict, BarrierKind, LaneIndex};

use crate::barriers::front::Ahead;
use crate::barriers::rear::Follower;
use crate::barriers::{Input, ROUNDING_M, Row};
use crate::manoeuvre::{Course, lane_of};
use crate::rows::{Rows, ahead_in, rows};
use crate::{Manoeuvre, Neighbour, SafetySettings, Situation};

/// A follower or passer-by slower than this does not change lanes.
const STANDING_MPS: f64 = 0.5;

/// Whether `action` is safe now (Alg. 1, line 2): the CBF-QP with its rows is feasible with no
/// slack.
pub fn verdict(
    situation: &Situation<'_>,
    manoeuvre: &Manoeuvre,
    action: Action,
    settings: &SafetySettings,
) -> ActionVerdict {
    let running = matches!(
        manoeuvre,
        Manoeuvre::ChangeLane { .. } | Manoeuvre::Abort { .. }
    );
    match action {
        Action::EmergencyStop => ActionVerdict::Safe,
        Action::KeepLane if running => ActionVerdict::Safe,
        Action::KeepLane => keep_lane(situation, manoeuvre.lane(), settings),
        Action::ChangeLeft | Action::ChangeRight if running => {
            if action == manoeuvre.action() {
                ActionVerdict::Safe
            } else {
                ActionVerdict::Unsafe(BarrierKind::Manoeuvre)
            }
        }
        Action::ChangeLeft | Action::ChangeRight => match lane_of(manoeuvre.lane(), action) {
            None => ActionVerdict::Unsafe(BarrierKind::Manoeuvre),
            Some(to) => {
                let announced_s = match *manoeuvre {
                    Manoeuvre::Announced {
                        to: wanted,
                        since_s,
                        ..
                    } if wanted == to => since_s,
                    _ => situation.time_s,
                };
                change_lane(situation, manoeuvre.lane(), to, announced_s, settings)
            }
        },
    }
}

fn keep_lane(
    situation: &Situation<'_>,
    lane: LaneIndex,
    settings: &SafetySettings,
) -> ActionVerdict {
    let rows = rows(situation, &Course::keep(lane), settings);
    let broken = rows.hard.iter().find(|row| row.h0_m < -ROUNDING_M);
    match broken.map(|row| row.kind).or_else(|| infeasible(&rows)) {
        Some(kind) => ActionVerdict::Unsafe(kind),
        None => ActionVerdict::Safe,
    }
}

/// A lane change may start when every vehicle that is in the target lane, enters it or may enter
/// it leaves room: h >= 0 at the start, and lower <= upper bounds on the input.
fn change_lane(
    situation: &Situation<'_>,
    from: LaneIndex,
    to: LaneIndex,
    announced_s: f64,
    settings: &SafetySettings,
) -> ActionVerdict {
    let course = Course::change(from, to);
    let mut rows = rows(situation, &course, settings);
    add_entering(situation, &course, announced_s, settings, &mut rows);
    let broken = rows.hard.iter().chain(&rows.rear).find(|row| {
        let towards_current = row.kind == BarrierKind::FrontCurrent;
        let is_sight = row.kind == BarrierKind::Sight;
        // In the lane that is left the distance level may be recovering, and its end may be seen.
        let level = if towards_current {
            row.h0_m
        } else if is_sight {
            f64::INFINITY
        } else {
            row.h
        };
        level < -ROUNDING_M
    });
    match broken
        .map(|row| row.kind)
        .or_else(|| blind(situation, &course, settings))
        .or_else(|| infeasible(&rows))
    {
        Some(kind) => ActionVerdict::Unsafe(kind),
        None => ActionVerdict::Safe,
    }
}

/// Whether the target lane is not seen far enough.
fn blind(
    situation: &Situation<'_>,
    course: &Course,
    settings: &SafetySettings,
) -> Option<BarrierKind> {
    ahead_in(situation, course)
        .filter(|ahead| ahead.kind == BarrierKind::FrontTarget)
        .map(|ahead| {
            let clear_s_m = situation.sight.clear_s_m(ahead.lane);
            crate::barriers::sight::row(&ahead, clear_s_m, settings)
        })
        .find(|row| row.h < -ROUNDING_M)
        .map(|row| row.kind)
}

/// Rows for those that are not in the target lane yet.
fn add_entering(
    situation: &Situation<'_>,
    course: &Course,
    announced_s: f64,
    settings: &SafetySettings,
    rows: &mut Rows,
) {
    for ahead in ahead_in(situation, course).filter(|ahead| ahead.kind == BarrierKind::FrontTarget)
    {
        let to = ahead.lane;
        for neighbour in situation.neighbours {
            let entering = may_enter(neighbour, situation, to, announced_s);
            let Some(kind) = entering else { continue };
            if neighbour.lanes.contains(to) {
                continue;
            }
            let row = if neighbour.is_ahead_of(&situation.ego) {
                front_or(kind, &ahead, neighbour, settings)
            } else {
                let row = Follower::new(&ahead, neighbour, settings).row(neighbour.id, settings);
                let arbitrated = kind == BarrierKind::Arbitration;
                let kind = if arbitrated { kind } else { row.kind };
                Row { kind, ..row }
            };
            match row.kind {
                BarrierKind::RearTarget => rows.rear.push(row),
                _ => rows.hard.push(row),
            }
        }
    }
}

fn front_or(
    kind: BarrierKind,
    ahead: &Ahead<'_>,
    neighbour: &Neighbour,
    settings: &SafetySettings,
) -> Row {
    Row {
        kind,
        ..ahead.row(neighbour, settings)
    }
}

/// Why a vehicle has to be counted to lane `to`: a CAV announced it before the ego vehicle did
/// (ties by station id), or the intention of a vehicle on the lane's far side is unknown.
fn may_enter(
    neighbour: &Neighbour,
    situation: &Situation<'_>,
    to: LaneIndex,
    announced_s: f64,
) -> Option<BarrierKind> {
    match neighbour.station.filter(|_| neighbour.action.is_some()) {
        Some(station) => {
            let theirs = (neighbour.announced_s.unwrap_or(situation.time_s), station);
            let own = (announced_s, situation.ego.station);
            let precedes = theirs.0 < own.0 || (theirs.0 <= own.0 && theirs.1 < own.1);
            (neighbour.entering(situation.road) == Some(to) && precedes)
                .then_some(BarrierKind::Arbitration)
        }
        None => {
            let moves = neighbour.speed_mps > STANDING_MPS;
            let beside = [to.left(), to.right()]
                .into_iter()
                .flatten()
                .any(|lane| neighbour.lanes.contains(lane) && is_far_side(situation, to, lane));
            (moves && beside).then_some(BarrierKind::FrontTarget)
        }
    }
}

/// Whether `lane` lies on the other side of `to` than the ego vehicle.
fn is_far_side(situation: &Situation<'_>, to: LaneIndex, lane: LaneIndex) -> bool {
    let road = situation.road;
    let own_side = situation.ego.frenet.d_m - road.lane_center_m(to);
    let their_side = road.lane_center_m(lane) - road.lane_center_m(to);
    own_side * their_side < 0.0
}

/// The row against which there is no input, if the rows exclude each other.
fn infeasible(rows: &Rows) -> Option<BarrierKind> {
    let every = || rows.hard.iter().chain(&rows.rear);
    let of = |input: Input, limit: (f64, f64)| {
        let rows = || every().filter(move |row| row.input == input);
        let upper = rows()
            .map(|row| (row.upper, row.kind))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let lower = rows()
            .map(|row| (row.lower, row.kind))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let (most, most_kind) = upper.unwrap_or((f64::INFINITY, BarrierKind::FrontCurrent));
        let (least, least_kind) = lower.unwrap_or((f64::NEG_INFINITY, BarrierKind::RearTarget));
        if most < limit.0 - 1e-9 {
            Some(most_kind)
        } else if least > most.min(limit.1) + 1e-9 {
            Some(least_kind)
        } else {
            None
        }
    };
    let bounds = rows.bounds;
    of(Input::Accel, (bounds.accel_min_mps2, bounds.accel_max_mps2))
        .or_else(|| of(Input::TanDelta, (-bounds.tan_delta, bounds.tan_delta)))
}
