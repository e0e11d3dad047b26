//! Which vehicles and which sight have a row, and what is missing of the rows.

use covista_world::BarrierKind;

use super::*;
use crate::barriers::Row;
use crate::rows::shortfall;

/// How many rows of a kind there are, keeping lane 1 or leaving it to the left.
fn count(drive: &mut Drive, neighbours: &[Neighbour], kind: BarrierKind, changes: bool) -> usize {
    let found = rows_of(drive, neighbours, changes);
    found
        .hard
        .iter()
        .chain(&found.rear)
        .filter(|row| row.kind == kind)
        .count()
}

fn rows_of(drive: &mut Drive, neighbours: &[Neighbour], changes: bool) -> Rows {
    let safety = drive.safety();
    let course = if changes {
        Course::change(lane(1), lane(0))
    } else {
        Course::keep(lane(1))
    };
    drive.with_situation(|_, situation| {
        rows(
            &Situation {
                neighbours,
                ..*situation
            },
            &course,
            &safety,
        )
    })
}

/// In lane 1 by its lanes, wherever its body is.
fn in_lane(drive: &mut Drive, rear_s_m: f64, right_m: f64, left_m: f64) -> Neighbour {
    drive.others = vec![Other::new(1, 100.0, 0.0, 10.0)];
    drive.with_situation(|_, situation| Neighbour {
        s_rear_m: rear_s_m,
        s_front_m: rear_s_m + 8.0,
        d_right_m: right_m,
        d_left_m: left_m,
        ..situation.neighbours[0]
    })
}

#[test]
fn one_beside_that_only_touches_the_line_is_no_leader() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    let ego = drive.ego();
    let front_s_m = ego.frenet.s_m + ego.front_m();
    // Half the width and 0.3 m: 1.225 m to either side.
    for (side_m, is_leader) in [(1.22, true), (1.23, false)] {
        let left = in_lane(&mut drive, front_s_m - 1.0, side_m, side_m + 1.8);
        let right = in_lane(&mut drive, front_s_m - 1.0, -side_m - 1.8, -side_m);
        for beside in [left, right] {
            let found = count(&mut drive, &[beside], BarrierKind::FrontCurrent, false);
            assert_eq!(found, usize::from(is_leader), "{side_m}");
        }
    }
    // With its rear bumper ahead of the front it is one wherever it is.
    for (ahead_m, is_leader) in [(0.01, true), (-0.01, false)] {
        let beside = in_lane(&mut drive, front_s_m + ahead_m, 1.3, 3.1);
        let found = count(&mut drive, &[beside], BarrierKind::FrontCurrent, false);
        assert_eq!(found, usize::from(is_leader), "{ahead_m}");
    }
    // The same off the centre of the lane.
    drive.state.pose.y_m += 0.4;
    let now_near = in_lane(&mut drive, front_s_m - 1.0, 1.3, 3.1);
    assert_eq!(
        count(&mut drive, &[now_near], BarrierKind::FrontCurrent, false),
        1
    );
    let now_far = in_lane(&mut drive, front_s_m - 1.0, -2.8, -1.0);
    assert_eq!(
        count(&mut drive, &[now_far], BarrierKind::FrontCurrent, false),
        0
    );
}

#[test]
fn in_the_lane_that_is_entered_everybody_ahead_is_a_leader_and_behind_a_follower() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    drive.others = vec![
        Other::new(1, 100.1, 3.5, 10.0),
        Other::new(2, 99.9, 3.5, 10.0),
    ];
    let neighbours = drive.with_situation(|_, situation| situation.neighbours.to_vec());
    assert_eq!(
        count(&mut drive, &neighbours, BarrierKind::FrontTarget, true),
        1
    );
    assert_eq!(
        count(&mut drive, &neighbours, BarrierKind::RearTarget, true),
        1
    );
    assert_eq!(
        count(&mut drive, &neighbours, BarrierKind::FrontCurrent, true),
        0
    );
    assert_eq!(
        count(&mut drive, &neighbours, BarrierKind::RearTarget, false),
        0
    );
    // One sight row for each lane.
    assert_eq!(count(&mut drive, &neighbours, BarrierKind::Sight, true), 2);
    assert_eq!(count(&mut drive, &neighbours, BarrierKind::Sight, false), 1);
    assert_eq!(
        count(&mut drive, &neighbours, BarrierKind::CurveSpeed, true),
        1
    );
}

/// h of the sight row of lane 1 with a leader 30 m ahead, of which the sight behind it is `clear`
/// and that up to it `open`.
fn sight(leader_h_m: f64, clear_m: f64, open_m: f64) -> Row {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    drive.others = vec![Other::new(1, 150.0, 0.0, 10.0)];
    drive.others[0].s_m -= drive.control().h_m - leader_h_m;
    let safety = drive.safety();
    drive.with_situation(|_, situation| {
        let sight = SightLine::new([clear_m; 3], 0.0).with_open([open_m; 3]);
        let seen = Situation {
            sight: &sight,
            ..*situation
        };
        let found = rows(&seen, &Course::keep(lane(1)), &safety);
        let is_sight = |row: &&Row| row.kind == BarrierKind::Sight;
        *found.hard.iter().find(is_sight).expect("a sight row")
    })
}

#[test]
fn behind_a_leader_whose_row_holds_the_sight_goes_on() {
    // Without a leader's row to trust, the own sight counts where it was enough so far.
    let (near, far) = (sight(1.0, 140.0, 140.0).h, sight(1.0, 300.0, 300.0).h);
    assert!(near > 0.0 && (far - near - 160.0).abs() < 1e-9);
    assert!((sight(1.0, 300.0, 140.0).h - far).abs() < 1e-9);
    assert!((sight(-1.0, 300.0, 140.0).h - near).abs() < 1e-9);
    // It was not enough: what is hidden behind the leader counts as before.
    assert!((sight(-1.0, 300.0, 110.0).h - far).abs() < 1e-9);
}

#[test]
fn what_is_missing_is_told_of_hard_rows_that_are_not_met() {
    let mut drive = Drive::new(straight(), 1, 100.0, 14.0);
    drive.others = vec![
        Other::new(1, 200.0, 0.0, 0.0),
        Other::new(2, 20.0, 3.5, 25.0),
    ];
    drive.others[0].s_m -= drive.control().h_m;
    let safety = drive.safety();
    let missing = |drive: &mut Drive, u: ControlInput, changes: bool| {
        let course = if changes {
            Course::change(lane(1), lane(0))
        } else {
            Course::keep(lane(1))
        };
        drive.with_situation(|_, situation| {
            shortfall(situation, &course, &Memory::default(), &safety, u)
        })
    };
    assert!(missing(&mut drive, input(0.0, -8.0), false) < 1e-9);
    // D rises by what 8 m/s^2 are in a step: (v Ts + ...) of the quadratic, 0.08 * 14 / 8 m.
    let by_no_braking = missing(&mut drive, input(0.0, 0.0), false);
    assert!((0.12..0.18).contains(&by_no_braking), "{by_no_braking}");
    // Nobody ahead: the follower's row is not hard, and a row that is met misses nothing.
    drive.others.remove(0);
    assert!(missing(&mut drive, input(0.0, -8.0), true) < 1e-9);
    assert!(missing(&mut drive, input(0.0, 0.0), true) < 1e-9);
    // Out of the lane.
    drive.state.pose.yaw_rad = 0.25;
    assert!(missing(&mut drive, input(0.05, 0.0), false) > 1e-4);
    drive.state.pose.yaw_rad = -0.25;
    assert!(missing(&mut drive, input(-0.05, 0.0), false) > 1e-4);
}

/// The upper limit of the sight row of lane 1 while it is left to the left, at a speed, with `h0_m`
/// of the collision level to where the sight ends.
fn sight_limit(speed_mps: f64, h0_m: f64) -> f64 {
    let mut drive = Drive::new(straight(), 1, 100.0, speed_mps);
    let safety = drive.safety();
    let ego = drive.ego();
    let closing_m = crate::Closing::new(&safety, 1.0, 1.0).distance_m(speed_mps, 0.0);
    let gap_m = h0_m + safety.collision_margin_m + closing_m;
    drive.clear_s_m = ego.frenet.s_m
        + ego.front_reach_m()
        + gap_m
        + safety.sight_error_m
        + safety.hidden_corner_m();
    let found = rows_of(&mut drive, &[], true);
    let is_sight = |row: &&Row| row.kind == BarrierKind::Sight;
    found.hard.iter().find(is_sight).expect("a sight row").upper
}

#[test]
fn who_leaves_the_lane_slowly_keeps_the_collision_level_to_the_end_of_sight() {
    // Up to 5 m/s: 0.1 m/s more, less the noise.
    assert!((sight_limit(4.9, 3.0) - 9.5).abs() < 1e-6);
    let at_the_edge = sight_limit(4.9, 0.0);
    assert!((-8.0 - 1e-6..-6.0).contains(&at_the_edge), "{at_the_edge}");
    // Faster than that it does not count as leaving: at most the gentle braking, but no gain.
    let faster = sight_limit(5.1, 3.0);
    assert!((-8.0 - 1e-6..=0.0).contains(&faster), "{faster}");
}

#[test]
fn the_row_towards_a_follower_names_it_and_its_levels() {
    let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
    let mut lower = |away_m: f64| {
        drive.others = vec![Other::new(2, 100.0 - away_m, 3.5, 10.0)];
        let neighbours = drive.with_situation(|_, situation| situation.neighbours.to_vec());
        let row = rows_of(&mut drive, &neighbours, true).rear[0];
        assert_eq!(row.neighbour, Some(2));
        // The collision level leaves the headway, but 2 m, out.
        assert!((row.h0_m - row.h - 11.9).abs() < 1e-9, "{row:?}");
        row.lower
    };
    // Inside the set it may come no nearer.
    assert!(lower(3.0) > -8.0);
    let near = lower(26.0);
    assert!(near > -8.0 && near < 1e4, "{near}");
    assert!(lower(80.0) < -1e300);
}
