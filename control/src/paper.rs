//! The paper's CBF-QP as its text has it (Section V-A, "The CBF-QP"): barriers on position alone.
//!
//! It is here to be looked at. Rows 1 and 2 of g(x) are zero, so that p'g(x) u = 0 for each of
//! these barriers: the constraint does not contain u, the slack takes what is missing, and the
//! answer is the reference (docs/safety.md).

use covista_world::{BarrierKind, ControlInput, FilterOutcome, LaneIndex};

use crate::barriers::affine::{AffineBarrier, AffineRow, Dynamics};
use crate::barriers::bounds::Bounds;
use crate::filter::Filtered;
use crate::manoeuvre::Course;
use crate::qp::{Inequality, Qp};
use crate::{Formulation, Neighbour, QpSettings, SafetySettings, Situation};

/// Every row of the paper's QP for one step.
pub fn rows<'a>(
    situation: &'a Situation<'_>,
    course: &'a Course,
    safety: &'a SafetySettings,
    qp: &'a QpSettings,
) -> impl Iterator<Item = AffineRow> + use<'a> {
    let ego = &situation.ego;
    let dynamics = Dynamics::new(&ego.frenet, ego.state.speed_mps, ego.dimensions.wheelbase_m);
    let noise_m = match qp.formulation {
        Formulation::Noisy => safety.noise_position_m,
        Formulation::NoiseFree | Formulation::Relaxed => 0.0,
    };
    barriers(situation, course, safety).map(move |(kind, barrier)| {
        // As written: -p'W 1, which loosens the row where p < 0, instead of -|p|_1 W.
        let noise = barrier.p.iter().sum::<f64>() * noise_m;
        barrier.row(kind, &dynamics, safety.eta, noise)
    })
}

/// The paper's QP: the input nearest to the reference, at the price of slack where the formulation
/// has it.
pub fn answer(
    reference: ControlInput,
    rows: &[AffineRow],
    bounds: Bounds,
    qp: &mut Qp,
    settings: &QpSettings,
) -> Filtered {
    let soft = settings.formulation != Formulation::NoiseFree;
    let inequalities = rows.iter().map(|row| Inequality::of_affine(row, soft));
    let missed = rows
        .iter()
        .max_by(|a, b| a.shortfall(reference).total_cmp(&b.shortfall(reference)))
        .filter(|row| row.shortfall(reference) > 0.0);
    let solution = qp.solve(reference, inequalities, bounds, settings.slack_price);
    let (u, outcome) = match solution {
        Some(solution) if solution.slack > 0.0 => (solution.u, FilterOutcome::Relaxed),
        Some(solution) => (solution.u, FilterOutcome::Filtered),
        None => (
            ControlInput {
                accel_mps2: bounds.accel_min_mps2,
                ..reference
            },
            FilterOutcome::Backup,
        ),
    };
    Filtered {
        u: bounds.clamp(u),
        outcome,
        binding: missed.map(|row| row.kind),
    }
}

/// h_fc, and during a lane change h_ft and h_bt; h_y,max and h_y,min.
fn barriers<'a>(
    situation: &'a Situation<'_>,
    course: &'a Course,
    safety: &'a SafetySettings,
) -> impl Iterator<Item = (BarrierKind, AffineBarrier)> + use<'a> {
    let ahead = |lane: LaneIndex| nearest(situation, lane, true);
    let front_current = course.current.and_then(ahead);
    let front_target = course.target.and_then(ahead);
    let rear_target = (course.target).and_then(|lane| nearest(situation, lane, false));
    let lengthways = [
        (BarrierKind::FrontCurrent, front_current),
        (BarrierKind::FrontTarget, front_target),
        (BarrierKind::RearTarget, rear_target),
    ]
    .into_iter()
    .filter_map(|(kind, other)| other.map(|other| (kind, distance(situation, other, safety))));
    let bounds_m = course
        .strip
        .map(|lane| situation.road().lane_bounds_m(lane));
    let right_m = bounds_m[0].0.min(bounds_m[1].0);
    let left_m = bounds_m[0].1.max(bounds_m[1].1);
    let sideways = [
        (
            BarrierKind::LateralMax,
            affine([0.0, -1.0, 0.0, 0.0], left_m),
        ),
        (
            BarrierKind::LateralMin,
            affine([0.0, 1.0, 0.0, 0.0], -right_m),
        ),
    ];
    lengthways.chain(sideways)
}

/// |p_x - p_x,k| - P_safe between the bodies' centres, with p_x,k where it is now.
fn distance(
    situation: &Situation<'_>,
    other: &Neighbour,
    safety: &SafetySettings,
) -> AffineBarrier {
    let centre_m = situation.ego.dimensions.center_ahead_of_axle_m();
    let away_m = other.center_s_m() - centre_m;
    let ahead = if away_m >= situation.ego.frenet.s_m {
        1.0
    } else {
        -1.0
    };
    affine(
        [-ahead, 0.0, 0.0, 0.0],
        ahead * away_m - safety.headway_safe_m,
    )
}

fn affine(p: [f64; 4], q: f64) -> AffineBarrier {
    AffineBarrier { p, q }
}

/// The nearest vehicle ahead or behind in a lane.
fn nearest<'a>(situation: &Situation<'a>, lane: LaneIndex, ahead: bool) -> Option<&'a Neighbour> {
    let ego = situation.ego;
    let distance_m = |other: &Neighbour| (other.center_s_m() - ego.frenet.s_m).abs();
    situation
        .neighbours
        .iter()
        .filter(|other| other.lanes.contains(lane) && other.is_ahead_of(&ego) == ahead)
        .min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
}
