use std::fmt;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use covista_world::ControlInput;

use crate::barriers::affine::AffineRow;
use crate::barriers::bounds::Bounds;
use crate::barriers::{Input, Row};

/// The QP's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The minimiser.
    pub u: ControlInput,
    /// The largest slack; zero where the rows can be met.
    pub slack: f64,
}

/// An inequality `coefficients . u >= least - zeta`; zeta is zero unless it is `soft`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inequality {
    /// Of tan(delta) and a.
    pub coefficients: [f64; 2],
    /// What they must reach.
    pub least: f64,
    /// Whether slack may be used.
    pub soft: bool,
}

impl Inequality {
    /// The one or two sides of an interval row.
    pub fn of_row(row: &Row, soft: bool) -> impl Iterator<Item = Self> {
        let along = |sign: f64| match row.input {
            Input::TanDelta => [sign, 0.0],
            Input::Accel => [0.0, sign],
        };
        [(1.0, row.lower), (-1.0, -row.upper)]
            .into_iter()
            // A limit that is no number is kept, so that it is refused.
            .filter(|(_, least)| *least != f64::NEG_INFINITY)
            .map(move |(sign, least)| Self {
                coefficients: along(sign),
                least,
                soft,
            })
    }

    /// An affine row.
    pub fn of_affine(row: &AffineRow, soft: bool) -> Self {
        Self {
            coefficients: row.coefficients,
            least: row.least,
            soft,
        }
    }
}

/// Largest residual, in units of U, of an answer that counts.
const RESIDUAL: f64 = 1e-7;
/// Limits farther out than this, in units of U, tell no more; it keeps the numbers in range.
const WIDEST: f64 = 100.0;
/// Of the slack's square: makes the minimiser unique.
const SLACK_SQUARE: f64 = 1e-6;

/// Clarabel's solver for one program after the other: minimise ||u - reference||^2 + M zeta, the
/// norm in units of U. Its matrices keep their pattern, so that only numbers change from step to
/// step.
#[derive(Default)]
pub struct Qp {
    hard: Option<Program>,
    relaxed: Option<Program>,
    inequalities: Vec<Inequality>,
}

impl fmt::Debug for Qp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Qp").finish_non_exhaustive()
    }
}

impl Clone for Qp {
    /// A solver without memory of programs: nothing of them reaches the next answer.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Qp {
    /// The input nearest to `reference` that meets every inequality within `bounds`; `None` when
    /// there is none or the solver fails.
    pub fn solve(
        &mut self,
        reference: ControlInput,
        inequalities: impl Iterator<Item = Inequality>,
        bounds: Bounds,
        slack_price: f64,
    ) -> Option<Solution> {
        self.inequalities.clear();
        self.inequalities.extend(inequalities);
        // A row that no input moves is met or not; as a row it would stall the solver.
        let is_empty = |row: &Inequality| {
            !row.soft
                && row
                    .coefficients
                    .iter()
                    .all(|coefficient| coefficient.abs() <= 0.0)
        };
        if self
            .inequalities
            .iter()
            .any(|row| is_empty(row) && row.least > 0.0)
        {
            return None;
        }
        self.inequalities
            .retain(|row| !is_empty(row) || row.least.is_nan());
        let relaxed = self.inequalities.iter().any(|row| row.soft);
        let slot = if relaxed {
            &mut self.relaxed
        } else {
            &mut self.hard
        };
        let needed = self.inequalities.len() + BOX_ROWS;
        if slot
            .as_ref()
            .is_none_or(|program| program.capacity < needed)
        {
            *slot = Program::new(needed.next_multiple_of(8), relaxed);
        }
        slot.as_mut()?
            .solve(reference, &self.inequalities, bounds, slack_price)
    }
}

/// Rows that U takes.
const BOX_ROWS: usize = 4;

/// The program in variables x = u / scale (and one slack for each row), `A x + s = b`, s >= 0.
struct Program {
    solver: DefaultSolver<f64>,
    capacity: usize,
    relaxed: bool,
    scale: [f64; 2],
    /// Entries of A, column by column; limits b; linear cost q.
    entries: Vec<f64>,
    limits: Vec<f64>,
    linear: Vec<f64>,
}

impl Program {
    fn new(capacity: usize, relaxed: bool) -> Option<Self> {
        let slacks = if relaxed { capacity } else { 0 };
        let (variables, rows) = (2 + slacks, capacity + slacks);
        let mut columns = vec![0, capacity, 2 * capacity];
        let mut places: Vec<usize> = (0..capacity).chain(0..capacity).collect();
        for slack in 0..slacks {
            places.extend([slack, capacity + slack]);
            columns.push(places.len());
        }
        let entries = vec![1.0; places.len()];
        let matrix = CscMatrix::new(rows, variables, columns, places, entries.clone());
        let diagonal = (0..variables).map(|i| if i < 2 { 1.0 } else { SLACK_SQUARE });
        let cost = CscMatrix::new(
            variables,
            variables,
            (0..=variables).collect(),
            (0..variables).collect(),
            diagonal.collect(),
        );
        let (limits, linear) = (vec![1.0; rows], vec![0.0; variables]);
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(1e-12)
            .tol_gap_rel(1e-12)
            .tol_feas(1e-12)
            .presolve_enable(false)
            .input_sparse_dropzeros(false)
            .build()
            .ok()?;
        let cones = [SupportedConeT::NonnegativeConeT(rows)];
        let solver = DefaultSolver::new(&cost, &linear, &matrix, &limits, &cones, settings).ok()?;
        Some(Self {
            solver,
            capacity,
            relaxed,
            scale: [1.0; 2],
            entries,
            limits,
            linear,
        })
    }

    fn solve(
        &mut self,
        reference: ControlInput,
        inequalities: &[Inequality],
        bounds: Bounds,
        slack_price: f64,
    ) -> Option<Solution> {
        let coupled = |row: &Inequality| row.coefficients.iter().all(|c| c.abs() > 0.0);
        // With intervals alone the projection goes by way of U; far outside the solver stalls.
        let reference = if inequalities.iter().any(coupled) {
            reference
        } else {
            clamped(reference, bounds)
        };
        let wanted = [reference.tan_delta, reference.accel_mps2];
        let numbers = inequalities
            .iter()
            .flat_map(|row| row.coefficients.into_iter().chain([row.least]));
        if numbers.chain(wanted).any(f64::is_nan) || wanted.iter().any(|x| x.is_infinite()) {
            return None;
        }
        self.fill(wanted, inequalities, bounds, slack_price);
        self.solver.update_q(&self.linear).ok()?;
        self.solver.update_A(&self.entries).ok()?;
        self.solver.update_b(&self.limits).ok()?;
        self.solver.solve();
        let solution = self.answer(self.solver.solution.status, &self.solver.solution.x)?;
        Some(self.polished(solution, reference, inequalities))
    }

    /// An interior point stops a root of its tolerance from where a limit and the reference nearly
    /// coincide. Where only intervals bind, each component is at its active limit (dual above
    /// slack) or at the reference itself.
    fn polished(
        &self,
        solution: Solution,
        reference: ControlInput,
        inequalities: &[Inequality],
    ) -> Solution {
        let (slacks, duals) = (&self.solver.solution.s, &self.solver.solution.z);
        let is_active = |row: usize| duals[row] > slacks[row];
        let rows = BOX_ROWS + inequalities.len();
        let couples = |row: usize| {
            self.entries[row].abs() > 0.0 && self.entries[self.capacity + row].abs() > 0.0
        };
        if self.relaxed || (0..rows).any(|row| couples(row) && is_active(row)) {
            return solution;
        }
        let wanted = [reference.tan_delta, reference.accel_mps2];
        let [tan_delta, accel_mps2] = [0, 1].map(|k| {
            let entry = |row: usize| self.entries[k * self.capacity + row];
            (0..rows)
                .filter(|&row| entry(row).abs() > 0.0 && !couples(row) && is_active(row))
                .map(|row| self.limits[row] / entry(row) * self.scale[k])
                .next()
                .unwrap_or(wanted[k])
        });
        Solution {
            u: ControlInput {
                tan_delta,
                accel_mps2,
            },
            ..solution
        }
    }

    fn fill(
        &mut self,
        wanted: [f64; 2],
        inequalities: &[Inequality],
        bounds: Bounds,
        slack_price: f64,
    ) {
        let largest_accel = bounds.accel_max_mps2.abs().max(bounds.accel_min_mps2.abs());
        self.scale = [bounds.tan_delta.max(1e-6), largest_accel.max(1.0)];
        for (i, wanted) in wanted.into_iter().enumerate() {
            self.linear[i] = -(wanted / self.scale[i]).clamp(-WIDEST, WIDEST);
        }
        self.linear[2..].fill(slack_price);
        let boxed = [
            ([1.0, 0.0], -bounds.tan_delta),
            ([-1.0, 0.0], -bounds.tan_delta),
            ([0.0, 1.0], bounds.accel_min_mps2),
            ([0.0, -1.0], -bounds.accel_max_mps2),
        ]
        .map(|(coefficients, least)| Inequality {
            coefficients,
            least,
            soft: false,
        });
        // A row that is not used repeats a side of the box, farther out.
        let unused = Inequality {
            coefficients: [0.0, 1.0],
            least: bounds.accel_min_mps2 - self.scale[1],
            soft: false,
        };
        let rows = boxed.iter().chain(inequalities);
        let rows = rows.chain(std::iter::repeat(&unused)).take(self.capacity);
        for (i, row) in rows.enumerate() {
            // A x <= b with the signs turned round.
            let [tan, accel] = [0, 1].map(|k| -row.coefficients[k] * self.scale[k]);
            let widest = WIDEST * (1.0 + tan.abs() + accel.abs());
            self.entries[i] = tan;
            self.entries[self.capacity + i] = accel;
            self.limits[i] = (-row.least).clamp(-widest, widest);
            if self.relaxed {
                let place = 2 * (self.capacity + i);
                self.entries[place] = if row.soft { -1.0 } else { 0.0 };
                // zeta >= 0
                self.entries[place + 1] = -1.0;
                self.limits[self.capacity + i] = 0.0;
            }
        }
    }

    /// Only a solved program counts, and only when its residuals, computed again, are small.
    fn answer(&self, status: SolverStatus, x: &[f64]) -> Option<Solution> {
        let solved = status == SolverStatus::Solved;
        (solved && self.residual(x) <= RESIDUAL).then(|| self.snapped(x))
    }

    /// The largest violation of a row. A NaN makes it infinite.
    fn residual(&self, x: &[f64]) -> f64 {
        let worst = |worst: f64, i: usize| {
            let slack = if self.relaxed {
                self.entries[2 * (self.capacity + i)] * x[2 + i]
            } else {
                0.0
            };
            let missing = self.left_side(x, i) + slack - self.limits[i];
            if missing.is_nan() {
                f64::INFINITY
            } else {
                worst.max(missing)
            }
        };
        (0..self.capacity).fold(0.0, worst)
    }

    fn left_side(&self, x: &[f64], row: usize) -> f64 {
        self.entries[row] * x[0] + self.entries[self.capacity + row] * x[1]
    }

    /// Takes the interior point's last residual off: moves u onto the hard intervals it sits on.
    fn snapped(&self, x: &[f64]) -> Solution {
        let mut u = [x[0], x[1]];
        let mut slack = 0.0_f64;
        for row in 0..self.capacity {
            let (tan, accel) = (self.entries[row], self.entries[self.capacity + row]);
            let soft = self.relaxed && self.entries[2 * (self.capacity + row)].abs() > 0.5;
            if soft {
                slack = slack.max(x[2 + row]);
                continue;
            }
            for (k, own, other) in [(0, tan, accel), (1, accel, tan)] {
                if own.abs() > 0.0 && other.abs() <= 0.0 {
                    let limit = self.limits[row] / own;
                    u[k] = if own > 0.0 {
                        u[k].min(limit)
                    } else {
                        u[k].max(limit)
                    };
                }
            }
        }
        Solution {
            u: ControlInput {
                tan_delta: u[0] * self.scale[0],
                accel_mps2: u[1] * self.scale[1],
            },
            slack: if slack > RESIDUAL { slack } else { 0.0 },
        }
    }
}

/// As [`Bounds::clamp`], but a NaN stays one.
fn clamped(u: ControlInput, bounds: Bounds) -> ControlInput {
    if u.tan_delta.is_finite() && u.accel_mps2.is_finite() {
        bounds.clamp(u)
    } else {
        u
    }
}

#[cfg(test)]
#[path = "tests/qp.rs"]
mod tests;
