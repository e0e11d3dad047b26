//! The lateral barriers with noise and on curved roads, computed anew: the way back to parallel is
//! sampled, not solved.

use std::f64::consts::FRAC_PI_2;

use super::*;
use crate::barriers::lateral::{Lateral, Strip};
use crate::barriers::{Barrier, Input};

/// Rear axle to front and rear, and half the width.
const FRONT_M: f64 = SEDAN.length_m - SEDAN.rear_overhang_m;
const REAR_M: f64 = SEDAN.rear_overhang_m;
const HALF_M: f64 = SEDAN.width_m / 2.0;
/// Noise of the default settings: of position, of direction, of curvature, of speed.
const W_P_M: f64 = 1e-3;
const SLIP_RAD: f64 = 2e-3;
const BEND_PER_M: f64 = 1e-4;
const W_V_MPS: f64 = 5e-3;

fn lock(v: f64) -> f64 {
    0.6_f64.min(4.0 * SEDAN.wheelbase_m / (v * v).max(1e-9))
}

/// Share of v Ts that a step may drive farther.
fn overrun(v: f64) -> f64 {
    0.1_f64.min(W_P_M / (v * STEP_S))
}

/// What the heading relative to a road of sharpest path kappa may be off by after a step.
fn bend_rad(v: f64, kappa: f64) -> f64 {
    v * STEP_S * (1.0 + overrun(v)) * (BEND_PER_M + kappa * overrun(v))
}

/// |kappa| of the sharpest path along a road of curvature kappa, three lanes of 3.5 m wide.
fn path(kappa: f64) -> f64 {
    kappa / (1.0 - 5.25 * kappa)
}

/// The highest value over [0, most] of a function with one peak: sampled, then narrowed down.
fn highest(most: f64, value: impl Fn(f64) -> f64) -> f64 {
    let at = |i: i32| most * f64::from(i) / 200.0;
    let best = (0..=200)
        .max_by(|a, b| value(at(*a)).total_cmp(&value(at(*b))))
        .unwrap_or(0);
    let (mut low, mut high) = (at((best - 1).max(0)), at((best + 1).min(200)));
    for _ in 0..60 {
        let third = (high - low) / 3.0;
        if value(low + third) < value(high - third) {
            low += third;
        } else {
            high -= third;
        }
    }
    value(low)
}

/// How far the front reaches to its side until the vehicle runs parallel.
fn front_reach_m(profile: &RoadProfile, s_m: [f64; 2], v: f64, psi: f64) -> f64 {
    let road = profile.road();
    // A start from standstill can't be steered.
    let v = v.max(3.0 * STEP_S + W_V_MPS);
    let step_m = v * STEP_S * (1.0 + overrun(v));
    let sharpest = path(road.sharpest_per_m());
    let shift = sharpest * step_m + SLIP_RAD;
    let rear_m = REAR_M * (shift + 2.0 * bend_rad(v, sharpest));
    let psi = (psi + shift).min(FRAC_PI_2);
    if psi <= 0.0 {
        return HALF_M + rear_m;
    }
    let left = |tan: f64, v: f64| (tan / SEDAN.wheelbase_m - BEND_PER_M) / (1.0 + overrun(v));
    let own = left(lock(v), v).min(left(0.6, 0.0));
    let floor = profile.counter_floor_per_m();
    let least = (own - sharpest).max(floor);
    let way_m = 1.01 * psi / least / (1.0 - 5.25 * road.sharpest_per_m());
    let counter = (own - path(road.max_abs_curvature(s_m[0], s_m[1] + way_m))).max(floor);
    let corner = highest(psi, |theta| {
        let drift_m = (theta.cos() - psi.cos()) / counter;
        drift_m + FRONT_M * theta.sin() + HALF_M * theta.cos()
    });
    corner + rear_m + step_m * psi.sin()
}

/// How far the rear corner reaches to a side; it swings out while the heading points away.
fn rear_reach_m(psi: f64) -> f64 {
    (0..=2000)
        .map(|i| (-psi).clamp(0.0, FRAC_PI_2) * f64::from(i) / 2000.0)
        .map(|theta| REAR_M * theta.sin() + HALF_M * theta.cos())
        .fold(HALF_M, f64::max)
}

/// h and h(x+) of the front and the rear at one side, +1 for left.
fn expected(drive: &Drive, side: f64, u: ControlInput) -> [(f64, f64); 2] {
    let (road, ego) = (&drive.road, drive.ego());
    let (v, now) = (ego.state.speed_mps, ego.frenet);
    let sharpest = path(road.sharpest_per_m());
    let edge_m = 1.75 - 0.5 * sharpest * (FRONT_M * FRONT_M + HALF_M * HALF_M);
    let room_m = edge_m - side * now.d_m;
    let straight = bicycle_step(ego.state, ControlInput::default(), SEDAN.wheelbase_m);
    let next = road.to_frenet_pose(straight.pose);
    // The direction of travel is off by the slip, and the step is longer.
    let off = side * now.psi_rad + SLIP_RAD;
    let more_m = overrun(v) * off.sin().abs() + off.sin() - (side * now.psi_rad).sin();
    let next_room_m = edge_m - side * next.d_m - v * STEP_S * more_m;
    let turn = v * STEP_S * u.tan_delta / SEDAN.wheelbase_m;
    let bend = bend_rad(v, sharpest);
    let psi = side * (next.psi_rad + turn);
    let next_v = (v + u.accel_mps2 * STEP_S + W_V_MPS).max(0.0);
    let along_m = (overrun(v) + SLIP_RAD * now.psi_rad.sin().abs()) * v * STEP_S;
    let along_m = along_m / (1.0 - 5.25 * road.sharpest_per_m());
    let next_s_m = [next.s_m - along_m, next.s_m + along_m];
    let front_m = |s_m, v, psi| front_reach_m(&drive.profile, s_m, v, psi);
    [
        (
            room_m - front_m([now.s_m; 2], v, side * now.psi_rad),
            next_room_m - front_m(next_s_m, next_v, psi + bend),
        ),
        (
            room_m - rear_reach_m(side * now.psi_rad),
            next_room_m - rear_reach_m(psi - bend),
        ),
    ]
}

fn check(road: Road, seed: u64) {
    let mut dice = Dice(seed);
    for round in 0..400 {
        let mut drive = Drive::new(road.clone(), 1, 100.0, 10.0);
        let s_m = dice.uniform(20.0, 420.0);
        let limit_mps = drive.profile.speed_limit_mps(s_m).min(30.0);
        let speed_mps = match round % 4 {
            0 => dice.uniform(2e-3, 0.2),
            1 => limit_mps * dice.uniform(0.9, 1.0),
            _ => limit_mps * dice.uniform(0.0, 1.0),
        };
        let psi_rad = dice.uniform(-1.0, 1.0) * [0.01, 0.1, 0.4, 1.7][round / 4 % 4];
        let d_m = dice.uniform(-0.8, 0.8);
        drive.state = BicycleState {
            pose: drive.road.pose_from_frenet(s_m, d_m, psi_rad),
            speed_mps,
        };
        let u = input(
            dice.uniform(-1.0, 1.0) * lock(speed_mps),
            dice.uniform((-8.0_f64).max(-speed_mps / STEP_S), 3.0),
        );
        let sides = [1.0, -1.0].map(|side| expected(&drive, side, u));
        let safety = drive.safety();
        drive.with_situation(|_, situation| {
            let ego = &situation.ego;
            let straight = bicycle_step(ego.state, ControlInput::default(), SEDAN.wheelbase_m);
            let next = situation.road().to_frenet_pose(straight.pose);
            let strip = Strip::of(situation.road(), &[lane(1)]);
            let lateral = Lateral::new(situation.profile, ego, next, strip, &safety);
            let found: Vec<_> = lateral.barriers(u.accel_mps2).collect();
            let lowest = sides
                .as_flattened()
                .iter()
                .fold(f64::INFINITY, |low, h| low.min(h.0));
            assert!((lateral.h_m() - lowest).abs() < 1e-6, "{ego:?}");
            for (barrier, (h, h_next)) in found.iter().zip(sides.as_flattened()) {
                assert!((barrier.h() - h).abs() < 1e-6, "{ego:?} {barrier:?} {h}");
                let next = barrier.h_next(u);
                assert!(
                    (next - h_next).abs() < 1e-6,
                    "{ego:?} {barrier:?}: {next} {h_next}"
                );
            }
            assert_eq!(found.len(), 4);
        });
    }
}

#[test]
fn the_lateral_barriers_with_noise_are_the_sampled_way_back() {
    check(straight(), 5);
}

#[test]
fn the_lateral_barriers_round_the_corner_are_the_sampled_way_back() {
    check(corner(), 6);
}

#[test]
fn only_what_turns_by_less_than_nothing_has_no_steering_row() {
    for (speed_mps, rows) in [(0.0, 0), (9e-6, 0), (1.1e-5, 4), (1.0, 4)] {
        let mut drive = Drive::new(straight(), 1, 100.0, speed_mps);
        let safety = drive.safety();
        let found = drive.with_situation(|_, situation| {
            let found = rows_of_steering(situation, &safety);
            found
                .iter()
                .filter(|row| row.input == Input::TanDelta)
                .count()
        });
        assert_eq!(found, rows, "{speed_mps}");
    }
}

fn rows_of_steering(
    situation: &Situation<'_>,
    safety: &SafetySettings,
) -> Vec<crate::barriers::Row> {
    rows(situation, &Course::keep(lane(1)), safety).hard
}

/// Where no steering meets the rows at the fastest v+, a slower one is asked for, no slower than
/// needed.
#[test]
fn where_steering_does_not_suffice_the_speed_gives_way() {
    let mut dice = Dice(8);
    let mut bounded = 0;
    for _ in 0..2000 {
        let speed_mps = dice.uniform(1.0, 30.0);
        let mut drive = Drive::new(straight(), 1, 100.0, speed_mps);
        let psi_rad = dice.uniform(-0.1, 0.1);
        drive.state.pose = Se2Pose::new(100.0, 0.0, psi_rad);
        // To the edge of the set.
        let room_m = drive.control().h_lateral_m - dice.uniform(0.0, 1e-3);
        drive.state.pose.y_m = psi_rad.signum() * room_m;
        let safety = drive.safety();
        drive.with_situation(|_, situation| {
            let ego = &situation.ego;
            let straight = bicycle_step(ego.state, ControlInput::default(), SEDAN.wheelbase_m);
            let next = situation.road().to_frenet_pose(straight.pose);
            let strip = Strip::of(situation.road(), &[lane(1)]);
            let lateral = Lateral::new(situation.profile, ego, next, strip, &safety);
            if lateral.h_m() < 0.0 {
                return;
            }
            // By full lock away from either side, at an acceleration.
            let is_met = |accel: f64| {
                lateral.barriers(accel).all(|barrier| {
                    let row = barrier.row();
                    row.lower < 1e300 && row.upper > -1e300
                })
            };
            let row = lateral.speed_row(-8.0, 3.0);
            match row {
                None => assert!(is_met(3.0), "{ego:?}"),
                Some(row) => {
                    bounded += 1;
                    assert_eq!(row.input, Input::Accel);
                    assert!(row.upper < 3.0 && row.upper >= -8.0, "{row:?}");
                    assert!(is_met(row.upper), "{ego:?} {row:?}");
                    assert!(!is_met(row.upper + 1e-3), "{ego:?} {row:?}");
                }
            }
        });
    }
    assert!(bounded > 100, "{bounded}");
}
