use clarabel::solver::SolverStatus;
use covista_world::BarrierKind;
use proptest::prelude::*;

use super::*;

const BOUNDS: Bounds = Bounds {
    tan_delta: 0.6,
    accel_min_mps2: -8.0,
    accel_max_mps2: 3.0,
};

fn accel(lower: f64, upper: f64) -> Row {
    Row {
        lower,
        ..Row::at_most(BarrierKind::FrontCurrent, Input::Accel, upper, 1.0)
    }
}

fn solved(reference: ControlInput, rows: &[Inequality]) -> Option<Solution> {
    Qp::default().solve(reference, rows.iter().copied(), BOUNDS, 1e4)
}

fn along(tan: f64, accel: f64, least: f64) -> Inequality {
    Inequality {
        coefficients: [tan, accel],
        least,
        soft: false,
    }
}

proptest! {
    #[test]
    fn clarabel_is_the_projection(
        tan in -1.0..1.0_f64, a in -12.0..6.0_f64,
        first in -7.0..9.0_f64, second in -7.0..9.0_f64, steer in -0.5..0.5_f64,
    ) {
        let rows = [
            accel(f64::NEG_INFINITY, first),
            accel(f64::NEG_INFINITY, second),
            Row::at_least(BarrierKind::LateralMin, Input::TanDelta, steer, 1.0),
        ];
        let rows: Vec<_> = rows.iter().flat_map(|row| Inequality::of_row(row, false)).collect();
        let reference = ControlInput { tan_delta: tan, accel_mps2: a };
        let solution = solved(reference, &rows).expect("feasible");
        let accel = a.clamp(-8.0, first.min(second).min(3.0));
        prop_assert!((solution.u.accel_mps2 - accel).abs() < 1e-6, "{solution:?} {accel}");
        prop_assert!((solution.u.tan_delta - tan.clamp(steer, 0.6)).abs() < 1e-6, "{solution:?}");
        prop_assert!(solution.slack.abs() < 1e-12);
    }

    /// One coupling row: the projection onto a half plane, in units of U, where the box is not met.
    #[test]
    fn a_coupled_row_is_projected_onto(
        tan in -0.2..0.2_f64, a in -3.0..1.0_f64, slope in -1.0..1.0_f64, lift in 0.0..0.1_f64,
    ) {
        let row = along(1.0, slope / 8.0, tan + slope * a / 8.0 + lift);
        let solution = solved(ControlInput { tan_delta: tan, accel_mps2: a }, &[row]).expect("feasible");
        // x = u / (0.6, 8): normal (0.6, slope), distance lift / |normal|.
        let square = 0.36 + slope * slope;
        let expected = [tan + 0.6 * 0.6 * lift / square, a + 8.0 * slope * lift / square];
        prop_assert!((solution.u.tan_delta - expected[0]).abs() < 1e-6, "{solution:?} {expected:?}");
        prop_assert!((solution.u.accel_mps2 - expected[1]).abs() < 1e-6, "{solution:?} {expected:?}");
    }
}

#[test]
fn one_solver_answers_many_programs_as_new_ones_do() {
    let mut warm = Qp::default();
    for i in 0..300 {
        let x = f64::from(i);
        let reference = ControlInput {
            tan_delta: 0.7 * (1.3 * x).sin(),
            accel_mps2: 6.0 * (0.7 * x).cos(),
        };
        let rows: Vec<_> = (0..i % 23)
            .map(|k| {
                let y = x + f64::from(k);
                Inequality {
                    soft: i % 5 == 0,
                    ..along(
                        (2.1 * y).sin(),
                        0.1 * (1.7 * y).cos(),
                        -0.05 + 0.02 * y.sin(),
                    )
                }
            })
            .collect();
        let (again, new) = (
            warm.solve(reference, rows.iter().copied(), BOUNDS, 1e4),
            solved(reference, &rows),
        );
        match (again, new) {
            (Some(again), Some(new)) => {
                assert!((again.u.tan_delta - new.u.tan_delta).abs() < 1e-6, "{i}");
                assert!((again.u.accel_mps2 - new.u.accel_mps2).abs() < 1e-6, "{i}");
            }
            (again, new) => assert_eq!(again, new, "{i}"),
        }
    }
}

#[test]
fn rows_that_exclude_each_other_have_no_answer_without_slack() {
    let rows = [accel(f64::NEG_INFINITY, -2.0), accel(1.0, f64::INFINITY)];
    let reference = ControlInput::default();
    let hard: Vec<_> = rows
        .iter()
        .flat_map(|row| Inequality::of_row(row, false))
        .collect();
    assert_eq!(solved(reference, &hard), None);
    let soft: Vec<_> = rows
        .iter()
        .flat_map(|row| Inequality::of_row(row, row.lower > f64::NEG_INFINITY))
        .collect();
    let relaxed = solved(reference, &soft).expect("relaxed");
    assert!((relaxed.u.accel_mps2 + 2.0).abs() < 1e-6, "{relaxed:?}");
    // a >= 1 is missed by 3 m/s^2.
    assert!((relaxed.slack - 3.0).abs() < 1e-5, "{relaxed:?}");
}

#[test]
fn a_row_with_vanishing_gradient_is_met_or_not() {
    let reference = ControlInput::default();
    let met = solved(reference, &[along(0.0, 0.0, -0.1)]).expect("met");
    assert!(met.u.accel_mps2.abs() < 1e-6 && met.u.tan_delta.abs() < 1e-6);
    assert_eq!(solved(reference, &[along(0.0, 0.0, 0.1)]), None);
    let soft = Inequality {
        soft: true,
        ..along(0.0, 0.0, 0.1)
    };
    let relaxed = solved(reference, &[soft]).expect("relaxed");
    assert!((relaxed.slack - 0.1).abs() < 1e-6, "{relaxed:?}");
    assert!(relaxed.u.accel_mps2.abs() < 1e-6);
}

#[test]
fn numbers_that_are_none_have_no_answer() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let tan = ControlInput {
            tan_delta: bad,
            accel_mps2: 0.0,
        };
        let accel = ControlInput {
            tan_delta: 0.0,
            accel_mps2: bad,
        };
        assert_eq!(solved(tan, &[]), None);
        assert_eq!(solved(accel, &[]), None);
    }
    let none = ControlInput::default();
    assert_eq!(solved(none, &[along(f64::NAN, 0.0, 0.0)]), None);
    assert_eq!(solved(none, &[along(1.0, 0.0, f64::NAN)]), None);
    // An infinite limit can't be met.
    assert_eq!(solved(none, &[along(1.0, 0.0, f64::INFINITY)]), None);
    let nan_row = accel(f64::NAN, f64::INFINITY);
    let rows: Vec<_> = Inequality::of_row(&nan_row, false).collect();
    assert_eq!(solved(none, &rows), None);
}

#[test]
fn no_status_but_solved_counts() {
    let mut program = Program::new(8, false).expect("a program");
    program.fill([0.0, 0.0], &[], BOUNDS, 1e4);
    let inside = [0.1, -0.2];
    for status in [
        SolverStatus::Unsolved,
        SolverStatus::PrimalInfeasible,
        SolverStatus::DualInfeasible,
        SolverStatus::AlmostSolved,
        SolverStatus::AlmostPrimalInfeasible,
        SolverStatus::AlmostDualInfeasible,
        SolverStatus::MaxIterations,
        SolverStatus::MaxTime,
        SolverStatus::NumericalError,
        SolverStatus::InsufficientProgress,
    ] {
        assert_eq!(program.answer(status, &inside), None, "{status:?}");
    }
    let answer = program
        .answer(SolverStatus::Solved, &inside)
        .expect("solved");
    assert!((answer.u.tan_delta - 0.06).abs() < 1e-12);
    assert!((answer.u.accel_mps2 + 1.6).abs() < 1e-12);
    // It says solved, but its residuals do not.
    assert_eq!(program.answer(SolverStatus::Solved, &[1.1, 0.0]), None);
    assert_eq!(program.answer(SolverStatus::Solved, &[0.0, f64::NAN]), None);
}
