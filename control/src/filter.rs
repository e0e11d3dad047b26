use covista_world::{BarrierKind, ControlInput, FilterOutcome};

use crate::barriers::Row;
use crate::qp::{self, Bounds};
use crate::rows::Rows;

/// What the filter makes of a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Filtered {
    /// The input to apply.
    pub u: ControlInput,
    /// How it came about.
    pub outcome: FilterOutcome,
    /// The row that moved it.
    pub binding: Option<BarrierKind>,
}

/// The input nearest to the reference within the safe set.
///
/// A reference that meets every row is the QP's minimiser itself. Otherwise Clarabel solves the
/// QP with zeta = 0; only when that has no solution are rows relaxed: first those towards
/// followers (the lane change has begun, the front has precedence), then all others. An answer
/// counts only when it is finite and within U; failing that comes hardest braking.
pub fn filter(reference: ControlInput, rows: &Rows, last_tan_delta: f64) -> Filtered {
    let every: Vec<Row> = rows.hard.iter().chain(&rows.rear).copied().collect();
    if is_within(reference, rows.bounds) && every.iter().all(|row| row.admits(reference)) {
        return Filtered {
            u: reference,
            outcome: FilterOutcome::Nominal,
            binding: None,
        };
    }
    // Braking that is just hard enough leaves no interior; a hair of room restores it.
    let roomy = Bounds {
        accel_min_mps2: rows.bounds.accel_min_mps2 - 1e-6,
        ..rows.bounds
    };
    let is_rear = |row: &Row| row.kind == BarrierKind::RearTarget;
    let solution = qp::solve(reference, &every, roomy)
        .or_else(|| {
            (!rows.rear.is_empty())
                .then(|| qp::solve_relaxed(reference, &every, roomy, is_rear))
                .flatten()
        })
        .or_else(|| qp::solve_relaxed(reference, &rows.hard, roomy, |_| true));
    let valid = solution
        .map(|solution| (clamp(solution.u, rows.bounds), solution.slack))
        .filter(|(u, _)| is_within(*u, rows.bounds));
    match valid {
        Some((u, slack)) => Filtered {
            u,
            outcome: if slack > 0.0 {
                FilterOutcome::Relaxed
            } else {
                FilterOutcome::Filtered
            },
            binding: binding(reference, &every),
        },
        None => Filtered {
            u: backup(rows.bounds, last_tan_delta),
            outcome: FilterOutcome::Backup,
            binding: binding(reference, &every),
        },
    }
}

/// Hardest braking, with the steering held as far as the tyres allow.
pub fn backup(bounds: Bounds, last_tan_delta: f64) -> ControlInput {
    ControlInput {
        tan_delta: last_tan_delta.clamp(-bounds.tan_delta, bounds.tan_delta),
        accel_mps2: bounds.accel_min_mps2,
    }
}

/// The row that the reference violates most, in shares of its own scale.
fn binding(reference: ControlInput, rows: &[Row]) -> Option<BarrierKind> {
    rows.iter()
        .map(|row| (row.violation(reference), row.kind))
        .filter(|(violation, _)| *violation > 0.0)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, kind)| kind)
}

fn clamp(u: ControlInput, bounds: Bounds) -> ControlInput {
    ControlInput {
        tan_delta: u.tan_delta.clamp(-bounds.tan_delta, bounds.tan_delta),
        accel_mps2: u
            .accel_mps2
            .clamp(bounds.accel_min_mps2, bounds.accel_max_mps2),
    }
}

fn is_within(u: ControlInput, bounds: Bounds) -> bool {
    // A NaN fails both comparisons.
    u.tan_delta.abs() <= bounds.tan_delta
        && (bounds.accel_min_mps2..=bounds.accel_max_mps2).contains(&u.accel_mps2)
}
