//! Affine barriers h = p'x + q of a user, x = [s, d, psi, v].

use covista_world::{BarrierKind, FilterOutcome, FrenetPose};

use super::*;
use crate::barriers::affine::Dynamics;
use crate::{AffineBarrier, SettingsError};

fn barrier(p: [f64; 4], q: f64) -> AffineBarrier {
    AffineBarrier { p, q }
}

fn state(drive: &Drive) -> [f64; 4] {
    let FrenetPose {
        s_m, d_m, psi_rad, ..
    } = drive.ego().frenet;
    [s_m, d_m, psi_rad, drive.state.speed_mps]
}

fn h(barrier: &AffineBarrier, drive: &Drive) -> f64 {
    let x = state(drive);
    barrier.q + (0..4).map(|i| barrier.p[i] * x[i]).sum::<f64>()
}

/// Lowest h of `mine` over `steps`, what bound at least once, and the outcomes' worst.
fn driven(drive: &mut Drive, mine: AffineBarrier, u: ControlInput, steps: usize) -> (f64, usize) {
    drive.controller.add_barrier(mine).expect("finite");
    let (mut lowest, mut bound) = (f64::INFINITY, 0);
    for _ in 0..steps {
        let output = drive.filter(u);
        assert_ne!(output.outcome, FilterOutcome::Backup, "{output:?}");
        assert_ne!(output.outcome, FilterOutcome::Relaxed, "{output:?}");
        bound += usize::from(output.binding == Some(BarrierKind::Affine(0)));
        drive.apply(output.u);
        lowest = lowest.min(h(&mine, drive));
    }
    (lowest, bound)
}

#[test]
fn a_speed_limit_holds_and_is_reached() {
    let mut drive = Drive::new(straight(), 1, 100.0, 5.0);
    let limit = barrier([0.0, 0.0, 0.0, -1.0], 12.0);
    let (lowest, bound) = driven(&mut drive, limit, input(0.0, 3.0), 1500);
    assert!(lowest > -1e-9, "{lowest}");
    assert!(bound > 500, "{bound}");
    // As near as the noise that is allowed for: (1 - eta) h >= W_v.
    assert!((lowest - 5e-3 / 0.2).abs() < 1e-3, "{lowest}");
}

#[test]
fn a_heading_bound_holds() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    let left = barrier([0.0, 0.0, -1.0, 0.0], 0.02);
    let (lowest, bound) = driven(&mut drive, left, input(0.02, 0.0), 40);
    assert!(lowest > -1e-9 && lowest < 0.01, "{lowest}");
    assert!(bound > 10, "{bound}");
}

#[test]
fn a_bound_that_couples_heading_and_speed_holds() {
    // The faster, the less it may turn: psi + 0.01 v <= 0.13.
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    let coupled = barrier([0.0, 0.0, -1.0, -0.01], 0.13);
    let (lowest, bound) = driven(&mut drive, coupled, input(0.01, 1.5), 60);
    assert!(lowest > -1e-9, "{lowest}");
    assert!(bound > 5, "{bound}");
    let output = drive.filter(input(0.05, 2.0));
    // Both inputs give way.
    assert!(
        output.u.tan_delta < 0.05 && output.u.accel_mps2 < 2.0,
        "{output:?}"
    );
}

#[test]
fn each_is_named_by_its_place() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    for q in [1e6, 10.001, 1e6] {
        let limit = barrier([0.0, 0.0, 0.0, -1.0], q);
        drive.controller.add_barrier(limit).expect("finite");
    }
    let output = drive.filter(input(0.0, 3.0));
    assert_eq!(output.binding, Some(BarrierKind::Affine(1)));
    assert_eq!(output.outcome, FilterOutcome::Filtered);
}

#[test]
fn one_that_is_broken_is_not_made_worse() {
    let mut drive = Drive::new(straight(), 1, 100.0, 15.0);
    let limit = barrier([0.0, 0.0, 0.0, -1.0], 12.0);
    drive.controller.add_barrier(limit).expect("finite");
    let output = drive.filter(input(0.0, 2.0));
    // h = -3 may not fall, noise included.
    assert!((output.u.accel_mps2 + 0.5).abs() < 1e-6, "{output:?}");
}

#[test]
fn one_that_asks_too_much_takes_slack_then_the_backup() {
    // Speed may not fall below 20 m/s, but a vehicle stands ahead.
    let with_slack = |slack_max: f64| {
        let mut settings = ControlSettings::default();
        settings.qp.slack_max = slack_max;
        let mut drive = Drive::with(settings, straight(), 1, 100.0, 20.0);
        drive.others = vec![Other::new(1, 120.0, 0.0, 0.0)];
        let faster = barrier([0.0, 0.0, 0.0, 1.0], -20.0);
        drive.controller.add_barrier(faster).expect("finite");
        drive.filter(input(0.0, 0.0))
    };
    let relaxed = with_slack(100.0);
    assert_eq!(relaxed.outcome, FilterOutcome::Relaxed, "{relaxed:?}");
    assert!(relaxed.slack > 0.01, "{relaxed:?}");
    let backup = with_slack(0.001);
    assert_eq!(backup.outcome, FilterOutcome::Backup, "{backup:?}");
    assert!((backup.u.accel_mps2 + 8.0).abs() < 1e-6, "{backup:?}");
}

#[test]
fn numbers_that_are_none_are_refused() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for i in 0..4 {
            let mut p = [0.0; 4];
            p[i] = bad;
            let refused = drive.controller.add_barrier(barrier(p, 0.0));
            assert_eq!(refused, Err(SettingsError::Barrier));
        }
        let refused = drive.controller.add_barrier(barrier([0.0; 4], bad));
        assert_eq!(refused, Err(SettingsError::Barrier));
    }
    let output = drive.filter(input(0.0, 1.0));
    assert_eq!(output.outcome, FilterOutcome::Nominal);
}

#[test]
fn a_position_alone_is_refused_for_u_is_not_in_its_row() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    let refused = drive
        .controller
        .add_barrier(barrier([-1.0, 0.2, 0.0, 0.0], 150.0));
    assert_eq!(refused, Err(SettingsError::BarrierWithoutInput));
    let message = SettingsError::BarrierWithoutInput.to_string();
    assert!(
        message.contains("give it a part in heading or speed"),
        "{message}"
    );
}

#[test]
fn the_dynamics_are_the_models_step_along_the_road() {
    for road in [straight(), corner()] {
        for (psi_rad, d_m, v) in [(0.0, 0.0, 10.0), (0.2, 1.0, 15.0), (-0.3, -2.0, 4.0)] {
            let center = road.pose_from_frenet(230.0, d_m, psi_rad);
            let state = BicycleState {
                pose: center,
                speed_mps: v,
            };
            let ego = EgoState::new(STATION, state, SEDAN, &road);
            let dynamics = Dynamics::new(&ego.frenet, v, SEDAN.wheelbase_m);
            let u = input(0.03, -2.0);
            let next = bicycle_step(state, u, SEDAN.wheelbase_m);
            let frenet = road.to_frenet_pose(next.pose);
            let next = [frenet.s_m, frenet.d_m, frenet.psi_rad, next.speed_mps];
            for (i, reached) in next.into_iter().enumerate() {
                let mut p = [0.0; 4];
                p[i] = 1.0;
                let found = barrier(p, 0.0).h_next(&dynamics, u);
                // One Euler step in the Frenet frame, of second order in v Ts.
                assert!((found - reached).abs() < 2e-4, "{i}: {found} {reached}");
            }
        }
    }
}
