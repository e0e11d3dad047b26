//! The paper's text as it is written, and no filter at all, against the safe mode.

use covista_world::{ActionVerdict, BarrierKind, FilterOutcome};

use super::*;
use crate::Manoeuvre;

/// Towards a vehicle that stands 120 m ahead at 14 m/s, the nominal input keeps speed and lane:
/// (smallest distance between the centres, speed at the end, hardest braking).
fn towards_a_stopped_one(mode: Mode, formulation: Formulation) -> (f64, f64, f64) {
    let settings = ControlSettings {
        mode,
        ..formulated(formulation)
    };
    let mut drive = Drive::with(settings, straight(), 1, 100.0, 14.0);
    let stopped_m = 220.0;
    drive.others = vec![Other::new(1, stopped_m, 0.0, 0.0)];
    let (mut nearest_m, mut hardest) = (f64::INFINITY, 0.0_f64);
    for _ in 0..1500 {
        let output = drive.filter(input(0.0, 0.0));
        hardest = hardest.min(output.u.accel_mps2);
        drive.apply(output.u);
        let centre = SEDAN.center_pose(drive.state.pose).position();
        nearest_m = nearest_m.min(stopped_m - centre.x);
    }
    (nearest_m, drive.state.speed_mps, hardest)
}

#[test]
fn the_paper_drives_through_a_stopped_leader_and_ours_stops() {
    for formulation in [Formulation::Noisy, Formulation::Relaxed] {
        let (nearest_m, speed_mps, hardest) = towards_a_stopped_one(Mode::Paper, formulation);
        // Through it and on: it is behind in the end, and nothing was braked.
        assert!(nearest_m < -80.0, "{nearest_m}");
        assert!(
            (speed_mps - 14.0).abs() < 1e-6 && hardest > -1e-6,
            "{speed_mps} {hardest}"
        );
    }
    let (nearest_m, speed_mps, hardest) = towards_a_stopped_one(Mode::Safe, Formulation::Noisy);
    assert!((18.5..19.5).contains(&nearest_m), "{nearest_m}");
    assert!(speed_mps < 0.05 && hardest < -4.0, "{speed_mps} {hardest}");
}

#[test]
fn without_slack_the_paper_brakes_when_it_is_too_late() {
    // Its QP has no solution once the headway is gone, and then the backup brakes: 12 m of braking
    // way from 14 m/s are left of 18.5 m between the centres, 4.6 m of them the bodies'.
    let (nearest_m, speed_mps, hardest) =
        towards_a_stopped_one(Mode::Paper, Formulation::NoiseFree);
    assert!((hardest + 8.0).abs() < 1e-9 && speed_mps < 1e-9);
    assert!((5.0..8.0).contains(&nearest_m), "{nearest_m}");
}

#[test]
fn in_the_paper_every_action_is_safe_as_long_as_there_is_slack() {
    let verdicts = |formulation: Formulation| {
        let settings = ControlSettings {
            mode: Mode::Paper,
            ..formulated(formulation)
        };
        let mut drive = Drive::with(settings, straight(), 1, 100.0, 14.0);
        // Boxed in: bumper to bumper ahead and on both sides.
        drive.others = vec![
            Other::new(1, 105.0, 0.0, 0.0),
            Other::new(2, 101.0, 3.5, 14.0),
            Other::new(3, 99.0, -3.5, 14.0),
        ];
        Action::ALL.map(|action| drive.verdict(action))
    };
    let safe = [ActionVerdict::Safe; 3];
    assert_eq!(verdicts(Formulation::Noisy), safe);
    assert_eq!(verdicts(Formulation::Relaxed), safe);
    let noise_free = verdicts(Formulation::NoiseFree);
    let front = ActionVerdict::Unsafe(BarrierKind::FrontCurrent);
    assert_eq!(noise_free[0], front);
    assert!(
        noise_free
            .iter()
            .all(|verdict| *verdict != ActionVerdict::Safe)
    );
    let mut ours = Drive::new(straight(), 1, 100.0, 14.0);
    ours.others = vec![Other::new(1, 105.0, 0.0, 0.0)];
    assert_eq!(ours.verdict(Action::KeepLane), front);
}

#[test]
fn the_paper_has_no_lane_beyond_the_edge_either() {
    for mode in [Mode::Paper, Mode::Off] {
        let mut drive = Drive::with(in_mode(mode), straight(), 0, 100.0, 14.0);
        let excluded = ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
        assert_eq!(drive.verdict(Action::ChangeLeft), excluded);
        assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
        assert_eq!(drive.verdict(Action::EmergencyStop), ActionVerdict::Safe);
        drive.controller.set_action(Action::ChangeRight, 0.0);
        drive.run(1.0);
        // A change that runs excludes the other direction.
        assert_eq!(drive.verdict(Action::ChangeLeft), excluded);
        assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
    }
}

#[test]
fn the_papers_slack_takes_what_is_missing() {
    let settings = in_mode(Mode::Paper);
    let mut drive = Drive::with(settings, straight(), 1, 100.0, 14.0);
    drive.others = vec![Other::new(1, 110.0, 0.0, 0.0)];
    let output = drive.filter(input(0.0, 1.0));
    assert_eq!(output.outcome, FilterOutcome::Relaxed);
    assert_eq!(output.binding, Some(BarrierKind::FrontCurrent));
    assert!((output.u.accel_mps2 - 1.0).abs() < 1e-6, "{output:?}");
    // Far from everybody nothing is moved.
    drive.others.clear();
    let output = drive.filter(input(0.0, 1.0));
    assert_eq!(output.outcome, FilterOutcome::Filtered);
    assert_eq!(output.binding, None);
}

#[test]
fn the_papers_reference_heeds_the_road_but_no_leader() {
    let mut drive = Drive::with(in_mode(Mode::Paper), corner(), 1, 20.0, 14.0);
    drive.others = vec![Other::new(1, 90.0, 0.0, 0.0)];
    drive.run(12.0);
    let ego = drive.ego();
    assert!(ego.frenet.s_m > 150.0, "{ego:?}");
    assert!(ego.frenet.d_m.abs() < 0.2, "{ego:?}");
}

#[test]
fn off_only_clamps() {
    let mut drive = Drive::with(in_mode(Mode::Off), straight(), 1, 100.0, 14.0);
    drive.others = vec![Other::new(1, 106.0, 0.0, 0.0)];
    let grip = 4.0 * SEDAN.wheelbase_m / 14.0_f64.powi(2);
    for (wanted, applied) in [
        (input(0.01, 2.0), input(0.01, 2.0)),
        (input(-0.01, -7.0), input(-0.01, -7.0)),
        (input(5.0, 9.0), input(grip, 3.0)),
        (input(-5.0, -90.0), input(-grip, -8.0)),
    ] {
        let output = drive.filter(wanted);
        assert_eq!(output.outcome, FilterOutcome::Nominal);
        assert_eq!((output.binding, output.slack), (None, 0.0));
        assert!(
            (output.u.tan_delta - applied.tan_delta).abs() < 1e-12,
            "{output:?}"
        );
        assert!(
            (output.u.accel_mps2 - applied.accel_mps2).abs() < 1e-12,
            "{output:?}"
        );
        // What it would have been measured by is told.
        assert!(output.h_m < 0.0 && output.h0_m < 0.0, "{output:?}");
    }
    for action in Action::ALL {
        assert_eq!(drive.verdict(action), ActionVerdict::Safe);
    }
    drive.state.speed_mps = 0.02;
    assert!((drive.filter(input(0.0, -8.0)).u.accel_mps2 + 2.0).abs() < 1e-9);
}

#[test]
fn off_starts_a_change_into_anybody() {
    let starts = |mode: Mode| {
        let mut drive = Drive::with(in_mode(mode), straight(), 1, 100.0, 14.0);
        drive.others = vec![Other::new(1, 100.0, 3.5, 14.0)];
        drive.controller.set_action(Action::ChangeLeft, 0.0);
        let mut started = false;
        for _ in 0..200 {
            drive.run(STEP_S);
            let manoeuvre = drive.controller.manoeuvre();
            started |= matches!(manoeuvre, Manoeuvre::ChangeLane { .. });
        }
        started
    };
    assert!(starts(Mode::Off) && starts(Mode::Paper) && !starts(Mode::Safe));
}
