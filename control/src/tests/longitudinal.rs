use covista_world::{BicycleState, ControlInput, FilterOutcome, STEP_S, Se2Pose};

use super::*;
use crate::barriers::Input;
use crate::barriers::front::{Ahead, Front};
use crate::manoeuvre::Course;
use crate::rows::ahead_in;

/// What one campaign found.
#[derive(Debug, Default)]
struct Found {
    steps: usize,
    infeasible: usize,
    lowest_h_m: f64,
    lowest_headway_m: f64,
}

/// Random leaders that brake as hard as b_l, and an ego vehicle that always wants to accelerate:
/// the rows alone hold it. Starts inside the set.
fn campaign(road: &Road, safety: SafetySettings, noisy: bool, seed: u64) -> Found {
    let mut dice = Dice(seed);
    let mut found = Found {
        lowest_h_m: f64::INFINITY,
        lowest_headway_m: f64::INFINITY,
        ..Found::default()
    };
    let settings = ControlSettings {
        safety,
        ..ControlSettings::default()
    };
    for _ in 0..30 {
        let speed = dice.uniform(0.0, 14.0);
        let mut drive = Drive::with(settings, road.clone(), 1, 30.0, speed);
        let leader_speed = dice.uniform(0.0, 14.0);
        drive.others = vec![Other::new(1, 200.0, 0.0, leader_speed)];
        let h = drive.control().h_m;
        // Close up to the edge of the set.
        drive.others[0].s_m -= h - dice.uniform(0.05, 2.0);
        let mut leader_accel = 0.0;
        for step in 0..1500 {
            if step % 40 == 0 {
                leader_accel = if dice.uniform(0.0, 1.0) < 0.4 {
                    -safety.leader_brake_mps2
                } else {
                    dice.uniform(-safety.leader_brake_mps2, 3.0)
                };
            }
            if drive.others[0].speed_mps > 14.0 {
                leader_accel = leader_accel.min(0.0);
            }
            let output = drive.with_situation(|controller, situation| {
                let rows = rows(situation, &Course::keep(lane(1)), &safety);
                let (lower, upper) = rows.interval(Input::Accel);
                let output = controller.control(situation);
                // Harder than the reference: as much acceleration as the rows leave.
                let u = ControlInput {
                    accel_mps2: upper.max(lower),
                    ..output.u
                };
                (output.h_m, lower <= upper, u)
            });
            let (h_m, feasible, u) = output;
            found.steps += 1;
            found.infeasible += usize::from(!feasible);
            found.lowest_h_m = found.lowest_h_m.min(h_m);
            let gap = drive.others[0].s_m
                - drive
                    .road
                    .to_frenet(SEDAN.center_pose(drive.state.pose).position())
                    .s_m;
            found.lowest_headway_m = found.lowest_headway_m.min(gap);
            drive.apply(u);
            if noisy {
                disturb(&mut drive.state, &mut dice, &safety);
            }
            drive.others[0].step(leader_accel);
        }
    }
    found
}

fn disturb(state: &mut BicycleState, dice: &mut Dice, safety: &SafetySettings) {
    if state.speed_mps <= 0.0 {
        return;
    }
    let along = dice.uniform(-1.0, 1.0) * safety.noise_position_m;
    state.pose = state.pose.compose(Se2Pose::new(along, 0.0, 0.0));
    let faster = dice.uniform(-1.0, 1.0) * safety.noise_speed_mps;
    state.speed_mps = (state.speed_mps + faster).max(0.0);
}

fn noiseless() -> SafetySettings {
    SafetySettings {
        noise_position_m: 0.0,
        noise_speed_mps: 0.0,
        ..SafetySettings::default()
    }
}

#[test]
fn the_set_is_invariant_without_noise() {
    for (i, (brake, leader_brake)) in [(8.0, 8.0), (8.0, 5.0), (6.0, 8.0)].into_iter().enumerate() {
        let safety = SafetySettings {
            brake_mps2: brake,
            leader_brake_mps2: leader_brake,
            ..noiseless()
        };
        let found = campaign(&straight(), safety, false, 11 + i as u64);
        assert_eq!(found.infeasible, 0, "{found:?}");
        assert!(found.lowest_h_m > -1e-6, "{found:?}");
        assert!(found.lowest_headway_m > 18.5 - 1e-6, "{found:?}");
    }
}

#[test]
fn the_set_is_invariant_with_noise_inside_its_bounds() {
    let found = campaign(&straight(), SafetySettings::default(), true, 5);
    assert_eq!(found.infeasible, 0, "{found:?}");
    assert!(found.lowest_h_m > -1e-6, "{found:?}");
    assert!(found.lowest_headway_m > 18.5 - 1e-6, "{found:?}");
}

#[test]
fn the_set_is_invariant_round_the_corner() {
    let found = campaign(&corner(), SafetySettings::default(), true, 6);
    assert_eq!(found.infeasible, 0, "{found:?}");
    assert!(found.lowest_h_m > -1e-6, "{found:?}");
}

#[test]
fn noise_that_breaks_its_bound_breaks_the_set() {
    // Broken on purpose: the leader brakes harder than assumed.
    let honest = noiseless();
    let mut drive = Drive::with(
        ControlSettings {
            safety: honest,
            ..ControlSettings::default()
        },
        straight(),
        1,
        30.0,
        14.0,
    );
    drive.others = vec![Other::new(1, 200.0, 0.0, 14.0)];
    let h = drive.control().h_m;
    drive.others[0].s_m -= h - 0.01;
    let mut lowest = f64::INFINITY;
    for _ in 0..300 {
        let output = drive.control();
        lowest = lowest.min(output.h_m);
        drive.apply(output.u);
        drive.others[0].step(-12.0);
    }
    assert!(lowest < -1.0, "{lowest}");
}

#[test]
fn a_cut_in_is_excused_and_recovered_gently() {
    let mut drive = Drive::new(straight(), 1, 30.0, 14.0);
    for _ in 0..10 {
        let output = drive.control();
        drive.apply(output.u);
    }
    drive.others = vec![Other::new(3, 48.0, 3.5, 14.0)];
    drive.control();
    drive.others[0].d_m = 0.8;
    let output = drive.control();
    assert!(output.h_m < 0.0 && output.h0_m > 0.0, "{output:?}");
    assert_eq!(drive.controller.excused()[0].excuse, crate::Excuse::CutIn);
    let mut hardest = 0.0_f64;
    for _ in 0..2500 {
        let output = drive.control();
        hardest = hardest.min(output.u.accel_mps2);
        drive.apply(output.u);
        drive.others[0].step(0.0);
    }
    assert!(hardest >= -4.0, "{hardest}");
    let output = drive.control();
    assert!(
        output.h_m > 0.0 && drive.controller.excused().is_empty(),
        "{output:?}"
    );
}

#[test]
fn speed_follows_sight() {
    let mut drive = Drive::new(straight(), 1, 30.0, 14.0);
    drive.clear_s_m = 110.0;
    let mut lowest = f64::INFINITY;
    for _ in 0..2500 {
        let output = drive.control();
        lowest = lowest.min(output.h_m);
        drive.apply(output.u);
    }
    assert!(lowest > -1e-6, "{lowest}");
    assert!(drive.state.speed_mps < 0.5, "{}", drive.state.speed_mps);
}

#[test]
fn towards_the_end_of_sight_it_brakes_hard_as_long_as_the_set_may_hold() {
    let safety = SafetySettings::default();
    let (short_m, wide_m) = (safety.shortest_vehicle_m, safety.widest_vehicle_m);
    let corner_m = 0.5 * (short_m.hypot(wide_m) - short_m);
    let longer_m = 0.5 * (safety.longest_vehicle_m - short_m);
    let depth_m = safety.sight_error_m + corner_m + longer_m;
    let output = |clear_s_m| {
        let mut drive = Drive::new(straight(), 1, 30.0, 14.0);
        drive.clear_s_m = clear_s_m;
        drive.control()
    };
    let from_m = 75.0;
    let h_m = output(from_m).h_m;
    let at = |wanted_m: f64| {
        let output = output(from_m + wanted_m - h_m);
        assert!(
            (output.h_m - wanted_m).abs() < 1e-6,
            "{} {wanted_m}",
            output.h_m
        );
        output.u.accel_mps2
    };
    let (hard, gentle) = (at(0.01 - depth_m), at(-0.01 - depth_m));
    assert!(hard < -7.0, "{hard}");
    assert!((-7.0..0.0).contains(&gentle), "{gentle}");
}

#[test]
fn the_filter_seldom_acts_in_ordinary_following() {
    let mut drive = Drive::new(straight(), 1, 30.0, 14.0);
    drive.others = vec![Other::new(1, 75.0, 0.0, 12.0)];
    let mut acted = 0;
    for step in 0..3000 {
        let output = drive.control();
        acted += usize::from(output.outcome != FilterOutcome::Nominal);
        drive.apply(output.u);
        drive.others[0].step(if (1000..1300).contains(&step) {
            -2.5
        } else {
            0.3
        });
        drive.others[0].speed_mps = drive.others[0].speed_mps.min(12.0);
    }
    assert!(acted < 30, "{acted}");
    assert!(drive.state.speed_mps > 5.0);
}

#[test]
fn a_number_that_is_none_leads_to_backup() {
    let mut drive = Drive::new(straight(), 1, 30.0, 14.0);
    drive.desired_mps = f64::NAN;
    let output = drive.control();
    assert_eq!(output.outcome, FilterOutcome::Backup);
    assert!((output.u.accel_mps2 + 8.0).abs() < 1e-12);
    drive.desired_mps = 14.0;
    drive.state.speed_mps = f64::NAN;
    let output = drive.control();
    assert_eq!(output.outcome, FilterOutcome::Backup);
    assert!(output.u.accel_mps2 <= -8.0 + 1e-12 && output.u.tan_delta.is_finite());
}

#[test]
fn emergency_stop_brakes_as_hard_as_it_can() {
    let mut drive = Drive::new(corner(), 1, 200.0, 14.0);
    drive.controller.set_action(Action::EmergencyStop, 0.0);
    let mut steps = 0;
    while drive.state.speed_mps > 0.0 && steps < 1000 {
        let output = drive.control();
        drive.apply(output.u);
        steps += 1;
    }
    assert!((steps as f64 * STEP_S - 14.0 / 8.0).abs() < 0.03, "{steps}");
    assert!(drive.ego().frenet.d_m.abs() < 0.3);
}

#[test]
fn older_estimates_are_taken_for_worse() {
    let (road, safety) = (straight(), SafetySettings::default());
    let track = Other::new(1, 100.0, 0.0, 12.0).track(&road, 5.0);
    let at = |now_s: f64| Neighbour::from_track(&track, &road, now_s, &safety).expect("finite");
    let (fresh, old) = (at(5.0), at(5.5));
    assert!((old.worst_slow_mps - 8.0).abs() < 1e-9);
    // Whatever the heading, the body reaches half its diagonal; 12 t - 8 t^2 / 2.
    let diagonal_m = 0.5 * SEDAN.length_m.hypot(SEDAN.width_m);
    assert!((fresh.worst_s_rear_m - (100.0 - diagonal_m)).abs() < 1e-9);
    assert!((old.worst_s_rear_m - (100.0 + 5.0 - diagonal_m)).abs() < 1e-9);
    assert!((old.s_rear_m - fresh.s_rear_m - 6.0).abs() < 1e-9);
    assert!((old.worst_fast_mps - 12.5).abs() < 1e-9);
}

#[test]
fn the_closest_of_all_vehicles_ahead_counts() {
    let mut drive = Drive::new(straight(), 1, 30.0, 14.0);
    drive.others = vec![
        Other::new(1, 80.0, 0.0, 14.0),
        Other::new(2, 86.0, 0.0, 0.0),
    ];
    let safety = drive.safety();
    let both = drive.control().h_m;
    let standing = drive.with_situation(|_, situation| {
        let ahead: Vec<Ahead<'_>> = ahead_in(situation, &Course::keep(lane(1))).collect();
        let closing = ahead[0].closing(&safety);
        crate::barriers::Barrier::h(&Front::new(
            &ahead[0],
            closing,
            &situation.neighbours[1],
            &safety,
        ))
    });
    assert!((both - standing).abs() < 1e-12);
}
