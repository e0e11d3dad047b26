//! The front and rear distances against ad-rss: tests/oracles/rss.py says how and how near.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use covista_world::BarrierKind;

use super::*;
use crate::Closing;
use crate::barriers::Barrier;
use crate::barriers::rear::Rear;
use crate::rows::ahead_in;

/// What the script answers with where the module is not installed.
const SKIPPED: i32 = 77;

fn front(csv: &mut String, settings: &SafetySettings, v: f64, v_k: f64) {
    let (brake, leader_brake) = (settings.brake_mps2, settings.leader_brake_mps2);
    let distance_m = Closing::new(settings, 1.0, 1.0).distance_m(v, v_k);
    let line = format!("front,{v},{v_k},0,{STEP_S},{brake},{leader_brake},{distance_m}");
    writeln!(csv, "{line}").expect("a string grows");
}

/// What h_bt lacks of the bumper gap and the headway.
fn rear(csv: &mut String, settings: &ControlSettings, v: f64, v_b: f64, is_cav: bool) {
    let mut drive = Drive::with(*settings, straight(), 1, 800.0, v);
    let follower = Other::new(1, 300.0, 3.5, v_b);
    drive.others = vec![if is_cav {
        follower.cav(1, Action::KeepLane, 0.0)
    } else {
        follower
    }];
    let safety = &settings.safety;
    let distance_m = drive.with_situation(|_, situation| {
        let target = ahead_in(situation, &Course::change(lane(1), lane(0)))
            .find(|ahead| ahead.kind == BarrierKind::FrontTarget)
            .expect("a target lane");
        let behind = &situation.neighbours[0];
        let ego = &situation.ego;
        let gap_m = ego.frenet.s_m - ego.rear_reach_m() - behind.s_front_m;
        let keep_m = safety.headway_safe_m - SEDAN.length_m;
        gap_m - keep_m - Rear::new(&target, behind, safety).h()
    });
    let (accel, brake_b, brake) = (
        safety.follower_accel_mps2,
        safety.follower_brake_mps2,
        safety.brake_mps2,
    );
    let reaction_s = if is_cav {
        safety.reaction_cav_s
    } else {
        safety.reaction_human_s
    };
    writeln!(
        csv,
        "rear,{v_b},{v},{accel},{reaction_s},{brake_b},{brake},{distance_m}"
    )
    .expect("a string grows");
}

fn distances() -> String {
    let mut csv = "kind,v_rear,v_front,accel,response,brake_rear,brake_front,distance\n".to_owned();
    let quiet = formulated(Formulation::Relaxed).effective();
    let speeds = || (0..=10).map(|i| 3.7 * f64::from(i));
    for (brake, leader_brake) in [(8.0, 8.0), (6.0, 8.0), (5.0, 9.0)] {
        let settings = SafetySettings {
            brake_mps2: brake,
            leader_brake_mps2: leader_brake,
            ..quiet.safety
        };
        for v in speeds() {
            for v_k in speeds() {
                front(&mut csv, &settings, v, v_k);
            }
        }
    }
    for v in speeds() {
        for v_b in speeds() {
            for is_cav in [false, true] {
                rear(&mut csv, &quiet, v, v_b, is_cav);
            }
        }
    }
    csv
}

#[test]
fn the_distances_are_those_of_rss_oracle() {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/oracles/rss.py");
    let python = Command::new("python3")
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn();
    let Ok(mut python) = python else {
        eprintln!("skipped: no python3");
        return;
    };
    // Where the module is missing the script does not read.
    let mut stdin = python.stdin.take().expect("piped");
    let written = stdin.write_all(distances().as_bytes());
    drop(stdin);
    let output = python.wait_with_output().expect("the script ends");
    eprintln!("{}", String::from_utf8_lossy(&output.stdout).trim_end());
    if output.status.code() != Some(SKIPPED) {
        written.expect("the script reads");
        assert!(output.status.success());
    }
}
