//! What becomes of a lane change that runs, and what is left when nothing is safe.

use covista_world::{ActionVerdict, BarrierKind};

use super::*;
use crate::Manoeuvre;

/// A change from lane 1 to lane 0 that has run until the rear axle is at `until_m`.
fn changing(until_m: f64) -> Drive {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.controller.set_action(Action::ChangeLeft, 0.0);
    while drive.ego().frenet.d_m < until_m {
        let output = drive.control();
        drive.apply(output.u);
    }
    assert!(runs(&drive));
    drive
}

fn runs(drive: &Drive) -> bool {
    matches!(drive.controller.manoeuvre(), Manoeuvre::ChangeLane { .. })
}

fn aborts(drive: &Drive) -> bool {
    matches!(drive.controller.manoeuvre(), Manoeuvre::Abort { .. })
}

/// One step for the rows to see it, one for the manoeuvre to change.
fn two_steps(drive: &mut Drive) {
    drive.control();
    drive.control();
}

#[test]
fn a_change_that_is_not_wanted_any_more_is_given_up() {
    let mut drive = changing(0.6);
    drive.controller.set_action(Action::KeepLane, drive.time_s);
    two_steps(&mut drive);
    assert!(aborts(&drive));
    assert_eq!(drive.controller.manoeuvre().action(), Action::ChangeRight);
    assert_eq!(drive.controller.manoeuvre().destination(), lane(1));
    drive.run(8.0);
    let kept = Manoeuvre::KeepLane { lane: lane(1) };
    assert_eq!(drive.controller.manoeuvre(), kept);
    assert!(drive.ego().frenet.d_m.abs() < 0.1);
}

#[test]
fn a_change_that_is_wanted_goes_on() {
    let mut drive = changing(0.6);
    drive
        .controller
        .set_action(Action::ChangeLeft, drive.time_s);
    two_steps(&mut drive);
    assert!(runs(&drive));
    drive.run(8.0);
    assert_eq!(
        drive.controller.manoeuvre(),
        Manoeuvre::KeepLane { lane: lane(0) }
    );
}

#[test]
fn past_the_middle_there_is_no_way_back() {
    let mut drive = changing(2.2);
    let going_back = drive.verdict(Action::KeepLane);
    assert_eq!(going_back, ActionVerdict::Unsafe(BarrierKind::Manoeuvre));
    drive.controller.set_action(Action::KeepLane, drive.time_s);
    two_steps(&mut drive);
    assert!(runs(&drive));
}

#[test]
fn there_is_no_way_back_into_a_lane_that_is_taken() {
    // Ahead: nearer than braking allows. Behind: nearer than it could brake for.
    for (away_m, speed_mps, against) in [
        (6.0, 8.0, BarrierKind::FrontTarget),
        (-6.0, 20.0, BarrierKind::RearTarget),
    ] {
        let mut drive = changing(1.2);
        let center_m = SEDAN.center_pose(drive.state.pose).x_m;
        drive.others = vec![Other::new(1, center_m + away_m, 0.0, speed_mps)];
        assert_eq!(
            drive.verdict(Action::KeepLane),
            ActionVerdict::Unsafe(against)
        );
        drive.controller.set_action(Action::KeepLane, drive.time_s);
        two_steps(&mut drive);
        assert!(runs(&drive), "{away_m}");
        // Nobody there: it goes back.
        drive.others.clear();
        two_steps(&mut drive);
        assert!(aborts(&drive), "{away_m}");
    }
}

#[test]
fn a_change_that_is_threatened_from_behind_is_given_up() {
    let mut drive = changing(0.6);
    let center_m = SEDAN.center_pose(drive.state.pose).x_m;
    drive.others = vec![Other::new(1, center_m - 12.0, 3.5, 25.0)];
    assert_ne!(
        drive.verdict(Action::KeepLane),
        ActionVerdict::Unsafe(BarrierKind::Manoeuvre)
    );
    two_steps(&mut drive);
    assert!(aborts(&drive));
}

#[test]
fn a_leader_in_the_lane_that_is_left_is_no_threat() {
    let mut drive = changing(0.6);
    let center_m = SEDAN.center_pose(drive.state.pose).x_m;
    drive.others = vec![Other::new(1, center_m + 7.0, 0.0, 13.0)];
    two_steps(&mut drive);
    assert!(runs(&drive));
}

#[test]
fn going_on_is_unsafe_into_somebody_and_going_back_is_safe() {
    let mut drive = changing(0.6);
    let center_m = SEDAN.center_pose(drive.state.pose).x_m;
    drive.others = vec![Other::new(1, center_m + 10.0, 3.5, 0.0)];
    let front = ActionVerdict::Unsafe(BarrierKind::FrontTarget);
    assert_eq!(drive.verdict(Action::ChangeLeft), front);
    assert_eq!(drive.verdict(Action::KeepLane), ActionVerdict::Safe);
    let other_way = ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
    assert_eq!(drive.verdict(Action::ChangeRight), other_way);
}

#[test]
fn a_way_back_that_runs_can_only_go_on() {
    let mut drive = changing(0.8);
    drive.controller.set_action(Action::KeepLane, drive.time_s);
    two_steps(&mut drive);
    assert!(aborts(&drive));
    assert_eq!(drive.verdict(Action::KeepLane), ActionVerdict::Safe);
    assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
    let other_way = ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
    assert_eq!(drive.verdict(Action::ChangeLeft), other_way);
    let center_m = SEDAN.center_pose(drive.state.pose).x_m;
    drive.others = vec![Other::new(1, center_m + 10.0, 0.0, 0.0)];
    let front = ActionVerdict::Unsafe(BarrierKind::FrontTarget);
    assert_eq!(drive.verdict(Action::KeepLane), front);
}

#[test]
fn when_no_action_is_safe_the_emergency_stop_is() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.others = vec![
        Other::new(1, 110.0, 0.0, 0.0),
        Other::new(2, 101.0, 3.5, 14.0),
        Other::new(3, 99.0, -3.5, 14.0),
    ];
    let front = ActionVerdict::Unsafe(BarrierKind::FrontCurrent);
    assert_eq!(drive.verdict(Action::KeepLane), front);
    for action in Action::ALL {
        assert_ne!(drive.verdict(action), ActionVerdict::Safe, "{action:?}");
    }
    assert_eq!(drive.verdict(Action::EmergencyStop), ActionVerdict::Safe);
    assert!(!drive.control().emergency);
    drive.controller.set_action(Action::EmergencyStop, 0.0);
    let output = drive.control();
    assert!(output.emergency);
    assert!((output.u_nominal.accel_mps2 + 8.0).abs() < 1e-12);
    assert!((output.u.accel_mps2 + 8.0).abs() < 1e-9, "{output:?}");
    drive.controller.set_action(Action::KeepLane, 0.1);
    assert!(!drive.control().emergency);
}

#[test]
fn an_emergency_stop_during_a_change_goes_back_or_stays_in_both_lanes() {
    for until_m in [0.6, 2.2] {
        let mut drive = changing(until_m);
        // A follower asks for speed: an emergency stop heeds none.
        let center_m = SEDAN.center_pose(drive.state.pose).x_m;
        drive.others = vec![Other::new(1, center_m - 25.0, 3.5, 20.0)];
        drive
            .controller
            .set_action(Action::EmergencyStop, drive.time_s);
        for _ in 0..200 {
            let output = drive.control();
            assert!(output.emergency);
            let hardest = (-8.0_f64).max(-drive.state.speed_mps / STEP_S);
            assert!((output.u.accel_mps2 - hardest).abs() < 1e-6, "{output:?}");
            drive.apply(output.u);
            let (right, left) = drive.ego().lateral_extent_m(&drive.road);
            assert!(right > -1.75 - 1e-6 && left < 5.25 + 1e-6, "{right} {left}");
        }
        assert!(drive.state.speed_mps < 1e-9);
        assert_eq!(aborts(&drive), until_m < 1.0);
    }
}

#[test]
fn keeping_the_lane_is_unsafe_where_the_collision_level_is_broken() {
    let verdict_at = |above_m: f64| {
        let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
        drive.others = vec![Other::new(1, 200.0, 0.0, 3.0)];
        let h0_m = drive.control().h0_m;
        drive.others[0].s_m -= h0_m - above_m;
        (drive.verdict(Action::KeepLane), drive.control().h0_m)
    };
    let (safe, h0_m) = verdict_at(0.01);
    assert!(
        safe == ActionVerdict::Safe && (h0_m - 0.01).abs() < 1e-9,
        "{safe:?} {h0_m}"
    );
    let (broken, h0_m) = verdict_at(-0.01);
    let front = ActionVerdict::Unsafe(BarrierKind::FrontCurrent);
    assert!(
        broken == front && (h0_m + 0.01).abs() < 1e-9,
        "{broken:?} {h0_m}"
    );
}

#[test]
fn a_change_is_refused_where_the_sight_of_the_other_lane_is_too_short() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.clear_s_m = 130.0;
    let sight = ActionVerdict::Unsafe(BarrierKind::Sight);
    assert_eq!(drive.verdict(Action::ChangeLeft), sight);
    drive.clear_s_m = 160.0;
    assert_eq!(drive.verdict(Action::ChangeLeft), ActionVerdict::Safe);
}
