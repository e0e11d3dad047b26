//! The limit on the acceleration that a gap, a curve or a speed leaves, number by number.

use std::sync::Arc;

use covista_world::BarrierKind;

use super::*;
use crate::arc::ArcRates;
use crate::barriers::Barrier;
use crate::barriers::curve_speed::CurveSpeed;
use crate::barriers::front::{Ahead, Gap};
use crate::{Closing, Excuse};

fn gap(gap_m: f64, speed_mps: f64, leader_mps: f64) -> Gap {
    Gap {
        gap_m,
        speed_mps,
        leader_mps,
    }
}

fn closing() -> Closing {
    Closing::new(&SafetySettings::default(), 1.0, 1.0)
}

#[test]
fn a_vehicle_that_comes_to_stand_has_no_noise() {
    let safety = SafetySettings::default();
    let next = |accel: f64| gap(20.0, 0.08, 0.0).h_next_m(&closing(), &safety, 10.0, 0.0, accel);
    // 0.8 mm driven and 1 mm of noise.
    assert!(
        (next(-8.0) - (10.0 - 0.0018)).abs() < 1e-12,
        "{}",
        next(-8.0)
    );
    assert!((next(-9.0) - next(-8.0)).abs() < 1e-12);
    // Any speed is one with noise: a step of 5 mm/s.
    let slow = next(-7.9999) - next(-8.0);
    assert!(slow < -1e-3 && slow > -2e-3, "{slow}");
}

#[test]
fn a_brake_that_just_holds_the_row_may_miss_it_by_rounding() {
    let safety = SafetySettings::default();
    // At standstill: the budget is what is left of the gap.
    let most = |budget_m: f64| {
        gap(10.0 + budget_m, 0.0, 0.0).accel_max_mps2(&closing(), &safety, 10.0, 0.0, 0.0)
    };
    assert!(most(1e-12).abs() < 1e-12);
    assert!(most(-5e-10).abs() < 1e-12, "{}", most(-5e-10));
    assert!(most(-2e-9) < -1e300, "{}", most(-2e-9));
    assert!(most(100.0) > 1e300);
    // The noise alone fills a centimetre: the least budget for any start is W_v's own way.
    assert!(most(0.5) > 0.0 && most(0.5) < 1e300 || most(0.5) > 1e300);
}

#[test]
fn a_limit_beyond_what_the_vehicle_can_is_none() {
    let safety = SafetySettings::default();
    let v = 10.0;
    let at = |accel: f64| {
        let d_m = closing().distance_m(v + accel * STEP_S + 5e-3, 0.0);
        gap(10.0 + d_m + v * STEP_S + 1e-3, v, 0.0).accel_max_mps2(
            &closing(),
            &safety,
            10.0,
            0.0,
            0.0,
        )
    };
    for accel in [-7.0, 0.0, 1.0, 2.9] {
        assert!((at(accel) - accel).abs() < 1e-6, "{accel}: {}", at(accel));
    }
    assert!(at(3.001) > 1e300, "{}", at(3.001));
}

#[test]
fn the_rates_are_those_of_half_a_lane() {
    let road = corner();
    let drive = Drive::new(corner(), 1, 200.0, 10.0);
    let ahead = Ahead::new(
        &road,
        drive.ego(),
        lane(1),
        5.25,
        BarrierKind::FrontCurrent,
        false,
    );
    assert_eq!(ahead.rates_in_lane, ArcRates::new(&road, 3.5));
    assert_eq!(ahead.rates, ArcRates::new(&road, 5.25));
    // 1.75 / 80 of the radius that is left on the inside, 80 - 5.25 m.
    assert!((ahead.rates_in_lane.high - (1.0 + 3.5 / 74.75)).abs() < 1e-9);
    assert!((ahead.rates_in_lane.low - (1.0 - 3.5 / 74.75)).abs() < 1e-9);
}

#[test]
fn while_h_holds_an_excuse_changes_nothing() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.others = vec![Other::new(1, 200.0, 0.0, 10.0)];
    drive.others[0].s_m -= drive.control().h_m - 0.05;
    let safety = drive.safety();
    drive.with_situation(|_, situation| {
        let ahead = crate::rows::ahead_in(situation, &Course::keep(lane(1)))
            .next()
            .expect("a lane");
        let closing = ahead.closing(&safety);
        let front =
            crate::barriers::front::Front::new(&ahead, closing, &situation.neighbours[0], &safety);
        let plain = front.row().upper;
        for excuse in [
            Excuse::CutIn,
            Excuse::Revealed,
            Excuse::Leaving,
            Excuse::Revised,
        ] {
            let excused = front.excused(Some(excuse)).row().upper;
            assert!((plain - excused).abs() < 1e-12, "{excuse:?}");
        }
    });
}

/// A road whose limit falls towards an arc, and the places and speeds there.
fn curve_speed(s_m: f64, next_s_m: f64, v: f64, act: impl FnOnce(&CurveSpeed<'_>)) {
    let profile = RoadProfile::new(Arc::new(corner()), &ControlSettings::default());
    let safety = SafetySettings::default();
    act(&CurveSpeed::new(&profile, s_m, [next_s_m; 2], v, &safety));
}

#[test]
fn the_curve_leaves_the_acceleration_that_meets_its_limit() {
    let profile = RoadProfile::new(Arc::new(corner()), &ControlSettings::default());
    let limit_mps = profile.speed_limit_mps(230.0);
    for room_mps in [0.0, 0.01, 0.05, 3.0] {
        let v = limit_mps - room_mps;
        curve_speed(230.0, 230.1, v, |barrier| {
            assert!((barrier.h() - room_mps).abs() < 1e-9);
            assert!((barrier.target() - 0.8 * room_mps).abs() < 1e-9);
            let expected = (limit_mps - 0.8 * room_mps - 5e-3 - v) / STEP_S;
            let upper = barrier.row().upper;
            assert!(
                (upper - expected).abs() < 1e-6,
                "{room_mps}: {upper} {expected}"
            );
        });
    }
}

#[test]
fn too_fast_for_the_road_it_brakes_gently_at_least_and_as_hard_as_it_can_at_most() {
    let profile = RoadProfile::new(Arc::new(corner()), &ControlSettings::default());
    let limit_mps = profile.speed_limit_mps(230.0);
    for (excess_mps, expected) in [(2e-9, -3.0), (0.02, -3.0), (0.05, -5.5), (2.0, -8.0)] {
        curve_speed(230.0, 230.1, limit_mps + excess_mps, |barrier| {
            assert!(barrier.target().abs() < 1e-12);
            let upper = barrier.row().upper;
            assert!((upper - expected).abs() < 1e-3, "{excess_mps}: {upper}");
        });
    }
    // Within rounding it is not too fast: the noise alone is taken off.
    curve_speed(230.0, 230.1, limit_mps + 5e-10, |barrier| {
        assert!(
            (barrier.row().upper + 0.5).abs() < 1e-3,
            "{}",
            barrier.row().upper
        );
    });
    // However little is left ahead, it brakes to a stand and no more.
    curve_speed(0.0, 230.1, 0.01, |barrier| {
        assert!(
            (barrier.row().upper + 1.0).abs() < 1e-9,
            "{}",
            barrier.row().upper
        );
    });
}

/// D is flat where a leader is faster and the ego vehicle is about to stop: rounding on the plateau
/// must not take the input away.
#[test]
fn hardest_braking_holds_the_distance_at_any_speeds() {
    let safety = SafetySettings::default();
    let closing = crate::Closing::new(&safety, 1.013, 0.99);
    let mut dice = Dice(3);
    for i in 0..300_000 {
        let speed_mps = dice.uniform(0.08, if i % 2 == 0 { 0.3 } else { 30.0 });
        let leader_mps = dice.uniform(0.0, 1.6) * speed_mps;
        let keep_m = 13.9;
        let gap = crate::barriers::front::Gap {
            gap_m: dice.uniform(-2.0, 0.0) + keep_m + closing.distance_m(speed_mps, leader_mps),
            speed_mps,
            leader_mps,
        };
        let held_m = gap.h_m(&closing, keep_m);
        let next_mps = closing.leader_after_step_mps(leader_mps);
        let most = gap.accel_max_mps2(&closing, &safety, keep_m, held_m, next_mps);
        assert!(most >= -8.0 - 1e-6, "{gap:?} {most}");
    }
}
