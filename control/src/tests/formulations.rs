//! The paper's three QPs in the safe mode: without noise, relaxed, and with noise and slack.

use covista_world::{BarrierKind, FilterOutcome};

use super::*;
use crate::AffineBarrier;

/// Speed may not fall below 20 m/s, but a vehicle stands ahead: rows that exclude each other.
fn torn(formulation: Formulation, slack_max: f64) -> ControlOutput {
    let mut settings = formulated(formulation);
    settings.qp.slack_max = slack_max;
    let mut drive = Drive::with(settings, straight(), 1, 100.0, 20.0);
    drive.others = vec![Other::new(1, 155.0, 0.0, 0.0)];
    drive.others[0].s_m -= drive.control().h_m;
    let faster = AffineBarrier {
        p: [0.0, 0.0, 0.0, 1.0],
        q: -20.0,
    };
    drive.controller.add_barrier(faster).expect("finite");
    drive.filter(input(0.001, 1.0))
}

#[test]
fn without_slack_what_is_infeasible_leads_to_backup() {
    let output = torn(Formulation::NoiseFree, 100.0);
    assert_eq!(output.outcome, FilterOutcome::Backup, "{output:?}");
    assert!((output.u.accel_mps2 + 8.0).abs() < 1e-9, "{output:?}");
    assert_eq!(output.binding, Some(BarrierKind::FrontCurrent));
}

#[test]
fn with_slack_it_is_reported_and_enlarges_the_set() {
    for formulation in [Formulation::Relaxed, Formulation::Noisy] {
        let output = torn(formulation, 100.0);
        assert_eq!(output.outcome, FilterOutcome::Relaxed, "{output:?}");
        assert!(output.slack > 1e-6, "{output:?}");
        assert!(
            (output.enlargement - output.slack / 0.2).abs() < 1e-12,
            "{output:?}"
        );
        assert_eq!(output.binding, Some(BarrierKind::FrontCurrent));
    }
}

#[test]
fn slack_beyond_z_leads_to_backup() {
    let slack = torn(Formulation::Noisy, 100.0).slack;
    let within = torn(Formulation::Noisy, 1.001 * slack);
    assert_eq!(within.outcome, FilterOutcome::Relaxed, "{within:?}");
    let beyond = torn(Formulation::Noisy, 0.999 * slack);
    assert_eq!(beyond.outcome, FilterOutcome::Backup, "{beyond:?}");
    assert!((beyond.u.accel_mps2 + 8.0).abs() < 1e-9, "{beyond:?}");
    // The braking is the backup's; the steering still is the one that misses least.
    assert!((beyond.u.tan_delta - within.u.tan_delta).abs() < 1e-12);
}

#[test]
fn where_every_row_holds_there_is_no_slack() {
    for formulation in [
        Formulation::NoiseFree,
        Formulation::Relaxed,
        Formulation::Noisy,
    ] {
        let mut drive = Drive::with(formulated(formulation), corner(), 1, 100.0, 14.0);
        drive.others = vec![Other::new(1, 150.0, 0.0, 12.0)];
        for _ in 0..800 {
            let output = drive.filter(input(0.02, 3.0));
            assert_eq!((output.slack, output.enlargement), (0.0, 0.0), "{output:?}");
            assert_ne!(output.outcome, FilterOutcome::Backup, "{output:?}");
            assert_ne!(output.outcome, FilterOutcome::Relaxed, "{output:?}");
            drive.apply(output.u);
            drive.others[0].step(-0.5);
        }
    }
}

#[test]
fn only_the_noisy_one_has_noise() {
    let noise = |formulation: Formulation| {
        let drive = Drive::with(formulated(formulation), straight(), 1, 100.0, 14.0);
        let safety = drive.safety();
        [
            safety.noise_position_m,
            safety.noise_speed_mps,
            safety.noise_slip_rad,
            safety.noise_curvature_per_m,
        ]
    };
    assert!(
        noise(Formulation::NoiseFree)
            .iter()
            .all(|bound| *bound <= 0.0)
    );
    assert!(
        noise(Formulation::Relaxed)
            .iter()
            .all(|bound| *bound <= 0.0)
    );
    assert!(noise(Formulation::Noisy).iter().all(|bound| *bound > 0.0));
}

/// Lowest h behind a leader that stops as hard as it may, with every step's noise at its bound.
fn under_noise(formulation: Formulation) -> f64 {
    let bounds = SafetySettings::default();
    let mut drive = Drive::with(formulated(formulation), straight(), 1, 100.0, 20.0);
    drive.others = vec![Other::new(1, 300.0, 0.0, 20.0)];
    drive.others[0].s_m -= drive.control().h_m - 0.1;
    let mut lowest = f64::INFINITY;
    for step in 0..900 {
        let output = drive.filter(input(0.0, 3.0));
        lowest = lowest.min(output.h_m);
        drive.apply(output.u);
        if drive.state.speed_mps > 0.1 {
            drive.state.pose.x_m += bounds.noise_position_m;
            drive.state.speed_mps += bounds.noise_speed_mps;
        }
        drive.others[0].step(if step < 300 { 0.0 } else { -8.0 });
    }
    lowest
}

#[test]
fn under_noise_only_the_noisy_one_keeps_the_set() {
    let noisy = under_noise(Formulation::Noisy);
    assert!(noisy > -1e-6, "{noisy}");
    for formulation in [Formulation::NoiseFree, Formulation::Relaxed] {
        let lost = under_noise(formulation);
        assert!(lost < -1.0, "{formulation:?} {lost}");
    }
}

/// A lane narrower than the body: neither side has room.
#[test]
fn steering_rows_that_exclude_each_other_take_slack_of_both() {
    let segment = RoadSegment::Straight { length_m: 900.0 };
    let narrow = Road::new(Se2Pose::default(), &[segment], 1.8).expect("a road");
    for psi_rad in [-0.002, 0.002] {
        let mut drive = Drive::new(narrow.clone(), 1, 100.0, 20.0);
        drive.state.pose.yaw_rad = psi_rad;
        let output = drive.filter(input(0.0, 2.0));
        assert_eq!(output.outcome, FilterOutcome::Relaxed, "{output:?}");
        assert!(output.slack > 1e-6 && output.slack < 0.1, "{output:?}");
        // The side that is left decides, and the vehicle gains no speed.
        assert!(output.u.tan_delta * psi_rad < 0.0, "{output:?}");
        assert!(output.u.accel_mps2 <= 0.0, "{output:?}");
    }
}

#[test]
fn too_fast_for_the_curve_it_brakes() {
    for speed_mps in [16.0, 20.0, 25.0, 31.0] {
        let mut drive = Drive::new(corner(), 1, 230.0, speed_mps);
        let output = drive.filter(input(0.0, 2.0));
        assert!(output.u.accel_mps2 <= -3.0 + 1e-9, "{output:?}");
        assert_ne!(output.outcome, FilterOutcome::Nominal, "{output:?}");
    }
}
