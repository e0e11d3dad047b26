use covista_world::{ActionVerdict, BarrierKind, FilterOutcome};

use super::*;
use crate::Manoeuvre;

#[test]
fn a_lane_change_completes_in_the_corner() {
    let mut drive = Drive::new(corner(), 0, 160.0, 14.0);
    drive.controller.set_action(Action::ChangeRight, 0.0);
    let (mut sharpest, mut filtered) = (0.0_f64, 0);
    let mut done_s = None;
    for _ in 0..1000 {
        let output = drive.control();
        sharpest = sharpest.max(drive.lateral_accel_mps2(output.u).abs());
        filtered += usize::from(output.outcome != FilterOutcome::Nominal);
        drive.apply(output.u);
        if done_s.is_none()
            && drive.controller.manoeuvre() == (Manoeuvre::KeepLane { lane: lane(1) })
        {
            done_s = Some(drive.time_s);
        }
    }
    let done_s = done_s.expect("the change ends");
    assert!((4.0..6.5).contains(&done_s), "{done_s}");
    assert!(sharpest < 4.0, "{sharpest}");
    assert!(drive.ego().frenet.d_m.abs() < 0.3);
    assert!(filtered < 20, "{filtered}");
}

#[test]
fn a_lane_change_follows_its_path() {
    let mut drive = Drive::new(corner(), 1, 150.0, 13.0);
    drive.controller.set_action(Action::ChangeLeft, 0.0);
    let mut overshoot = 0.0_f64;
    for _ in 0..1000 {
        let output = drive.control();
        drive.apply(output.u);
        overshoot = overshoot.max(drive.ego().frenet.d_m - 3.5);
    }
    assert!(overshoot < 0.3, "{overshoot}");
    assert!((drive.ego().frenet.d_m - 3.5).abs() < 0.1);
}

#[test]
fn a_vehicle_leaves_from_standstill_round_a_stopped_one() {
    for road in [straight(), corner()] {
        let mut drive = Drive::new(road, 0, 200.0, 0.0);
        drive.desired_mps = 14.0;
        drive.others = vec![Other::new(9, 218.0, 3.5, 0.0)];
        assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
        drive.controller.set_action(Action::ChangeRight, 0.0);
        let mut lowest_h0 = f64::INFINITY;
        for _ in 0..2000 {
            let output = drive.control();
            lowest_h0 = lowest_h0.min(output.h0_m);
            drive.apply(output.u);
        }
        let manoeuvre = drive.controller.manoeuvre();
        assert_eq!(manoeuvre, Manoeuvre::KeepLane { lane: lane(1) });
        assert!(drive.ego().frenet.s_m > 250.0, "{:?}", drive.ego());
        assert!(lowest_h0 > -1e-6, "{lowest_h0}");
    }
}

#[test]
fn a_vehicle_stops_behind_a_stopped_one_and_stays_outside_the_headway() {
    let mut drive = Drive::new(corner(), 0, 100.0, 14.0);
    drive.others = vec![Other::new(9, 230.0, 3.5, 0.0)];
    let mut hardest = 0.0_f64;
    for _ in 0..3000 {
        let output = drive.control();
        hardest = hardest.min(output.u.accel_mps2);
        drive.apply(output.u);
    }
    let center = SEDAN.center_pose(drive.state.pose).position();
    let headway = 230.0 - drive.road.to_frenet(center).s_m;
    assert!(drive.state.speed_mps < 0.1, "{}", drive.state.speed_mps);
    // Along the left lane the road is shorter than along the reference line.
    assert!((19.0..22.0).contains(&headway), "{headway}");
    assert!(hardest > -4.0 - 1e-9, "{hardest}");
}

#[test]
fn there_is_no_lane_beyond_the_edge() {
    let mut drive = Drive::new(straight(), 0, 100.0, 14.0);
    let unsafe_manoeuvre = ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
    assert_eq!(drive.verdict(Action::ChangeLeft), unsafe_manoeuvre);
    assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
    assert_eq!(drive.verdict(Action::KeepLane), ActionVerdict::Safe);
}

#[test]
fn a_gap_that_is_taken_is_unsafe() {
    let beside = |s_m: f64, speed_mps: f64| {
        let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
        drive.others = vec![Other::new(2, s_m, 3.5, speed_mps)];
        drive.verdict(Action::ChangeLeft)
    };
    let front = ActionVerdict::Unsafe(BarrierKind::FrontTarget);
    let rear = ActionVerdict::Unsafe(BarrierKind::RearTarget);
    assert_eq!(beside(102.0, 14.0), front);
    assert_eq!(beside(115.0, 14.0), front);
    assert_eq!(beside(98.0, 14.0), rear);
    assert_eq!(beside(60.0, 25.0), rear);
    assert_eq!(beside(150.0, 14.0), ActionVerdict::Safe);
    assert_eq!(beside(20.0, 14.0), ActionVerdict::Safe);
}

#[test]
fn a_driver_two_lanes_over_may_enter() {
    let mut drive = Drive::new(straight(), 0, 100.0, 14.0);
    drive.others = vec![Other::new(2, 100.5, -3.5, 14.0)];
    let front = ActionVerdict::Unsafe(BarrierKind::FrontTarget);
    assert_ne!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
    drive.others[0].s_m = 108.0;
    assert_eq!(drive.verdict(Action::ChangeRight), front);
    // A CAV tells what it is about.
    drive.others[0].station = Some(StationId(2));
    drive.others[0].action = Some(Action::KeepLane);
    assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
}

#[test]
fn the_earlier_announcement_has_precedence_then_the_lower_station() {
    let verdict = |station: u32, announced_s: f64| {
        let mut drive = Drive::new(straight(), 0, 100.0, 14.0);
        drive.time_s = 10.0;
        drive.controller.set_action(Action::ChangeRight, 9.9);
        drive.others = vec![Other {
            station: Some(StationId(station)),
            action: Some(Action::ChangeLeft),
            announced_s: Some(announced_s),
            ..Other::new(4, 106.0, -3.5, 14.0)
        }];
        drive.verdict(Action::ChangeRight)
    };
    let loses = ActionVerdict::Unsafe(BarrierKind::Arbitration);
    assert_eq!(verdict(9, 9.5), loses);
    assert_eq!(verdict(3, 9.9), loses);
    assert_eq!(verdict(9, 9.9), ActionVerdict::Safe);
    assert_eq!(verdict(3, 9.95), ActionVerdict::Safe);
}

/// Both change into the middle lane, the one ahead has precedence and brakes before it is there.
#[test]
fn room_left_to_one_that_enters_the_same_lane_is_kept() {
    let gap_m = |enters: bool| {
        let mut drive = Drive::new(straight(), 0, 100.0, 16.0);
        drive.controller.set_action(Action::ChangeRight, 0.0);
        drive.others = vec![Other {
            station: Some(StationId(1)),
            action: Some(if enters {
                Action::ChangeLeft
            } else {
                Action::KeepLane
            }),
            announced_s: Some(0.0),
            ..Other::new(4, 133.0, -3.5, 14.0)
        }];
        for step in 0..300 {
            let output = drive.control();
            drive.apply(output.u);
            drive.others[0].step(if step > 40 { -2.0 } else { 0.0 });
        }
        let started = matches!(drive.controller.manoeuvre(), Manoeuvre::ChangeLane { .. });
        assert!(started, "{:?}", drive.controller.manoeuvre());
        let (v, v_k) = (drive.state.speed_mps, drive.others[0].speed_mps);
        let closed_m = (v * v - v_k * v_k).max(0.0) / 16.0;
        drive.others[0].s_m - drive.ego().frenet.s_m - closed_m
    };
    assert!(gap_m(true) > 18.5, "{}", gap_m(true));
    assert!(gap_m(false) < 18.5, "{}", gap_m(false));
}

/// The acceleration in a running change to the middle lane, with `others` on the far side of it.
fn accel_while_changing(others: Vec<Other>) -> f64 {
    let mut drive = Drive::new(straight(), 0, 100.0, 16.0);
    drive.controller.set_action(Action::ChangeRight, 0.0);
    for _ in 0..40 {
        let output = drive.control();
        drive.apply(output.u);
    }
    drive.others = others;
    drive.control().u.accel_mps2
}

#[test]
fn who_enters_the_same_lane_counts_if_it_precedes_moves_and_leaves_room() {
    let free = accel_while_changing(Vec::new());
    let held_at = |of: &dyn Fn(&mut Other)| -> Vec<f64> {
        let places = (-200..320).map(|quarter| 106.4 + 0.25 * f64::from(quarter));
        let is_held = |s_m: &f64| {
            let mut other = Other {
                station: Some(StationId(1)),
                action: Some(Action::ChangeLeft),
                announced_s: Some(0.0),
                ..Other::new(4, *s_m, -3.5, 10.0)
            };
            of(&mut other);
            accel_while_changing(vec![other]) < free - 1e-9
        };
        places.filter(is_held).collect()
    };
    let held = held_at(&|_| ());
    assert!(held.len() > 1 && held[0] > 106.4 + 24.0, "{held:?}");
    let earlier = |other: &mut Other| {
        (other.station, other.announced_s) = (Some(StationId(99)), Some(-0.2));
    };
    assert_eq!(held_at(&earlier), held);
    let nobody: [&dyn Fn(&mut Other); 7] = [
        &|other| other.station = Some(StationId(99)),
        &|other| other.station = Some(STATION),
        &|other| other.announced_s = Some(0.1),
        &|other| other.action = Some(Action::KeepLane),
        &|other| other.action = Some(Action::ChangeRight),
        &|other| other.speed_mps = 0.0,
        &|other| other.station = None,
    ];
    for (case, of) in nobody.into_iter().enumerate() {
        assert_eq!(held_at(of), Vec::<f64>::new(), "{case}");
    }
}

#[test]
fn an_announced_change_waits_for_its_gap() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.others = vec![Other::new(2, 100.0, 3.5, 14.0)];
    drive.controller.set_action(Action::ChangeLeft, 0.0);
    for _ in 0..100 {
        let output = drive.control();
        drive.apply(output.u);
        drive.others[0].step(0.0);
    }
    assert!(matches!(
        drive.controller.manoeuvre(),
        Manoeuvre::Announced { .. }
    ));
    assert!(drive.ego().frenet.d_m.abs() < 0.05);
    drive.controller.set_action(Action::KeepLane, 1.0);
    let kept = Manoeuvre::KeepLane { lane: lane(1) };
    assert_eq!(drive.controller.manoeuvre(), kept);
}

#[test]
fn a_change_into_a_lane_that_is_cut_off_is_aborted() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.controller.set_action(Action::ChangeLeft, 0.0);
    for _ in 0..130 {
        let output = drive.control();
        drive.apply(output.u);
    }
    assert!(matches!(
        drive.controller.manoeuvre(),
        Manoeuvre::ChangeLane { .. }
    ));
    // Somebody stands in the target lane who was not known.
    let s_m = drive.ego().frenet.s_m;
    drive.others = vec![Other::new(5, s_m + 16.0, 3.5, 0.0)];
    // One step sees the threat, the next gives up.
    drive.control();
    drive.control();
    assert!(matches!(
        drive.controller.manoeuvre(),
        Manoeuvre::Abort { .. }
    ));
    let mut left_most = f64::NEG_INFINITY;
    for _ in 0..2000 {
        let output = drive.control();
        drive.apply(output.u);
        let (_, left) = drive.ego().lateral_extent_m(&drive.road);
        left_most = left_most.max(left);
    }
    let kept = Manoeuvre::KeepLane { lane: lane(1) };
    assert_eq!(drive.controller.manoeuvre(), kept);
    assert!(left_most < 3.5 - SEDAN.width_m / 2.0, "{left_most}");
}

#[test]
fn a_running_change_excludes_the_other_direction() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.controller.set_action(Action::ChangeLeft, 0.0);
    for _ in 0..100 {
        let output = drive.control();
        drive.apply(output.u);
    }
    let excluded = ActionVerdict::Unsafe(BarrierKind::Manoeuvre);
    assert_eq!(drive.verdict(Action::ChangeRight), excluded);
    assert_eq!(drive.verdict(Action::ChangeLeft), ActionVerdict::Safe);
    assert_eq!(drive.verdict(Action::KeepLane), ActionVerdict::Safe);
}

#[test]
fn a_follower_is_given_way_only_while_the_front_allows() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.controller.set_action(Action::ChangeLeft, 0.0);
    for _ in 0..230 {
        let output = drive.control();
        drive.apply(output.u);
    }
    // Past the middle there is no way back: somebody races up from behind.
    let s_m = drive.ego().frenet.s_m;
    drive.others = vec![Other::new(6, s_m - 30.0, 3.5, 22.0)];
    drive.desired_mps = 8.0;
    let output = drive.control();
    assert!(output.rear_slack_mps2 > 0.0, "{output:?}");
    assert!(output.u.accel_mps2.abs() < 1e-6, "{output:?}");
    drive
        .controller
        .set_action(Action::EmergencyStop, drive.time_s);
    let output = drive.control();
    assert!((output.u.accel_mps2 + 8.0).abs() < 1e-9, "{output:?}");
}

#[test]
fn who_has_left_a_lane_does_not_stop_for_what_stands_in_it() {
    let mut drive = Drive::new(straight(), 0, 100.0, 10.0);
    drive.others = vec![Other::new(9, 170.0, 3.5, 0.0)];
    drive.controller.set_action(Action::ChangeRight, 0.0);
    let mut passed = false;
    for _ in 0..1200 {
        let output = drive.control();
        drive.apply(output.u);
        let center_m = drive.ego().frenet.s_m + 1.35;
        if (150.0..190.0).contains(&center_m) && drive.ego().frenet.d_m < 0.5 {
            assert_eq!(drive.verdict(Action::ChangeRight), ActionVerdict::Safe);
            passed = true;
        }
    }
    assert!(
        passed && drive.ego().frenet.s_m > 190.0,
        "{:?}",
        drive.ego()
    );
}
