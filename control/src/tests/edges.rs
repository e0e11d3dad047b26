//! Places where a formula divides by nothing, and neighbours that are odd.

use std::f64::consts::FRAC_PI_2;

use covista_world::{ActionVerdict, BarrierKind, FilterOutcome};

use super::*;
use crate::validator::is_valid;
use crate::{AffineBarrier, Solver};

/// Bumper to bumper, for centres of two sedans.
fn centre_m(ego_centre_m: f64, gap_m: f64) -> f64 {
    ego_centre_m + SEDAN.length_m + gap_m
}

fn assert_valid(drive: &Drive, output: ControlOutput) {
    let v = drive.state.speed_mps;
    let safety = drive.safety();
    assert!(
        is_valid(output.u, v, SEDAN.wheelbase_m, &safety),
        "{v}: {output:?}"
    );
}

#[test]
fn at_standstill_the_steering_has_no_row_and_the_vehicle_can_start() {
    let mut drive = Drive::new(straight(), 1, 100.0, 0.0);
    for tan_delta in [-0.6, 0.0, 0.6] {
        let output = drive.filter(input(tan_delta, 1.0));
        assert_eq!(output.outcome, FilterOutcome::Nominal, "{output:?}");
        assert!((output.u.tan_delta - tan_delta).abs() < 1e-12);
    }
    let output = drive.filter(input(0.0, -1.0));
    assert!(output.u.accel_mps2.abs() < 1e-12, "{output:?}");
}

#[test]
fn across_the_road_there_is_an_answer_at_every_speed() {
    for road in [straight(), corner()] {
        for psi_rad in [-FRAC_PI_2, FRAC_PI_2, 3.0, -3.0] {
            for speed_mps in [0.0, 1e-9, 0.01, 1.0, 10.0, 40.0] {
                for solver in [Solver::ClosedForm, Solver::Clarabel] {
                    let settings = ControlSettings {
                        solver,
                        ..ControlSettings::default()
                    };
                    let mut drive = Drive::with(settings, road.clone(), 1, 200.0, speed_mps);
                    drive.state.pose.yaw_rad += psi_rad;
                    drive.others = vec![Other::new(1, 230.0, 0.0, 5.0)];
                    let output = drive.control();
                    assert_valid(&drive, output);
                    let output = drive.filter(input(0.2, 2.0));
                    assert_valid(&drive, output);
                    assert!(!output.h_lateral_m.is_nan(), "{output:?}");
                }
            }
        }
    }
}

#[test]
fn a_gradient_that_vanishes_leaves_a_barrier_met_or_not() {
    // A heading bound: at standstill no input turns the vehicle.
    let heading = |most_rad: f64| AffineBarrier {
        p: [0.0, 0.0, -1.0, 0.0],
        q: most_rad,
    };
    for (most_rad, outcome) in [
        (0.1, FilterOutcome::Nominal),
        (-0.1, FilterOutcome::Nominal),
    ] {
        let mut drive = Drive::new(straight(), 1, 100.0, 0.0);
        drive
            .controller
            .add_barrier(heading(most_rad))
            .expect("finite");
        let output = drive.filter(input(0.0, 0.0));
        // h < 0 must not fall, and it does not.
        assert_eq!(output.outcome, outcome, "{output:?}");
    }
    // Where the noise takes from h what no input gives back there is slack, and an answer.
    for angle_rad in [-FRAC_PI_2, FRAC_PI_2] {
        for speed_mps in [0.0, 5.0] {
            let mut drive = Drive::new(straight(), 1, 100.0, speed_mps);
            drive.state.pose.yaw_rad = angle_rad;
            drive
                .controller
                .add_barrier(AffineBarrier {
                    p: [0.0, 1.0, 0.5, 0.0],
                    q: -40.0,
                })
                .expect("finite");
            let output = drive.filter(input(0.0, 0.0));
            assert_valid(&drive, output);
        }
    }
}

#[test]
fn with_no_gap_left_it_brakes_as_hard_as_it_can() {
    for gap_m in [0.0, 1e-12, -0.3, -2.0, -4.5] {
        for solver in [Solver::ClosedForm, Solver::Clarabel] {
            let settings = ControlSettings {
                solver,
                ..ControlSettings::default()
            };
            let mut drive = Drive::with(settings, straight(), 1, 100.0, 10.0);
            drive.others = vec![Other::new(1, centre_m(100.0, gap_m), 0.0, 0.0)];
            let output = drive.filter(input(0.0, 2.0));
            assert!(
                (output.u.accel_mps2 + 8.0).abs() < 1e-6,
                "{gap_m} {output:?}"
            );
            assert!(output.h0_m < -2.0 && output.h_m < output.h0_m, "{output:?}");
            let front = ActionVerdict::Unsafe(BarrierKind::FrontCurrent);
            assert_eq!(drive.verdict(Action::KeepLane), front);
            assert_eq!(drive.verdict(Action::EmergencyStop), ActionVerdict::Safe);
        }
    }
}

#[test]
fn with_no_gap_left_it_stays_where_it_stands() {
    for gap_m in [0.0, -2.0] {
        let mut drive = Drive::new(straight(), 1, 100.0, 0.0);
        drive.others = vec![Other::new(1, centre_m(100.0, gap_m), 0.0, 0.0)];
        for _ in 0..100 {
            let output = drive.filter(input(0.0, 2.0));
            assert!(output.u.accel_mps2.abs() < 1e-9, "{output:?}");
            drive.apply(output.u);
        }
        // It may drive on as soon as the other one does.
        drive.others[0].s_m += 30.0;
        assert!(drive.filter(input(0.0, 2.0)).u.accel_mps2 > 1.9);
    }
}

#[test]
fn a_leader_that_reverses_counts_as_one_that_stands() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    let (road, safety) = (drive.road.clone(), drive.safety());
    for speed_mps in [-0.1, -3.0, -20.0] {
        let track = Other::new(1, 200.0, 0.0, speed_mps).track(&road, 0.0);
        let at = |now_s: f64| Neighbour::from_track(&track, &road, now_s, &safety).expect("finite");
        let diagonal_m = 0.5 * SEDAN.length_m.hypot(SEDAN.width_m);
        for other in [at(0.0), at(0.8)] {
            assert!((other.s_rear_m - 197.7).abs() < 1e-9 && other.speed_mps.abs() < 1e-12);
            let worst_m = 200.0 - diagonal_m;
            assert!((other.worst_s_rear_m - worst_m).abs() < 1e-9, "{other:?}");
            assert!(other.worst_slow_mps.abs() < 1e-12, "{other:?}");
        }
    }
    // It rolls back by 3 m/s while the ego vehicle comes; it stops before, then h falls.
    drive.others = vec![Other::new(1, 180.0, 0.0, -3.0)];
    let mut collided = false;
    for _ in 0..600 {
        let output = drive.control();
        assert_valid(&drive, output);
        drive.apply(output.u);
        drive.others[0].s_m -= 3.0 * STEP_S;
        let ego_m = drive.ego().frenet.s_m + drive.ego().front_m();
        collided |= drive.state.speed_mps > 0.0 && drive.others[0].s_m - 2.3 < ego_m;
    }
    assert!(!collided);
    assert!(drive.state.speed_mps < 0.05, "{}", drive.state.speed_mps);
}

#[test]
fn nobody_on_the_road_is_no_limit() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    let output = drive.filter(input(0.0, 3.0));
    assert_eq!(output.outcome, FilterOutcome::Nominal);
    assert_eq!(output.binding, None);
    assert!(output.h0_m > 1e300 && output.h_m > 1e3, "{output:?}");
    for action in Action::ALL {
        assert_eq!(drive.verdict(action), ActionVerdict::Safe);
    }
    assert!(drive.controller.excused().is_empty());
}

const STEPS: usize = 400;

fn following(others: &[Other], steps: usize) -> Vec<ControlOutput> {
    let mut drive = Drive::new(corner(), 1, 150.0, 14.0);
    drive.others = others.to_vec();
    (0..steps)
        .map(|step| {
            let output = drive.filter(input(0.0, 2.0));
            drive.apply(output.u);
            for other in &mut drive.others {
                other.step(if step < steps / 2 { -4.0 } else { 3.0 });
            }
            output
        })
        .collect()
}

#[test]
fn a_vehicle_that_is_told_twice_counts_once() {
    let leader = Other::new(1, 190.0, 0.0, 12.0);
    let alone = following(&[leader], STEPS);
    assert!(alone.iter().any(|output| output.u.accel_mps2 < -3.0));
    assert_eq!(alone, following(&[leader, leader], STEPS));
    let twin = Other { id: 99, ..leader };
    assert_eq!(alone, following(&[leader, twin], STEPS));
    assert_eq!(alone, following(&[twin, leader], STEPS));
}

#[test]
fn two_places_for_one_id_are_two_vehicles() {
    let (near, far) = (
        Other::new(1, 190.0, 0.0, 12.0),
        Other::new(1, 215.0, 0.0, 12.0),
    );
    let alone = following(&[near], STEPS);
    assert_eq!(alone, following(&[far, near], STEPS));
    assert_eq!(alone, following(&[near, far], STEPS));
}

#[test]
fn a_thousand_neighbours_are_as_many_rows() {
    let mut dice = Dice(5);
    let leader = Other::new(1000, 190.0, 0.0, 12.0);
    let mut crowd: Vec<Other> = (0..1000)
        .map(|id| {
            Other::new(
                id,
                dice.uniform(200.0, 700.0),
                3.5,
                dice.uniform(12.0, 20.0),
            )
        })
        .collect();
    crowd.insert(500, leader);
    assert_eq!(following(&[leader], 40), following(&crowd, 40));
    let in_lane: Vec<Other> = (0..1000)
        .map(|id| Other::new(id, 190.0 + 0.1 * f64::from(id), 0.0, 12.0))
        .collect();
    assert_eq!(following(&in_lane[..1], 40), following(&in_lane, 40));
}
