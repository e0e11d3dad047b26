//! The closed form and Clarabel, within 1e-6 on more than 100,000 random states.

use covista_world::{BarrierKind, FilterOutcome};

use super::*;
use crate::barriers::bounds::Bounds;
use crate::barriers::{Input, Row};
use crate::filter::{Filtered, filter};
use crate::qp::Qp;
use crate::{QpSettings, Solver};

/// Within 1e-6, but where a limit is almost where the reference is: there an interior point is as
/// exact as the root of its tolerance.
fn differ(one: ControlInput, other: ControlInput, reference: ControlInput) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() < 1e-4;
    let within = |one: f64, other: f64, reference: f64| {
        let is_weak = near(one, reference) && near(other, reference);
        (one - other).abs() <= if is_weak { 2e-5 } else { 1e-6 }
    };
    !within(one.tan_delta, other.tan_delta, reference.tan_delta)
        || !within(one.accel_mps2, other.accel_mps2, reference.accel_mps2)
}

fn solved(u: ControlInput, rows: &Rows, qp: &mut Qp, solver: Solver) -> Filtered {
    filter(u, rows, &[], qp, solver, &QpSettings::default())
}

/// Intervals as the barriers give them: front rows above, a follower's below, steering both ways.
fn random_rows(dice: &mut Dice, rows: &mut Rows) {
    rows.bounds = Bounds {
        tan_delta: dice.uniform(0.005, 0.6),
        accel_min_mps2: dice.uniform(-8.0, -0.1),
        accel_max_mps2: 3.0,
    };
    rows.hard.clear();
    rows.rear.clear();
    let (kind, accel, tan) = (BarrierKind::FrontCurrent, Input::Accel, Input::TanDelta);
    for _ in 0..dice.uniform(0.0, 4.0) as usize {
        let upper = dice.uniform(-8.0, 6.0);
        rows.hard.push(Row::at_most(kind, accel, upper, 1.0));
    }
    for _ in 0..dice.uniform(0.0, 3.0) as usize {
        let (low, high) = (dice.uniform(-0.7, 0.4), dice.uniform(-0.4, 0.7));
        rows.hard.push(Row::at_least(kind, tan, low, 1.0));
        rows.hard.push(Row::at_most(kind, tan, high, 1.0));
    }
    for _ in 0..dice.uniform(0.0, 2.0) as usize {
        let lower = dice.uniform(-9.0, 2.0);
        rows.rear
            .push(Row::at_least(BarrierKind::RearTarget, accel, lower, 1.0));
    }
}

fn is_feasible(rows: &Rows) -> bool {
    let least = |rows: &[Row]| {
        rows.iter()
            .fold(f64::NEG_INFINITY, |least, row| least.max(row.lower))
    };
    let (least_tan, most_tan) = rows.interval(Input::TanDelta);
    let (_, most_accel) = rows.interval(Input::Accel);
    // Bounds may cut the intervals off.
    least_tan <= most_tan
        && least_tan <= rows.bounds.tan_delta
        && most_tan >= -rows.bounds.tan_delta
        && least(&rows.rear).max(rows.bounds.accel_min_mps2) <= most_accel
}

/// How many states were looked at.
#[derive(Debug, Default)]
struct Seen {
    compared: usize,
    /// Those in which a row moved the reference.
    moved: usize,
    /// Those for which Clarabel did not reach its tolerances: the backup brakes.
    unsolved: usize,
}

fn random_intervals(seed: u64, count: usize) -> Seen {
    let mut dice = Dice(seed);
    let (mut rows, mut qp, mut seen) = (Rows::default(), Qp::default(), Seen::default());
    while seen.compared < count {
        random_rows(&mut dice, &mut rows);
        if !is_feasible(&rows) {
            continue;
        }
        let u = input(dice.uniform(-0.8, 0.8), dice.uniform(-10.0, 5.0));
        let closed = solved(u, &rows, &mut qp, Solver::ClosedForm);
        let by_clarabel = solved(u, &rows, &mut qp, Solver::Clarabel);
        if by_clarabel.outcome == FilterOutcome::Backup {
            seen.unsolved += 1;
            continue;
        }
        seen.compared += 1;
        seen.moved += usize::from(closed.outcome == FilterOutcome::Filtered);
        assert!(
            !differ(closed.u, by_clarabel.u, u)
                && closed.outcome == by_clarabel.outcome
                && closed.binding == by_clarabel.binding,
            "{u:?} {rows:?}: {closed:?} {by_clarabel:?}"
        );
    }
    seen
}

#[test]
fn the_solvers_agree_on_random_intervals() {
    let halves = std::thread::scope(|scope| {
        let halves = [1, 2].map(|seed| scope.spawn(move || random_intervals(seed, 10_000)));
        halves.map(|half| half.join().expect("no panic"))
    });
    for seen in halves {
        assert!(seen.moved > 6_000 && seen.unsolved < 20, "{seen:?}");
    }
}

/// A drive of the controller at any state of the corner, with up to four others around.
fn random_situation(dice: &mut Dice, drive: &mut Drive) {
    let s_m = dice.uniform(40.0, 420.0);
    let d_m = drive.road.lane_center_m(lane(1)) + dice.uniform(-0.4, 0.4);
    let pose = drive
        .road
        .pose_from_frenet(s_m, d_m, dice.uniform(-0.05, 0.05));
    drive.state = BicycleState {
        pose,
        speed_mps: dice.uniform(0.0, 15.0),
    };
    drive.time_s += STEP_S;
    drive.clear_s_m = s_m + dice.uniform(60.0, 150.0);
    drive.others.clear();
    for id in 0..dice.uniform(0.0, 5.0) as u32 {
        let d_m = [0.0, 0.0, 3.5, -3.5][dice.uniform(0.0, 4.0) as usize];
        let away_m = dice.uniform(-60.0, 100.0);
        drive
            .others
            .push(Other::new(id, s_m + away_m, d_m, dice.uniform(0.0, 15.0)));
    }
}

fn random_situations(seed: u64, count: usize) -> Seen {
    let mut dice = Dice(seed);
    let mut drive = Drive::new(corner(), 1, 100.0, 10.0);
    let solvers = [Solver::ClosedForm, Solver::Clarabel].map(|solver| ControlSettings {
        solver,
        ..ControlSettings::default()
    });
    let mut both = solvers.map(|settings| Controller::new(settings, lane(1)).expect("valid"));
    let mut seen = Seen::default();
    while seen.compared < count {
        random_situation(&mut dice, &mut drive);
        let u = input(dice.uniform(-0.2, 0.2), dice.uniform(-9.0, 4.0));
        let [closed, clarabel] = drive.with_situation(|_, situation| {
            both.each_mut()
                .map(|controller| controller.filter(situation, u))
        });
        let feasible = [FilterOutcome::Nominal, FilterOutcome::Filtered];
        if !feasible.contains(&closed.outcome) {
            continue;
        }
        if clarabel.outcome == FilterOutcome::Backup {
            seen.unsolved += 1;
            continue;
        }
        seen.compared += 1;
        seen.moved += usize::from(closed.outcome == FilterOutcome::Filtered);
        assert!(
            !differ(closed.u, clarabel.u, u) && closed.outcome == clarabel.outcome,
            "{:?} {:?}: {closed:?} {clarabel:?}",
            drive.state,
            drive.others
        );
    }
    seen
}

#[test]
fn the_controllers_agree_in_random_situations() {
    let halves = std::thread::scope(|scope| {
        let halves = [3, 4].map(|seed| scope.spawn(move || random_situations(seed, 41_000)));
        halves.map(|half| half.join().expect("no panic"))
    });
    for seen in halves {
        assert!(seen.moved > 10_000 && seen.unsolved < 20, "{seen:?}");
    }
}
