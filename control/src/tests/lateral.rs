use covista_world::{ControlInput, STEP_S};

use super::*;
use crate::barriers::Input;
use crate::manoeuvre::Course;

/// Random steering and acceleration against the rows; returns (lowest h_y, infeasible steps, the
/// body's farthest excess over the lane).
fn campaign(road: &Road, top_mps: f64, seed: u64, laps: usize) -> (f64, usize, f64) {
    let safety = SafetySettings::default();
    let mut dice = Dice(seed);
    let (mut lowest, mut infeasible, mut excess) = (f64::INFINITY, 0, f64::NEG_INFINITY);
    for _ in 0..laps {
        let mut drive = Drive::new(road.clone(), 1, 20.0, dice.uniform(0.0, top_mps));
        let mut reference = ControlInput::default();
        for step in 0..3000 {
            if step % 30 == 0 {
                reference = ControlInput {
                    tan_delta: dice.uniform(-0.6, 0.6),
                    accel_mps2: dice.uniform(-6.0, 5.0),
                };
                if drive.state.speed_mps > top_mps {
                    reference.accel_mps2 = -3.0;
                }
            }
            let u = drive.with_situation(|_, situation| {
                let rows = rows(situation, &Course::keep(lane(1)), &safety);
                lowest = lowest.min(rows.h_lateral_m);
                let (least, most) = rows.interval(Input::TanDelta);
                infeasible += usize::from(least > most + 1e-9);
                let (lower, upper) = rows.interval(Input::Accel);
                ControlInput {
                    tan_delta: reference.tan_delta.max(least).min(most),
                    accel_mps2: reference.accel_mps2.max(lower).min(upper),
                }
            });
            let (right, left) = drive.ego().lateral_extent_m(&drive.road);
            excess = excess.max((left - 1.75).max(-1.75 - right));
            drive.apply(u);
        }
    }
    (lowest, infeasible, excess)
}

#[test]
fn the_body_stays_in_a_straight_lane_whatever_the_reference() {
    let (lowest, infeasible, excess) = campaign(&straight(), 36.0, 3, 40);
    assert_eq!(infeasible, 0);
    assert!(lowest > -1e-6, "{lowest}");
    assert!(excess < 1e-6, "{excess}");
}

#[test]
fn the_body_stays_in_a_curved_lane_whatever_the_reference() {
    let (lowest, infeasible, excess) = campaign(&corner(), 20.0, 4, 40);
    assert_eq!(infeasible, 0);
    assert!(lowest > -1e-6, "{lowest}");
    assert!(excess < 1e-6, "{excess}");
}

#[test]
fn the_speed_falls_before_the_curve() {
    let mut drive = Drive::new(corner(), 1, 20.0, 25.0);
    let mut sharpest = 0.0_f64;
    for _ in 0..3000 {
        let output = drive.control();
        sharpest = sharpest.max(drive.lateral_accel_mps2(output.u).abs());
        drive.apply(output.u);
    }
    assert!(sharpest < 4.0, "{sharpest}");
    assert!(drive.ego().frenet.s_m > 300.0);
}

#[test]
fn keeping_a_lane_tracks_its_centre() {
    for index in 0..3 {
        let mut drive = Drive::new(corner(), index, 20.0, 14.0);
        let center = drive.road.lane_center_m(lane(index));
        let mut worst = 0.0_f64;
        for _ in 0..(25.0 / STEP_S) as usize {
            let output = drive.control();
            drive.apply(output.u);
            worst = worst.max((drive.ego().frenet.d_m - center).abs());
        }
        assert!(worst < 0.1, "lane {index}: {worst}");
    }
}
