//! The projection: what it does where rows are met, out of U, or exclude each other.

use covista_world::{BarrierKind, FilterOutcome};

use super::*;
use crate::barriers::affine::AffineRow;
use crate::barriers::bounds::Bounds;
use crate::barriers::{Input, Row};
use crate::filter::{Filtered, filter};
use crate::qp::Qp;
use crate::{QpSettings, Solver};

const BOTH: [Solver; 2] = [Solver::ClosedForm, Solver::Clarabel];

fn rows(hard: &[Row], rear: &[Row]) -> Rows {
    Rows {
        bounds: Bounds {
            tan_delta: 0.5,
            accel_min_mps2: -8.0,
            accel_max_mps2: 3.0,
        },
        hard: hard.to_vec(),
        rear: rear.to_vec(),
        h_lateral_m: 1.0,
    }
}

fn filtered(u: ControlInput, rows: &Rows, affine: &[AffineRow], solver: Solver) -> Filtered {
    filter(
        u,
        rows,
        affine,
        &mut Qp::default(),
        solver,
        &QpSettings::default(),
    )
}

fn front(upper: f64) -> Row {
    Row::at_most(BarrierKind::FrontCurrent, Input::Accel, upper, 1.0)
}

fn rear(lower: f64) -> Row {
    Row::at_least(BarrierKind::RearTarget, Input::Accel, lower, 1.0)
}

fn left(upper: f64, h: f64) -> Row {
    Row::at_most(BarrierKind::LateralMax, Input::TanDelta, upper, h)
}

fn right(lower: f64, h: f64) -> Row {
    Row::at_least(BarrierKind::LateralMin, Input::TanDelta, lower, h)
}

fn near(found: Filtered, u: ControlInput) {
    let tan = (found.u.tan_delta - u.tan_delta).abs();
    let accel = (found.u.accel_mps2 - u.accel_mps2).abs();
    assert!(tan < 1e-6 && accel < 1e-6, "{found:?} {u:?}");
}

#[test]
fn what_is_within_every_row_is_applied_as_it_is() {
    for solver in BOTH {
        let found = filtered(
            input(0.1, -1.0),
            &rows(&[front(-1.0), left(0.1, 1.0)], &[]),
            &[],
            solver,
        );
        assert_eq!(found.u, input(0.1, -1.0));
        assert_eq!(
            (found.outcome, found.binding),
            (FilterOutcome::Nominal, None)
        );
    }
}

#[test]
fn what_is_out_of_u_is_moved_and_no_row_is_named() {
    for (wanted, reached) in [
        (input(0.0, 9.0), input(0.0, 3.0)),
        (input(0.0, -9.0), input(0.0, -8.0)),
        (input(0.9, 1.0), input(0.5, 1.0)),
        (input(-0.9, 1.0), input(-0.5, 1.0)),
        (input(0.9, 9.0), input(0.5, 3.0)),
    ] {
        for solver in BOTH {
            // Rows that the reference meets.
            let met = rows(&[front(20.0), left(2.0, 1.0)], &[rear(-20.0)]);
            let found = filtered(wanted, &met, &[], solver);
            near(found, reached);
            assert_eq!(
                (found.outcome, found.binding),
                (FilterOutcome::Filtered, None)
            );
        }
    }
}

#[test]
fn the_row_that_is_missed_most_is_named() {
    for solver in BOTH {
        let both = rows(&[front(0.5), left(0.1, 1.0)], &[]);
        // 0.3 of a lock counts as 3 m/s^2.
        let found = filtered(input(0.4, 1.0), &both, &[], solver);
        near(found, input(0.1, 0.5));
        assert_eq!(found.binding, Some(BarrierKind::LateralMax));
        let found = filtered(input(0.11, 1.0), &both, &[], solver);
        assert_eq!(found.binding, Some(BarrierKind::FrontCurrent));
        let found = filtered(
            input(0.0, -5.0),
            &rows(&[front(0.5)], &[rear(-1.0)]),
            &[],
            solver,
        );
        near(found, input(0.0, -1.0));
        assert_eq!(found.binding, Some(BarrierKind::RearTarget));
    }
}

#[test]
fn before_a_follower_the_front_has_precedence() {
    for solver in BOTH {
        let found = filtered(
            input(0.0, 0.0),
            &rows(&[front(-2.0)], &[rear(1.0)]),
            &[],
            solver,
        );
        near(found, input(0.0, -2.0));
        // What a follower misses is told apart from the hard rows.
        assert_eq!(found.outcome, FilterOutcome::Filtered, "{found:?}");
    }
}

#[test]
fn a_row_that_is_missed_by_little_more_than_rounding_is_missed() {
    for (by, outcome) in [
        (2e-10, FilterOutcome::Filtered),
        (1e-6, FilterOutcome::Relaxed),
    ] {
        let torn = rows(&[left(-0.1, 0.0), right(-0.1 + by, 0.0)], &[]);
        let found = filtered(input(0.0, 0.0), &torn, &[], Solver::ClosedForm);
        assert_eq!(found.outcome, outcome, "{by}");
    }
}

#[test]
fn steering_rows_that_exclude_each_other_leave_it_to_the_lower_barrier() {
    let torn = |left_h: f64, right_h: f64| {
        let torn = rows(&[left(-0.1, left_h), right(0.2, right_h), front(2.0)], &[]);
        filtered(input(0.0, 1.0), &torn, &[], Solver::ClosedForm)
    };
    let to_the_right = torn(-0.2, -0.1);
    near(to_the_right, input(-0.1, 0.0));
    assert_eq!(to_the_right.outcome, FilterOutcome::Relaxed);
    near(torn(-0.1, -0.2), input(0.2, 0.0));
    // It gains no speed, but brakes as wanted.
    let braking = rows(&[left(-0.1, -0.2), right(0.2, -0.1)], &[]);
    near(
        filtered(input(0.0, -3.0), &braking, &[], Solver::ClosedForm),
        input(-0.1, -3.0),
    );
    // By Clarabel each is missed by as much as its price says, and U is kept.
    let found = filtered(input(0.0, 1.0), &braking, &[], Solver::Clarabel);
    assert_eq!(found.outcome, FilterOutcome::Relaxed);
    assert!(
        (-0.1 - 1e-6..=0.2 + 1e-6).contains(&found.u.tan_delta),
        "{found:?}"
    );
}

#[test]
fn limits_that_just_touch_leave_one_input() {
    for solver in BOTH {
        let touching = rows(&[left(0.1, 1.0), right(0.1, 1.0), front(-8.0)], &[]);
        let found = filtered(input(0.0, 0.0), &touching, &[], solver);
        if solver == Solver::ClosedForm {
            near(found, input(0.1, -8.0));
            assert_eq!(found.outcome, FilterOutcome::Filtered);
        }
        // Braking that is just hard enough.
        let found = filtered(input(0.0, 0.0), &rows(&[front(-8.0)], &[]), &[], solver);
        near(found, input(0.0, -8.0));
        assert_eq!(found.outcome, FilterOutcome::Filtered, "{solver:?}");
    }
}

#[test]
fn with_an_affine_row_the_answer_is_clarabels() {
    let row = |least: f64| AffineRow {
        kind: BarrierKind::Affine(0),
        coefficients: [0.0, -1.0],
        least,
    };
    for solver in BOTH {
        let found = filtered(input(0.0, 2.0), &rows(&[], &[]), &[row(-1.0)], solver);
        near(found, input(0.0, 1.0));
        assert_eq!(found.outcome, FilterOutcome::Filtered);
        assert_eq!(found.binding, Some(BarrierKind::Affine(0)));
        let met = filtered(input(0.0, 0.5), &rows(&[], &[]), &[row(-1.0)], solver);
        assert_eq!(met.outcome, FilterOutcome::Nominal);
        // a <= -9 is out of U.
        let torn = filtered(input(0.0, 0.5), &rows(&[], &[]), &[row(9.0)], solver);
        assert_eq!(torn.outcome, FilterOutcome::Relaxed);
        near(torn, input(0.0, -8.0));
    }
}

#[test]
fn a_follower_gives_way_to_ones_own_barrier_and_that_to_the_front() {
    let own = |coefficient: f64, least: f64| AffineRow {
        kind: BarrierKind::Affine(0),
        coefficients: [0.0, coefficient],
        least,
    };
    for solver in BOTH {
        // a >= 1 for the follower, a <= -1 for the own barrier.
        let behind = rows(&[], &[rear(1.0)]);
        let found = filtered(input(0.0, 0.0), &behind, &[own(-1.0, 1.0)], solver);
        near(found, input(0.0, -1.0));
        assert_eq!(found.outcome, FilterOutcome::Filtered);
        // a <= -2 for the front, a >= 0 for the own barrier.
        let ahead = rows(&[front(-2.0)], &[]);
        let found = filtered(input(0.0, 0.0), &ahead, &[own(1.0, 0.0)], solver);
        near(found, input(0.0, -2.0));
        assert_eq!(found.outcome, FilterOutcome::Relaxed);
    }
}

#[test]
fn no_answer_is_a_backup() {
    let nan = AffineRow {
        kind: BarrierKind::Affine(0),
        coefficients: [1.0, 1.0],
        least: f64::NAN,
    };
    let found = filtered(input(0.0, 9.0), &rows(&[], &[]), &[nan], Solver::ClosedForm);
    assert_eq!(found.outcome, FilterOutcome::Backup, "{found:?}");
}
