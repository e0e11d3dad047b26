use covista_world::{BarrierKind, STEP_S, bicycle_step};

use crate::barriers::front::Ahead;
use crate::barriers::lateral::{Lateral, strip_of, tan_delta_limit};
use crate::barriers::rear::Follower;
use crate::barriers::{Input, Row, curve_speed, sight};
use crate::distance::largest;
use crate::manoeuvre::Course;
use crate::qp::Bounds;
use crate::{EgoState, Neighbour, SafetySettings, Situation};

/// Every row of one step.
#[derive(Debug, Clone)]
pub struct Rows {
    /// U, and v + a Ts >= 0.
    pub bounds: Bounds,
    /// Rows that are always hard.
    pub hard: Vec<Row>,
    /// Rows towards followers in the target lane: hard before a lane change starts, slack after.
    pub rear: Vec<Row>,
    /// The smaller of h_y,max and h_y,min, in metres.
    pub h_lateral_m: f64,
}

impl Rows {
    /// What the hard rows and U leave to a: (smallest, largest).
    pub fn accel_interval(&self) -> (f64, f64) {
        let start = (self.bounds.accel_min_mps2, self.bounds.accel_max_mps2);
        self.hard
            .iter()
            .filter(|row| row.input == Input::Accel)
            .fold(start, |(lower, upper), row| {
                (lower.max(row.lower), upper.min(row.upper))
            })
    }
}

/// The lanes of a course, as front rows look at them.
pub fn ahead_in<'a>(
    situation: &Situation<'a>,
    course: &Course,
) -> impl Iterator<Item = Ahead<'a>> + use<'a> {
    let (road, ego) = (situation.road, situation.ego);
    let off_center_m = course.off_center_m(road);
    let leaving = course.target.is_some();
    let current = course.current.map(move |lane| Ahead {
        road,
        ego,
        lane,
        off_center_m,
        kind: BarrierKind::FrontCurrent,
        leaving,
    });
    let target = course.target.map(move |lane| Ahead {
        road,
        ego,
        lane,
        off_center_m,
        kind: BarrierKind::FrontTarget,
        leaving: false,
    });
    current.into_iter().chain(target)
}

/// Sideways room within which a body beside the ego vehicle is on its way.
const BESIDE_M: f64 = 0.3;

/// Whether a vehicle of the lane is ahead in the way of the ego vehicle. One that drives beside it
/// and only touches the line of the kept lane can't be braked for.
pub fn is_in_the_way(neighbour: &Neighbour, ego: &EgoState, kind: BarrierKind) -> bool {
    if !neighbour.is_ahead_of(ego) {
        return false;
    }
    let is_clear = neighbour.s_rear_m > ego.frenet.s_m + ego.front_m();
    let half_m = ego.dimensions.width_m / 2.0 + BESIDE_M;
    let overlaps = neighbour.d_left_m > ego.frenet.d_m - half_m
        && neighbour.d_right_m < ego.frenet.d_m + half_m;
    is_clear || overlaps || kind == BarrierKind::FrontTarget
}

/// All rows of a course.
pub fn rows(situation: &Situation<'_>, course: &Course, settings: &SafetySettings) -> Rows {
    let ego = &situation.ego;
    let v = ego.state.speed_mps;
    let wheelbase_m = ego.dimensions.wheelbase_m;
    let bounds = Bounds {
        tan_delta: tan_delta_limit(v, wheelbase_m, settings),
        accel_min_mps2: (-settings.brake_mps2).max(-v / STEP_S),
        accel_max_mps2: settings.accel_max_mps2,
    };
    let mut rows = Rows {
        bounds,
        hard: front_rows(situation, course, settings),
        rear: rear_rows(situation, course, settings),
        h_lateral_m: 0.0,
    };
    let straight = bicycle_step(ego.state, Default::default(), wheelbase_m);
    let next_s_m = situation
        .road
        .to_frenet_near(straight.pose.position(), ego.frenet.s_m)
        .s_m;
    rows.hard
        .push(curve_speed::row(situation.road, ego, next_s_m, settings));
    clear_rounding(&mut rows);
    add_lateral(situation, course, settings, &mut rows);
    rows
}

fn front_rows(situation: &Situation<'_>, course: &Course, settings: &SafetySettings) -> Vec<Row> {
    ahead_in(situation, course)
        .flat_map(|ahead| {
            let sight = sight::row(&ahead, situation.sight.clear_s_m(ahead.lane), settings);
            situation
                .neighbours
                .iter()
                .filter(move |neighbour| {
                    neighbour.lanes.contains(ahead.lane)
                        && is_in_the_way(neighbour, &situation.ego, ahead.kind)
                })
                .map(move |leader| ahead.row(leader, settings))
                .chain([sight])
        })
        .collect()
}

fn rear_rows(situation: &Situation<'_>, course: &Course, settings: &SafetySettings) -> Vec<Row> {
    ahead_in(situation, course)
        .filter(|ahead| ahead.kind == BarrierKind::FrontTarget)
        .flat_map(|ahead| {
            situation
                .neighbours
                .iter()
                .filter(move |neighbour| {
                    neighbour.lanes.contains(ahead.lane) && !neighbour.is_ahead_of(&situation.ego)
                })
                .map(move |behind| Follower::new(&ahead, behind, settings).row(behind.id, settings))
        })
        .collect()
}

/// Hardest braking meets every front row up to rounding; this takes the rounding off.
fn clear_rounding(rows: &mut Rows) {
    let hardest = rows.bounds.accel_min_mps2;
    for row in &mut rows.hard {
        if row.upper < hardest && row.upper > hardest - 1e-6 {
            row.upper = hardest;
        }
    }
}

/// The steering rows hold for v+ up to the acceleration that the other rows leave; where that is
/// too fast for any steering, the excursion bounds a first.
fn add_lateral(
    situation: &Situation<'_>,
    course: &Course,
    settings: &SafetySettings,
    rows: &mut Rows,
) {
    let strip = strip_of(situation.road, &course.strip);
    let lateral = Lateral::new(situation.road, &situation.ego, strip, settings);
    let (lower, upper) = rows.accel_interval();
    let hardest = rows.bounds.accel_min_mps2;
    let fastest = upper.clamp(hardest, rows.bounds.accel_max_mps2);
    let accel = largest(lower.min(fastest), fastest, |a| lateral.is_feasible(a));
    let accel = accel.unwrap_or(hardest);
    if accel < fastest {
        let kind = BarrierKind::LateralMax;
        rows.hard
            .push(Row::at_most(kind, Input::Accel, accel, lateral.h_m()));
    }
    rows.hard.extend(lateral.rows(accel));
    rows.h_lateral_m = lateral.h_m();
}
