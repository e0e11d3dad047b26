use covista_world::{BarrierKind, ControlInput, FrenetPose, LaneIndex, STEP_S, bicycle_step};

use crate::barriers::bounds::Bounds;
use crate::barriers::curve_speed::CurveSpeed;
use crate::barriers::front::{Ahead, Front};
use crate::barriers::lateral::{Lateral, Strip};
use crate::barriers::rear::Rear;
use crate::barriers::sight::Sight;
use crate::barriers::{Barrier, Input, ROUNDING_M, Row};
use crate::manoeuvre::Course;
use crate::memory::{Excuse, Memory};
use crate::{EgoState, Neighbour, SafetySettings, Situation};

/// Every row of one step.
#[derive(Debug, Clone, PartialEq)]
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

impl Default for Rows {
    fn default() -> Self {
        Self {
            bounds: Bounds {
                tan_delta: 0.0,
                accel_min_mps2: 0.0,
                accel_max_mps2: 0.0,
            },
            hard: Vec::new(),
            rear: Vec::new(),
            h_lateral_m: 0.0,
        }
    }
}

impl Rows {
    /// Takes up the rows of a course. The storage of the rows before is used again.
    pub fn collect(
        &mut self,
        situation: &Situation<'_>,
        course: &Course,
        memory: &Memory,
        safety: &SafetySettings,
    ) {
        let ego = &situation.ego;
        self.bounds = Bounds::new(ego.state.speed_mps, ego.dimensions.wheelbase_m, safety);
        self.hard.clear();
        self.rear.clear();
        let next = straight_on(situation);
        longitudinal(situation, course, &next, memory, safety, &mut |barrier| {
            let row = barrier.row();
            match row.kind {
                BarrierKind::RearTarget => self.rear.push(row),
                _ => self.hard.push(row),
            }
        });
        self.clear_rounding();
        let strip = Strip::of(situation.road(), &course.strip);
        let lateral = Lateral::new(situation.profile, ego, next, strip, safety);
        self.add_lateral(&lateral);
    }

    /// What the hard rows and U leave to one component of u: (smallest, largest).
    pub fn interval(&self, input: Input) -> (f64, f64) {
        let bounds = self.bounds;
        let start = match input {
            Input::TanDelta => (-bounds.tan_delta, bounds.tan_delta),
            Input::Accel => (bounds.accel_min_mps2, bounds.accel_max_mps2),
        };
        self.hard
            .iter()
            .filter(|row| row.input == input)
            .fold(start, |(lower, upper), row| {
                (lower.max(row.lower), upper.min(row.upper))
            })
    }

    /// Hardest braking meets every front row up to rounding; this takes the rounding off.
    fn clear_rounding(&mut self) {
        let hardest = self.bounds.accel_min_mps2;
        for row in &mut self.hard {
            if row.upper < hardest && row.upper > hardest - 1e-6 {
                row.upper = hardest;
            }
        }
    }

    /// The steering rows hold for v+ up to the acceleration that the other rows leave; where that
    /// is too fast for any steering, the excursion bounds a first.
    fn add_lateral(&mut self, lateral: &Lateral<'_>) {
        let (_, upper) = self.interval(Input::Accel);
        let hardest = self.bounds.accel_min_mps2;
        let fastest = upper.clamp(hardest, self.bounds.accel_max_mps2);
        let start = self.hard.len();
        self.hard
            .extend(lateral.barriers(fastest).map(|barrier| barrier.row()));
        let has_none = |row: &Row| row.lower == f64::INFINITY || row.upper == f64::NEG_INFINITY;
        if self.hard[start..].iter().any(has_none)
            && let Some(speed_row) = lateral.speed_row(hardest, fastest)
        {
            self.hard.truncate(start);
            self.hard.push(speed_row);
            self.hard.extend(
                lateral
                    .barriers(speed_row.upper)
                    .map(|barrier| barrier.row()),
            );
        }
        self.h_lateral_m = lateral.h_m();
    }
}

/// By how much `u` misses the hard rows of a course, in units of h.
pub fn shortfall(
    situation: &Situation<'_>,
    course: &Course,
    memory: &Memory,
    safety: &SafetySettings,
    u: ControlInput,
) -> f64 {
    let next = straight_on(situation);
    let mut most = 0.0_f64;
    let mut missed = |barrier: &dyn Barrier| {
        if barrier.kind() != BarrierKind::RearTarget && !barrier.row().admits(u) {
            // Where h is minus infinity no finite slack is enough.
            let missing = barrier.target() - barrier.h_next(u);
            most = most.max(if missing.is_nan() {
                f64::INFINITY
            } else {
                missing
            });
        }
    };
    longitudinal(situation, course, &next, memory, safety, &mut missed);
    let strip = Strip::of(situation.road(), &course.strip);
    let lateral = Lateral::new(situation.profile, &situation.ego, next, strip, safety);
    for barrier in lateral.barriers(u.accel_mps2) {
        missed(&barrier);
    }
    most
}

/// Where the ego vehicle is one step on when it drives straight on; steering moves it no less.
fn straight_on(situation: &Situation<'_>) -> FrenetPose {
    let EgoState {
        state,
        dimensions,
        frenet,
        ..
    } = &situation.ego;
    let straight = bicycle_step(*state, Default::default(), dimensions.wheelbase_m);
    // On an arc this is where it gets to but for the third order of the step.
    let (sin, cos) = frenet.psi_rad.sin_cos();
    let way_m = state.speed_mps * STEP_S;
    let stretch = 1.0 - frenet.curvature_per_m * (frenet.d_m + way_m * sin);
    let about_m = frenet.s_m + way_m * cos / stretch.max(0.2);
    let road = situation.road();
    road.to_frenet_pose_near(straight.pose, about_m)
}

/// Every barrier that bounds the acceleration.
pub fn longitudinal(
    situation: &Situation<'_>,
    course: &Course,
    next: &FrenetPose,
    memory: &Memory,
    safety: &SafetySettings,
    visit: &mut dyn FnMut(&dyn Barrier),
) {
    for ahead in ahead_in(situation, course) {
        let closing = ahead.closing(safety);
        let mut is_broken = false;
        for leader in leaders(situation, &ahead).chain(entering(situation, &ahead, course)) {
            let front = Front::new(&ahead, closing, leader, safety);
            let is_within = leader.lanes.contains(ahead.lane);
            if !is_within && front.h() < -ROUNDING_M {
                continue;
            }
            let excuse = memory.judge(&front, leader);
            is_broken |= excuse.is_some_and(|excuse| excuse != Excuse::Leaving);
            visit(&front.excused(excuse));
        }
        visit(&sight(situation, &ahead, is_broken, safety));
        if ahead.kind == BarrierKind::FrontTarget {
            for behind in followers(situation, &ahead) {
                visit(&Rear::new(&ahead, behind, safety));
            }
        }
    }
    let ego = &situation.ego;
    let next_s_m = next_s_m(situation, next, safety);
    let (s_m, speed_mps) = (ego.frenet.s_m, ego.state.speed_mps);
    visit(&CurveSpeed::new(
        situation.profile,
        s_m,
        next_s_m,
        speed_mps,
        safety,
    ));
}

/// From where to where on the road the ego vehicle may be one step on: with the noise in position,
/// and side slip that turns the way along the road.
fn next_s_m(situation: &Situation<'_>, next: &FrenetPose, safety: &SafetySettings) -> [f64; 2] {
    let ego = &situation.ego;
    let slip_m =
        ego.state.speed_mps * STEP_S * safety.noise_slip_rad * ego.frenet.psi_rad.sin().abs();
    let noise_m = (safety.noise_position_m + slip_m) * situation.profile.longest_metre();
    [next.s_m - noise_m, next.s_m + noise_m]
}

/// The end of sight that counts: behind tracked vehicles, as long as each of these has a row that
/// holds. Until a vehicle that was just found has one, the sight up to it stays hard where that
/// was enough so far.
fn sight<'a>(
    situation: &Situation<'_>,
    ahead: &Ahead<'_>,
    is_broken: bool,
    safety: &'a SafetySettings,
) -> Sight<'a> {
    let through = Sight::new(ahead, situation.sight.clear_s_m(ahead.lane), safety);
    if !is_broken {
        return through;
    }
    let own = Sight::new(ahead, situation.sight.open_s_m(ahead.lane), safety);
    if own.may_hold() { own } else { through }
}

/// The lanes of a course, as front rows look at them.
pub fn ahead_in<'a>(
    situation: &Situation<'a>,
    course: &Course,
) -> impl Iterator<Item = Ahead<'a>> + use<'a> {
    let (road, ego) = (situation.road(), situation.ego);
    let off_center_m = course.off_center_m(road);
    let leaving = course.target.is_some();
    let in_lane = move |lane: LaneIndex, kind, leaving| {
        Ahead::new(road, ego, lane, off_center_m, kind, leaving)
    };
    let current = course
        .current
        .map(|lane| in_lane(lane, BarrierKind::FrontCurrent, leaving));
    let target = course
        .target
        .map(|lane| in_lane(lane, BarrierKind::FrontTarget, false));
    current.into_iter().chain(target)
}

/// Sideways room within which a body beside the ego vehicle is on its way.
const BESIDE_M: f64 = 0.3;

/// The vehicles ahead in a lane. One that drives beside the ego vehicle and only touches the line
/// of the kept lane can't be braked for.
pub fn leaders<'a>(
    situation: &Situation<'a>,
    ahead: &Ahead<'_>,
) -> impl Iterator<Item = &'a Neighbour> {
    let (ego, lane, kind) = (situation.ego, ahead.lane, ahead.kind);
    situation.neighbours.iter().filter(move |neighbour| {
        neighbour.lanes.contains(lane) && is_in_the_way(neighbour, &ego, kind)
    })
}

/// The CAVs ahead that enter the lane which the ego vehicle is changing to, and announced that
/// before it did. They had precedence and were left room as the change began; nothing may take that
/// before their bodies are there. One that surely stands may go on standing beside the lane.
fn entering<'a>(
    situation: &Situation<'a>,
    ahead: &Ahead<'_>,
    course: &Course,
) -> impl Iterator<Item = &'a Neighbour> {
    let (ego, lane, road) = (situation.ego, ahead.lane, situation.road());
    let time_s = situation.time_s;
    let is_entered = ahead.kind == BarrierKind::FrontTarget;
    let announced_s = course.announced_s.filter(|_| is_entered);
    let neighbours = situation.neighbours.iter();
    neighbours.filter(move |neighbour| {
        let precedes = announced_s.is_some_and(|own_s| neighbour.precedes(&ego, own_s, time_s));
        precedes
            && !neighbour.lanes.contains(lane)
            && neighbour.entering(road) == Some(lane)
            && neighbour.may_move()
            && neighbour.is_ahead_of(&ego)
    })
}

fn is_in_the_way(neighbour: &Neighbour, ego: &EgoState, kind: BarrierKind) -> bool {
    if !neighbour.is_ahead_of(ego) {
        return false;
    }
    let is_clear = neighbour.s_rear_m > ego.frenet.s_m + ego.front_m();
    let half_m = ego.dimensions.width_m / 2.0 + BESIDE_M;
    let overlaps = neighbour.d_left_m > ego.frenet.d_m - half_m
        && neighbour.d_right_m < ego.frenet.d_m + half_m;
    is_clear || overlaps || kind == BarrierKind::FrontTarget
}

fn followers<'a>(
    situation: &Situation<'a>,
    ahead: &Ahead<'_>,
) -> impl Iterator<Item = &'a Neighbour> {
    let (ego, lane) = (situation.ego, ahead.lane);
    situation
        .neighbours
        .iter()
        .filter(move |neighbour| neighbour.lanes.contains(lane) && !neighbour.is_ahead_of(&ego))
}
