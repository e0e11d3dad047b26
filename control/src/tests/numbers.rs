//! Numbers that are none: every field of what the controller is given, one after the other.

use covista_world::{BarrierKind, FilterOutcome};

use super::*;
use crate::validator::is_valid;

const BAD: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

type Field<T> = (&'static str, fn(&mut T) -> &mut f64);

const EGO: [Field<EgoState>; 12] = [
    ("x", |ego| &mut ego.state.pose.x_m),
    ("y", |ego| &mut ego.state.pose.y_m),
    ("yaw", |ego| &mut ego.state.pose.yaw_rad),
    ("speed", |ego| &mut ego.state.speed_mps),
    ("s", |ego| &mut ego.frenet.s_m),
    ("d", |ego| &mut ego.frenet.d_m),
    ("psi", |ego| &mut ego.frenet.psi_rad),
    ("curvature", |ego| &mut ego.frenet.curvature_per_m),
    ("length", |ego| &mut ego.dimensions.length_m),
    ("width", |ego| &mut ego.dimensions.width_m),
    ("wheelbase", |ego| &mut ego.dimensions.wheelbase_m),
    ("overhang", |ego| &mut ego.dimensions.rear_overhang_m),
];

const NEIGHBOUR: [Field<Neighbour>; 12] = [
    ("rear", |other| &mut other.s_rear_m),
    ("front", |other| &mut other.s_front_m),
    ("right", |other| &mut other.d_right_m),
    ("left", |other| &mut other.d_left_m),
    ("speed", |other| &mut other.speed_mps),
    ("length", |other| &mut other.length_m),
    ("reach", |other| &mut other.reach_m),
    ("worst rear", |other| &mut other.worst_s_rear_m),
    ("slow", |other| &mut other.worst_slow_mps),
    ("worst front", |other| &mut other.worst_s_front_m),
    ("fast", |other| &mut other.worst_fast_mps),
    ("announced", |other| other.announced_s.get_or_insert(0.0)),
];

const TRACK: [Field<Track>; 9] = [
    ("x", |track| &mut track.state.center.x_m),
    ("y", |track| &mut track.state.center.y_m),
    ("yaw", |track| &mut track.state.center.yaw_rad),
    ("velocity", |track| &mut track.state.velocity_mps.x),
    ("length", |track| &mut track.state.length_m),
    ("width", |track| &mut track.state.width_m),
    ("time", |track| &mut track.time_s),
    ("position error", |track| &mut track.position_std_m),
    ("speed error", |track| &mut track.velocity_std_mps),
];

/// In the corner behind a leader, with a follower in the lane beside that is wanted.
fn busy(mode: Mode, action: Action) -> Drive {
    let mut drive = Drive::with(in_mode(mode), corner(), 1, 200.0, 13.0);
    drive.others = vec![
        Other::new(1, 245.0, 0.0, 12.0),
        Other::new(2, 150.0, 3.5, 12.0),
    ];
    drive.controller.set_action(action, 0.0);
    drive.run(0.05);
    drive
}

/// Whatever is given, what comes back is braking as hard as possible or an input of U.
fn answer(
    drive: &mut Drive,
    name: &str,
    act: impl Fn(&mut Controller, &Situation<'_>) -> ControlOutput,
    change: impl Fn(&mut Situation<'_>, &mut Vec<Neighbour>),
) -> ControlOutput {
    let safety = drive.safety();
    let output = drive.with_situation(|controller, situation| {
        let mut neighbours = situation.neighbours.to_vec();
        let mut changed = *situation;
        change(&mut changed, &mut neighbours);
        let changed = Situation {
            neighbours: &neighbours,
            ..changed
        };
        for action in Action::ALL {
            controller.verdict(&changed, action);
        }
        act(controller, &changed)
    });
    let u = output.u;
    assert!(
        u.tan_delta.is_finite() && u.accel_mps2.is_finite(),
        "{name}: {output:?}"
    );
    let v = drive.state.speed_mps;
    assert!(
        output.outcome == FilterOutcome::Backup || is_valid(u, v, SEDAN.wheelbase_m, &safety),
        "{name}: {output:?}"
    );
    assert!(
        u.tan_delta.abs() <= safety.tan_delta_max,
        "{name}: {output:?}"
    );
    output
}

fn backup(output: ControlOutput, name: &str) {
    assert_eq!(output.outcome, FilterOutcome::Backup, "{name}: {output:?}");
    assert!(
        (output.u.accel_mps2 + 8.0).abs() < 1e-9,
        "{name}: {output:?}"
    );
}

/// In every mode, whether a lane change is announced or not, and the step after is as any other.
fn each(name: &str, change: impl Fn(&mut Situation<'_>, &mut Vec<Neighbour>)) {
    for mode in [Mode::Safe, Mode::Paper, Mode::Off] {
        for action in [Action::KeepLane, Action::ChangeLeft] {
            let mut drive = busy(mode, action);
            let control = |controller: &mut Controller, situation: &Situation<'_>| {
                controller.control(situation)
            };
            backup(answer(&mut drive, name, control, &change), name);
            let filter = |controller: &mut Controller, situation: &Situation<'_>| {
                controller.filter(situation, ControlInput::default())
            };
            backup(answer(&mut drive, name, filter, &change), name);
            let after = drive.control();
            assert_ne!(after.outcome, FilterOutcome::Backup, "{name}: {after:?}");
        }
    }
}

#[test]
fn an_ego_state_that_is_no_number_leads_to_backup() {
    for (name, field) in EGO {
        for bad in BAD {
            each(name, |situation, _| *field(&mut situation.ego) = bad);
        }
    }
}

#[test]
fn a_neighbour_that_is_no_number_leads_to_backup() {
    for (name, field) in NEIGHBOUR {
        for bad in BAD {
            each(name, |_, neighbours| *field(&mut neighbours[0]) = bad);
            each(name, |_, neighbours| *field(&mut neighbours[1]) = bad);
        }
    }
}

#[test]
fn a_time_or_speed_that_is_no_number_leads_to_backup() {
    for bad in BAD {
        each("time", |situation, _| situation.time_s = bad);
        each("desired speed", |situation, _| {
            situation.desired_speed_mps = bad;
        });
    }
    each("reversing", |situation, _| {
        situation.ego.state.speed_mps = -0.1;
    });
}

/// For as long as any situation lasts.
fn kept(sight: SightLine) -> &'static SightLine {
    Box::leak(Box::new(sight))
}

#[test]
fn a_sight_that_is_no_number_leads_to_backup() {
    let nan = kept(SightLine::new([1e4, f64::NAN, 1e4], 0.0));
    each("sight", |situation, _| situation.sight = nan);
    let nan = kept(SightLine::new([1e4; 3], 0.0).with_open([f64::NAN, 1e4, 1e4]));
    each("open sight", |situation, _| situation.sight = nan);
}

#[test]
fn sight_without_end_is_no_limit_and_none_at_all_stops() {
    let control =
        |controller: &mut Controller, situation: &Situation<'_>| controller.control(situation);
    let endless = kept(SightLine::new([f64::INFINITY; 3], 0.0));
    let mut drive = busy(Mode::Safe, Action::KeepLane);
    let output = answer(&mut drive, "endless", control, |situation, _| {
        situation.sight = endless;
    });
    assert!(output.u.accel_mps2 > -1.0, "{output:?}");
    let none = kept(SightLine::new([f64::NEG_INFINITY; 3], 0.0));
    let output = answer(&mut drive, "none", control, |situation, _| {
        situation.sight = none;
    });
    assert_eq!(output.binding, Some(BarrierKind::Sight));
    assert!(output.u.accel_mps2 < -2.9, "{output:?}");
}

#[test]
fn a_nominal_input_that_is_no_number_leads_to_backup() {
    for mode in [Mode::Safe, Mode::Paper, Mode::Off] {
        for bad in BAD {
            for u in [input(bad, 0.0), input(0.0, bad), input(bad, bad)] {
                let mut drive = busy(mode, Action::KeepLane);
                let before = drive.control().u;
                let output = drive.filter(u);
                backup(output, "nominal");
                // The steering is held as it was.
                assert!((output.u.tan_delta - before.tan_delta).abs() < 1e-12);
            }
        }
    }
}

#[test]
fn a_track_that_is_no_number_is_no_neighbour() {
    let (road, safety) = (corner(), SafetySettings::default());
    let good = Other::new(1, 220.0, 0.0, 12.0).track(&road, 1.0);
    assert!(Neighbour::from_track(&good, &road, 1.0, &safety).is_some());
    for (name, field) in TRACK {
        let mut track = good.clone();
        *field(&mut track) = f64::NAN;
        let neighbour = Neighbour::from_track(&track, &road, 1.0, &safety);
        assert!(
            neighbour.is_none_or(|neighbour| neighbour.is_finite()),
            "{name}: {neighbour:?}"
        );
    }
    assert_eq!(Neighbour::from_track(&good, &road, f64::NAN, &safety), None);
}

/// Numbers of any size, drawn by their bits.
#[test]
fn no_number_makes_it_panic_or_answer_with_none() {
    let mut dice = Dice(77);
    let any = |dice: &mut Dice| match dice.uniform(0.0, 8.0) as usize {
        0 => 1e300,
        1 => -1e300,
        2 => 1e9,
        3 => -1e9,
        4 => 1e-300,
        5 => 0.0,
        6 => dice.uniform(-1e3, 1e3),
        _ => dice.uniform(-4.0, 4.0),
    };
    for round in 0..600 {
        let mode = [Mode::Safe, Mode::Safe, Mode::Paper, Mode::Off][round % 4];
        let mut drive = busy(mode, Action::ALL[round % Action::ALL.len()]);
        let safety = drive.safety();
        let (ego, other) = (EGO[dice.uniform(0.0, 12.0) as usize], NEIGHBOUR[round % 11]);
        let (a, b) = (any(&mut dice), any(&mut dice));
        let u_nominal = input(any(&mut dice), any(&mut dice));
        let output = drive.with_situation(|controller, situation| {
            let mut neighbours = situation.neighbours.to_vec();
            let mut changed = *situation;
            *ego.1(&mut changed.ego) = a;
            *other.1(&mut neighbours[round % 2]) = b;
            controller.filter(
                &Situation {
                    neighbours: &neighbours,
                    ..changed
                },
                u_nominal,
            )
        });
        let u = output.u;
        assert!(
            u.tan_delta.abs() <= safety.tan_delta_max
                && (-safety.brake_mps2..=safety.accel_max_mps2).contains(&u.accel_mps2),
            "{} {a}, {} {b}, {u_nominal:?}: {output:?}",
            ego.0,
            other.0
        );
    }
}
