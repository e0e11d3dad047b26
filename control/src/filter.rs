use covista_world::{BarrierKind, ControlInput, FilterOutcome};

use crate::barriers::affine::AffineRow;
use crate::barriers::bounds::Bounds;
use crate::barriers::{Input, Row};
use crate::qp::{Inequality, Qp};
use crate::rows::Rows;
use crate::{QpSettings, Solver};

/// What the filter makes of a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filtered {
    /// The input nearest to the reference.
    pub u: ControlInput,
    /// `Nominal`, `Filtered`, or `Relaxed` where a hard row is missed; `Backup` where there is no
    /// answer.
    pub outcome: FilterOutcome,
    /// The row that moved it.
    pub binding: Option<BarrierKind>,
}

/// How far an interval may be turned inside out by rounding.
const ROUNDING: f64 = 1e-9;

/// The input nearest to the reference within the safe set, zeta = 0; where there is none, the one
/// that misses the rows least: first those towards followers (the lane change has begun, the front
/// has precedence), then the others, U never.
///
/// The rows are intervals, so that the QP is a projection with a closed form. `affine` rows couple
/// the inputs: with them the answer is Clarabel's.
pub fn filter(
    reference: ControlInput,
    rows: &Rows,
    affine: &[AffineRow],
    qp: &mut Qp,
    solver: Solver,
    settings: &QpSettings,
) -> Filtered {
    let is_met = |u: ControlInput| {
        is_within(u, rows.bounds)
            && every(rows).all(|row| row.admits(u))
            && affine.iter().all(|row| row.shortfall(u) <= ROUNDING)
    };
    if is_met(reference) {
        return Filtered {
            u: reference,
            outcome: FilterOutcome::Nominal,
            binding: None,
        };
    }
    let answer = if solver == Solver::ClosedForm && affine.is_empty() {
        Some(project(reference, rows))
    } else {
        solve(reference, rows, affine, qp, settings)
    };
    let answer = answer.map(|u| rows.bounds.clamp(u));
    let binding = binding(reference, rows, affine);
    match answer {
        Some(u) => Filtered {
            u,
            outcome: if nearly_met(u, rows, affine) {
                FilterOutcome::Filtered
            } else {
                FilterOutcome::Relaxed
            },
            binding,
        },
        None => Filtered {
            u: reference,
            outcome: FilterOutcome::Backup,
            binding,
        },
    }
}

/// The closed form.
fn project(reference: ControlInput, rows: &Rows) -> ControlInput {
    let (least_tan, most_tan) = rows.interval(Input::TanDelta);
    let (_, most_accel) = rows.interval(Input::Accel);
    let follower = (rows.rear.iter()).fold(f64::NEG_INFINITY, |least, row| least.max(row.lower));
    let accel = reference.accel_mps2.max(follower).min(most_accel);
    if least_tan <= most_tan {
        return ControlInput {
            tan_delta: reference.tan_delta.max(least_tan).min(most_tan),
            accel_mps2: accel,
        };
    }
    // The rows exclude each other: the lowest barrier decides, and the vehicle gains no speed. A
    // barrier that no steering can meet decides nothing.
    let lowest = (rows.hard.iter())
        .filter(|row| row.input == Input::TanDelta && row.h.is_finite())
        .min_by(|a, b| a.h.total_cmp(&b.h));
    let tan = lowest.map_or(0.0, |row| reference.tan_delta.max(row.lower).min(row.upper));
    ControlInput {
        tan_delta: tan,
        accel_mps2: accel.min(0.0),
    }
}

/// The same by Clarabel: with zeta = 0; then with slack for followers; then for the user's own
/// barriers, which must not outbid the others; then for every row.
fn solve(
    reference: ControlInput,
    rows: &Rows,
    affine: &[AffineRow],
    qp: &mut Qp,
    settings: &QpSettings,
) -> Option<ControlInput> {
    // Braking that is just hard enough leaves no interior; a hair of room restores it.
    let roomy = Bounds {
        accel_min_mps2: rows.bounds.accel_min_mps2 - 1e-6,
        ..rows.bounds
    };
    (0..4).find_map(|stage| {
        let (soft_rear, soft_own, soft) = (stage > 0, stage > 1, stage > 2);
        let hard = (rows.hard.iter()).flat_map(|row| Inequality::of_row(row, soft));
        let rear = (rows.rear.iter()).flat_map(|row| Inequality::of_row(row, soft_rear));
        let affine = (affine.iter()).map(|row| Inequality::of_affine(row, soft_own));
        let inequalities = hard.chain(rear).chain(affine);
        qp.solve(reference, inequalities, roomy, settings.slack_price)
            .map(|solution| solution.u)
    })
}

fn every(rows: &Rows) -> impl Iterator<Item = &Row> {
    rows.hard.iter().chain(&rows.rear)
}

/// Whether `u` meets every hard row, but for rounding. What it misses of those towards followers is
/// reported by itself.
fn nearly_met(u: ControlInput, rows: &Rows, affine: &[AffineRow]) -> bool {
    (rows.hard.iter()).all(|row| row.violation(u) <= 10.0 * ROUNDING)
        && affine.iter().all(|row| row.shortfall(u) <= 10.0 * ROUNDING)
}

/// The row that the reference violates most, in shares of its own scale.
fn binding(reference: ControlInput, rows: &Rows, affine: &[AffineRow]) -> Option<BarrierKind> {
    let of_rows = every(rows).map(|row| (row.violation(reference), row.kind));
    let of_affine = affine
        .iter()
        .map(|row| (row.shortfall(reference), row.kind));
    of_rows
        .chain(of_affine)
        .filter(|(violation, _)| *violation > 0.0)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, kind)| kind)
}

fn is_within(u: ControlInput, bounds: Bounds) -> bool {
    // A NaN fails both comparisons.
    u.tan_delta.abs() <= bounds.tan_delta
        && (bounds.accel_min_mps2..=bounds.accel_max_mps2).contains(&u.accel_mps2)
}
