use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use covista_world::ControlInput;

use crate::barriers::{Input, Row};

/// U as a box: |tan(delta)| <= `tan_delta`, `accel_min` <= a <= `accel_max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub tan_delta: f64,
    pub accel_min_mps2: f64,
    pub accel_max_mps2: f64,
}

/// The QP's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    pub u: ControlInput,
    /// Largest slack in units of u scaled by U; zero where the rows can be met.
    pub slack: f64,
}

/// Price of a unit of slack. The stages of [`solve_relaxed`] see to it that a feasible brake is
/// never traded for slack.
const SLACK_PRICE: f64 = 1e4;
/// Largest residual, in scaled units, of an answer that counts.
const RESIDUAL: f64 = 1e-7;

/// One inequality `sum coefficient * x <= limit` in scaled variables.
struct Inequality {
    input: Input,
    sign: f64,
    limit: f64,
    soft: bool,
}

/// The program in scaled variables x = u / scale, whose rows all have unit coefficients.
struct Program {
    scale: [f64; 2],
    reference: [f64; 2],
    inequalities: Vec<Inequality>,
}

/// The input nearest to `reference` that meets every row; `None` when there is none or the solver
/// fails.
pub fn solve(reference: ControlInput, rows: &[Row], bounds: Bounds) -> Option<Solution> {
    Program::new(reference, rows, bounds, |_| false).solve()
}

/// As [`solve`], with a slack for every row for which `soft` holds.
pub fn solve_relaxed(
    reference: ControlInput,
    rows: &[Row],
    bounds: Bounds,
    soft: impl Fn(&Row) -> bool,
) -> Option<Solution> {
    Program::new(reference, rows, bounds, soft).solve()
}

impl Program {
    fn new(
        reference: ControlInput,
        rows: &[Row],
        bounds: Bounds,
        soft: impl Fn(&Row) -> bool,
    ) -> Self {
        let accel_scale = bounds
            .accel_max_mps2
            .abs()
            .max(bounds.accel_min_mps2.abs())
            .max(1.0);
        let scale = [bounds.tan_delta.max(1e-6), accel_scale];
        let of = |input: Input| match input {
            Input::TanDelta => scale[0],
            Input::Accel => scale[1],
        };
        // A slack wider than this tells no more; it keeps the numbers in range.
        let widest = 100.0;
        let boxed = [
            (Input::TanDelta, 1.0, bounds.tan_delta),
            (Input::TanDelta, -1.0, bounds.tan_delta),
            (Input::Accel, 1.0, bounds.accel_max_mps2),
            (Input::Accel, -1.0, -bounds.accel_min_mps2),
        ];
        let mut inequalities: Vec<_> = boxed
            .into_iter()
            .map(|(input, sign, limit)| Inequality {
                input,
                sign,
                limit: limit / of(input),
                soft: false,
            })
            .collect();
        for row in rows {
            let sides = [(1.0, row.upper), (-1.0, -row.lower)];
            inequalities.extend(
                sides
                    .into_iter()
                    // A limit that is no number is kept, so that the solver refuses it.
                    .filter(|(_, limit)| limit.is_nan() || *limit < f64::INFINITY)
                    .map(|(sign, limit)| Inequality {
                        input: row.input,
                        sign,
                        limit: (limit / of(row.input)).clamp(-widest, widest),
                        soft: soft(row),
                    }),
            );
        }
        Self {
            scale,
            reference: [
                reference.tan_delta / scale[0],
                reference.accel_mps2 / scale[1],
            ],
            inequalities,
        }
    }

    fn solve(&self) -> Option<Solution> {
        let soft_count = self.inequalities.iter().filter(|row| row.soft).count();
        let variables = 2 + soft_count;
        let row_count = self.inequalities.len() + soft_count;

        let cost = CscMatrix::from(&diagonal(variables, |i| if i < 2 { 1.0 } else { 1e-6 }));
        let mut linear = vec![SLACK_PRICE; variables];
        linear[0] = -self.reference[0];
        linear[1] = -self.reference[1];

        let mut matrix = vec![vec![0.0; variables]; row_count];
        let mut limits = vec![0.0; row_count];
        let mut slack = 2;
        for (i, row) in self.inequalities.iter().enumerate() {
            matrix[i][component(row.input)] = row.sign;
            limits[i] = row.limit;
            if row.soft {
                matrix[i][slack] = -1.0;
                // zeta >= 0
                matrix[self.inequalities.len() + slack - 2][slack] = -1.0;
                slack += 1;
            }
        }
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(1e-12)
            .tol_gap_rel(1e-12)
            .tol_feas(1e-12)
            .build()
            .ok()?;
        let cones = [SupportedConeT::NonnegativeConeT(row_count)];
        let matrix = CscMatrix::from(&matrix);
        let mut solver =
            DefaultSolver::new(&cost, &linear, &matrix, &limits, &cones, settings).ok()?;
        solver.solve();
        let x = &solver.solution.x;
        (solver.solution.status == SolverStatus::Solved && self.residual(x) <= RESIDUAL)
            .then(|| self.snap(x))
    }

    /// The largest violation of an inequality, recomputed.
    fn residual(&self, x: &[f64]) -> f64 {
        let mut slacks = x[2..].iter();
        let worst = |worst: f64, row: &Inequality| {
            let zeta = if row.soft {
                slacks.next().copied().unwrap_or(f64::NAN)
            } else {
                0.0
            };
            let violation = row.sign * x[component(row.input)] - row.limit - zeta;
            // A NaN must not pass as a small number.
            if violation.is_nan() {
                f64::INFINITY
            } else {
                worst.max(violation)
            }
        };
        self.inequalities.iter().fold(0.0, worst)
    }

    /// Takes the interior point's last residual off: moves u onto the hard rows it sits on.
    fn snap(&self, x: &[f64]) -> Solution {
        let snapped = [0, 1].map(|i| {
            self.inequalities
                .iter()
                .filter(|row| !row.soft && component(row.input) == i)
                .fold(x[i], |value, row| {
                    if row.sign > 0.0 {
                        value.min(row.limit)
                    } else {
                        value.max(-row.limit)
                    }
                })
        });
        let zeta = x[2..].iter().fold(0.0_f64, |most, zeta| most.max(*zeta));
        Solution {
            u: ControlInput {
                tan_delta: snapped[0] * self.scale[0],
                accel_mps2: snapped[1] * self.scale[1],
            },
            slack: if zeta > RESIDUAL { zeta } else { 0.0 },
        }
    }
}

fn component(input: Input) -> usize {
    match input {
        Input::TanDelta => 0,
        Input::Accel => 1,
    }
}

fn diagonal(size: usize, entry: impl Fn(usize) -> f64) -> Vec<Vec<f64>> {
    (0..size)
        .map(|i| {
            let mut row = vec![0.0; size];
            row[i] = entry(i);
            row
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use covista_world::BarrierKind;
    use proptest::prelude::*;

    use super::*;

    const BOUNDS: Bounds = Bounds {
        tan_delta: 0.6,
        accel_min_mps2: -8.0,
        accel_max_mps2: 3.0,
    };

    fn accel_row(lower: f64, upper: f64) -> Row {
        Row {
            lower,
            ..Row::at_most(BarrierKind::FrontCurrent, Input::Accel, upper, 1.0)
        }
    }

    proptest! {
        #[test]
        fn clarabel_is_the_projection(
            tan in -1.0..1.0_f64, a in -12.0..6.0_f64,
            first in -7.0..9.0_f64, second in -7.0..9.0_f64, steer in -0.5..0.5_f64,
        ) {
            let rows = [
                accel_row(f64::NEG_INFINITY, first),
                accel_row(f64::NEG_INFINITY, second),
                Row::at_least(BarrierKind::LateralMin, Input::TanDelta, steer, 1.0),
            ];
            let reference = ControlInput { tan_delta: tan, accel_mps2: a };
            let solution = solve(reference, &rows, BOUNDS).expect("feasible");
            let accel = a.clamp(-8.0, first.min(second).min(3.0));
            prop_assert!((solution.u.accel_mps2 - accel).abs() < 1e-6, "{solution:?} {accel}");
            prop_assert!((solution.u.tan_delta - tan.clamp(steer, 0.6)).abs() < 1e-6, "{solution:?}");
            prop_assert!(solution.slack.abs() < 1e-12);
        }
    }

    #[test]
    fn rows_that_exclude_each_other_have_no_answer_without_slack() {
        let rows = [
            accel_row(f64::NEG_INFINITY, -2.0),
            accel_row(1.0, f64::INFINITY),
        ];
        let reference = ControlInput::default();
        assert_eq!(solve(reference, &rows, BOUNDS), None);
        let soft = |row: &Row| row.lower > f64::NEG_INFINITY;
        let relaxed = solve_relaxed(reference, &rows, BOUNDS, soft).expect("relaxed");
        assert!((relaxed.u.accel_mps2 + 2.0).abs() < 1e-6, "{relaxed:?}");
        assert!((relaxed.slack - 3.0 / 8.0).abs() < 1e-6, "{relaxed:?}");
    }

    #[test]
    fn a_reference_that_is_no_number_has_no_answer() {
        let reference = ControlInput {
            tan_delta: f64::NAN,
            accel_mps2: 0.0,
        };
        assert_eq!(solve(reference, &[], BOUNDS), None);
    }
}
