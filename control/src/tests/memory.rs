//! Why a barrier may be broken: what each excuse asks for, and what is none.

use super::*;
use crate::Excuse;
use crate::barriers::Barrier;
use crate::barriers::front::Front;
use crate::rows::ahead_in;

/// A leader whose h is `h_m` by its worst, its measured and its best rear bumper.
fn leader(drive: &mut Drive, h_m: [f64; 3]) -> Neighbour {
    drive.others = vec![Other::new(1, 200.0, 0.0, 10.0)];
    let off_m = drive.control().h_m;
    drive.with_situation(|_, situation| {
        let mut leader = situation.neighbours[0];
        leader.s_rear_m += h_m[1] - off_m;
        leader.s_front_m += h_m[1] - off_m;
        leader.best_s_rear_m += h_m[2] - off_m;
        leader.worst_s_rear_m += h_m[0] - off_m;
        leader
    })
}

fn driving() -> Drive {
    Drive::new(straight(), 1, 100.0, 14.0)
}

/// What a memory of `before` says of `now` in lane 1.
fn judged(drive: &mut Drive, before: &Memory, now: &Neighbour, changes: bool) -> Option<Excuse> {
    let safety = drive.safety();
    let course = if changes {
        Course::change(lane(1), lane(0))
    } else {
        Course::keep(lane(1))
    };
    drive.with_situation(|_, situation| {
        let ahead = ahead_in(situation, &course).next().expect("a lane");
        before.judge(
            &Front::new(&ahead, ahead.closing(&safety), now, &safety),
            now,
        )
    })
}

/// A memory of one step in which `seen` was known, with the excuse that it had.
fn memory(drive: &mut Drive, seen: &Neighbour, excuse: Option<Excuse>) -> Memory {
    let safety = drive.safety();
    drive.with_situation(|_, situation| {
        let ahead = ahead_in(situation, &Course::keep(lane(1)))
            .next()
            .expect("a lane");
        let front = Front::new(&ahead, ahead.closing(&safety), seen, &safety);
        let mut memory = Memory::default();
        memory.update(&[*seen], &[front.excused(excuse).row()]);
        memory
    })
}

fn elsewhere(known: Neighbour) -> Neighbour {
    Neighbour {
        lanes: crate::LaneSet::default(),
        ..known
    }
}

#[test]
fn what_is_not_broken_but_for_rounding_needs_no_excuse() {
    let mut drive = driving();
    for h in [1.0, 5e-7, 0.0, -5e-7] {
        let now = leader(&mut drive, [h; 3]);
        assert_eq!(
            judged(&mut drive, &Memory::default(), &now, false),
            None,
            "{h}"
        );
    }
    let now = leader(&mut drive, [-2e-6; 3]);
    assert!(judged(&mut drive, &Memory::default(), &now, false).is_some());
}

#[test]
fn one_that_was_not_known_is_revealed_where_all_of_its_estimate_is_inside() {
    let mut drive = driving();
    let sure = leader(&mut drive, [-2.0, -1.0, -0.51]);
    let none = Memory::default();
    assert_eq!(
        judged(&mut drive, &none, &sure, false),
        Some(Excuse::Revealed)
    );
    let unsure = leader(&mut drive, [-2.0, -1.0, -0.49]);
    assert_eq!(
        judged(&mut drive, &none, &unsure, false),
        Some(Excuse::Revised)
    );
}

#[test]
fn one_that_came_from_beside_cut_in_where_it_is_measured_inside() {
    let mut drive = driving();
    let inside = leader(&mut drive, [-1.0, -0.1, 0.5]);
    let before = memory(&mut drive, &elsewhere(inside), None);
    assert_eq!(
        judged(&mut drive, &before, &inside, false),
        Some(Excuse::CutIn)
    );
    let outside = leader(&mut drive, [-1.0, 0.1, 0.5]);
    assert_eq!(
        judged(&mut drive, &before, &outside, false),
        Some(Excuse::Revised)
    );
}

#[test]
fn one_that_was_in_the_lane_is_only_revised() {
    let mut drive = driving();
    let inside = leader(&mut drive, [-1.0; 3]);
    for excuse in [None, Some(Excuse::Revised)] {
        let before = memory(&mut drive, &inside, excuse);
        assert_eq!(
            judged(&mut drive, &before, &inside, false),
            Some(Excuse::Revised)
        );
    }
    // Another one was known, not this one.
    let other = Neighbour { id: 9, ..inside };
    let before = memory(&mut drive, &other, None);
    assert_eq!(
        judged(&mut drive, &before, &inside, false),
        Some(Excuse::Revealed)
    );
}

#[test]
fn an_excuse_lasts_until_h_is_won_back() {
    let mut drive = driving();
    let inside = leader(&mut drive, [-1.0; 3]);
    for excuse in [Excuse::CutIn, Excuse::Revealed] {
        let before = memory(&mut drive, &inside, Some(excuse));
        assert_eq!(before.excused()[0].excuse, excuse);
        assert_eq!(before.excused()[0].neighbour, 1);
        assert_eq!(judged(&mut drive, &before, &inside, false), Some(excuse));
        let outside = leader(&mut drive, [0.1; 3]);
        assert_eq!(judged(&mut drive, &before, &outside, false), None);
    }
}

#[test]
fn round_one_that_stands_the_distance_is_given_up_while_leaving() {
    let mut drive = Drive::new(straight(), 1, 100.0, 4.0);
    let mut standing = leader(&mut drive, [-1.0; 3]);
    // Nearer by what its speed of 10 m/s was worth.
    standing.speed_mps = 0.4;
    let none = Memory::default();
    assert_eq!(
        judged(&mut drive, &none, &standing, true),
        Some(Excuse::Leaving)
    );
    let before = memory(&mut drive, &standing, Some(Excuse::Leaving));
    assert_eq!(
        judged(&mut drive, &before, &standing, false),
        Some(Excuse::Revealed)
    );
    for speed_mps in [0.5, 3.0] {
        let moving = Neighbour {
            speed_mps,
            ..standing
        };
        assert_eq!(
            judged(&mut drive, &none, &moving, true),
            Some(Excuse::Revealed)
        );
    }
    let mut fast = Drive::new(straight(), 1, 100.0, 5.1);
    let standing = leader(&mut fast, [-1.0; 3]);
    let standing = Neighbour {
        speed_mps: 0.0,
        ..standing
    };
    assert_eq!(
        judged(&mut fast, &none, &standing, true),
        Some(Excuse::Revealed)
    );
}

/// The largest acceleration that the front row leaves.
fn upper(drive: &mut Drive, now: &Neighbour, excuse: Option<Excuse>, changes: bool) -> f64 {
    let safety = drive.safety();
    let course = if changes {
        Course::change(lane(1), lane(0))
    } else {
        Course::keep(lane(1))
    };
    drive.with_situation(|_, situation| {
        let ahead = ahead_in(situation, &course).next().expect("a lane");
        let front = Front::new(&ahead, ahead.closing(&safety), now, &safety);
        front.excused(excuse).row().upper
    })
}

#[test]
fn an_excuse_asks_for_the_gentle_braking_at_most() {
    let mut drive = driving();
    // Inside by 5 m, which the collision level allows.
    let inside = leader(&mut drive, [-5.0; 3]);
    for excuse in [Excuse::CutIn, Excuse::Revealed] {
        let found = upper(&mut drive, &inside, Some(excuse), false);
        assert!((-3.0 - 1e-9..-2.9).contains(&found), "{found}");
    }
    for excuse in [None, Some(Excuse::Revised)] {
        let found = upper(&mut drive, &inside, excuse, false);
        assert!(found < -7.0, "{found}");
    }
    // With the collision level broken there is nothing gentle.
    let too_near = leader(&mut drive, [-14.0; 3]);
    let found = upper(&mut drive, &too_near, Some(Excuse::CutIn), false);
    assert!(found < -7.0, "{found}");
}

#[test]
fn a_distance_that_is_missing_is_won_back_against_the_measured_motion() {
    // 0.5 of it a second, of at most a metre; the worst member is that much inside.
    for (missing_m, counted_m) in [(0.4, 0.4), (0.9, 0.9), (3.0, 1.0)] {
        for measured_h_m in [-missing_m, 5.0] {
            let mut drive = Drive::new(straight(), 1, 100.0, 10.0);
            let now = leader(&mut drive, [-missing_m, measured_h_m, 9.0]);
            let found = upper(&mut drive, &now, Some(Excuse::CutIn), false);
            // At v+ = 10 + a Ts + W_v, against a leader that keeps its 10 m/s.
            let closing = crate::Closing::new(&drive.safety(), 1.0, 1.0);
            let wanted_m = closing.distance_m(10.0, 10.0) - 1e-3 - 0.5 * counted_m * STEP_S;
            let next_mps = closing
                .max_speed_mps(wanted_m, 10.0, 20.0)
                .expect("a speed");
            let expected = ((next_mps - 5e-3 - 10.0) / STEP_S).max(-3.0);
            assert!(
                (found - expected).abs() < 1e-6,
                "{missing_m}: {found} {expected}"
            );
        }
    }
}

#[test]
fn leaving_keeps_the_collision_level_and_the_low_speed() {
    let mut drive = Drive::new(straight(), 1, 100.0, 4.9);
    let standing = leader(&mut drive, [-5.0; 3]);
    let standing = Neighbour {
        speed_mps: 0.0,
        ..standing
    };
    let found = upper(&mut drive, &standing, Some(Excuse::Leaving), true);
    // Up to 5 m/s: 0.1 m/s more, less the noise.
    assert!((found - 9.5).abs() < 1e-6, "{found}");
    // The collision level is inside by what a leader that stands makes of it.
    let near = leader(&mut drive, [-11.0; 3]);
    let near = Neighbour {
        worst_slow_mps: 0.0,
        speed_mps: 0.0,
        ..near
    };
    let found = upper(&mut drive, &near, Some(Excuse::Leaving), true);
    assert!(found < -7.0, "{found}");
}
