use std::path::Path;

use serde_json::Value;

use crate::binary::covista;

/// Ten seeds that the networks have not been trained or chosen on.
const SEEDS: std::ops::Range<u64> = 1000..1010;

/// Runs a demo and reads its summary.
fn demo(out: &Path, arguments: &[&str]) -> Value {
    demo_on("2", out, arguments)
}

/// The same, rendering and perceiving on as many threads as said.
fn demo_on(threads: &str, out: &Path, arguments: &[&str]) -> Value {
    let output = covista()
        .env("RAYON_NUM_THREADS", threads)
        .arg("demo")
        .args(arguments)
        .arg("--out")
        .arg(out)
        .output()
        .expect("covista starts");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = std::fs::read_to_string(out.join("summary.json")).expect("a summary");
    serde_json::from_str(&text).expect("JSON")
}

/// The demo on exact percepts of what is in line of sight, which takes seconds.
fn exact_demo(scenario: &str, seed: u64) -> Value {
    let out = tempfile::tempdir().expect("a folder");
    demo(
        out.path(),
        &[
            scenario,
            "--perception",
            "truth",
            "--seed",
            &seed.to_string(),
        ],
    )
}

fn run(summary: &Value, sharing: bool) -> &Value {
    summary["runs"]
        .as_array()
        .expect("runs")
        .iter()
        .find(|run| run["sharing"] == sharing)
        .expect("a run")
}

fn is_safe(run: &Value) -> bool {
    run["collisions"] == 0 && run["violations_unattributed"] == 0 && run["unsafe_actions"] == 0
}

/// (sight, lane change) of each CAV that began in `lane`.
fn of_lane(run: &Value, lane: u64) -> Vec<(Option<f64>, Option<f64>)> {
    run["vehicles"]
        .as_array()
        .expect("vehicles")
        .iter()
        .filter(|cav| cav["initial_lane"] == lane)
        .map(|cav| {
            (
                cav["first_line_of_sight_s"].as_f64(),
                cav["lane_change_start_s"].as_f64(),
            )
        })
        .collect()
}

fn changes_before_sight(&(sight, change): &(Option<f64>, Option<f64>)) -> bool {
    change.is_some_and(|change| sight.is_none_or(|sight| change < sight))
}

/// What the scenario is for, in the lane of the obstacles.
fn sharing_helps(scenario: &str, lane: u64, seeds: impl Iterator<Item = u64>) {
    let mut held_up = 0;
    let mut count = 0;
    for seed in seeds {
        let summary = exact_demo(scenario, seed);
        let (shared, alone) = (run(&summary, true), run(&summary, false));
        assert!(is_safe(shared) && is_safe(alone), "seed {seed}: {summary}");
        let cavs = of_lane(shared, lane);
        assert!(cavs.len() >= 2);
        assert!(
            cavs.iter().all(changes_before_sight),
            "seed {seed}: {cavs:?}"
        );
        assert_eq!(shared["vehicles_stuck"], 0, "seed {seed}");
        assert_eq!(alone["lane_changes_before_sight"], 0, "seed {seed}");
        let stuck = alone["vehicles_stuck"].as_u64().expect("a count");
        let braking = alone["hardest_braking_mps2"].as_f64().expect("a number");
        held_up += usize::from(stuck > 0 || braking > 4.0);
        count += 1;
    }
    assert!(
        2 * held_up > count,
        "held up without sharing: {held_up} of {count}"
    );
}

#[test]
fn with_sharing_the_left_lane_is_left_before_the_obstacle_is_in_sight() {
    sharing_helps("obstacle-at-corner", 0, SEEDS);
}

#[test]
fn in_the_mirrored_scene_the_right_lane_is_left() {
    sharing_helps("obstacle-at-corner-mirrored", 2, SEEDS.take(3));
}

#[test]
fn without_obstacles_nobody_changes_lane() {
    for seed in SEEDS.take(3) {
        let summary = exact_demo("open-corner", seed);
        for sharing in [true, false] {
            let run = run(&summary, sharing);
            assert_eq!(run["lane_changes"], 0, "seed {seed}");
            assert!(is_safe(run), "seed {seed}: {run}");
        }
    }
}

/// The summary without wall times.
fn timeless(mut summary: Value) -> Value {
    for run in summary["runs"].as_array_mut().expect("runs") {
        let run = run.as_object_mut().expect("an object");
        run.remove("wall_s");
        run.remove("stages");
    }
    summary
}

#[test]
fn the_same_seed_gives_the_same_summary() {
    let seed = SEEDS.start;
    assert_eq!(
        timeless(exact_demo("obstacle-at-corner", seed)),
        timeless(exact_demo("obstacle-at-corner", seed))
    );
}

#[test]
fn through_the_networks_the_left_lane_is_left_before_the_obstacle_is_in_sight() {
    let out = tempfile::tempdir().expect("a folder");
    let seed = SEEDS.start.to_string();
    let summary = demo(
        out.path(),
        &["--sharing", "on", "--duration", "14", "--seed", &seed],
    );
    let shared = run(&summary, true);
    assert!(is_safe(shared), "{shared}");
    let cavs = of_lane(shared, 0);
    assert_eq!(cavs.len(), 2);
    assert!(cavs.iter().all(changes_before_sight), "{cavs:?}");
}

#[test]
fn the_networks_drive_alike_twice_whatever_the_number_of_threads() {
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
    let mut threads = ["1", "3"].into_iter();
    let [first, second] = folders.each_ref().map(|folder| {
        let trace = folder.path().join("trace.csv");
        let summary = demo_on(
            threads.next().expect("two runs"),
            folder.path(),
            &[
                "--duration",
                "2",
                "--seed",
                "1000",
                "--trace",
                trace.to_str().expect("a path"),
            ],
        );
        let rows = std::fs::read_to_string(trace).expect("a trace");
        (timeless(summary), rows)
    });
    assert_eq!(first, second);
    let (summary, rows) = first;
    // Six CAVs, a frame every 0.4 s for 2 s.
    assert_eq!(run(&summary, true)["frames_perceived"], 30);
    assert_eq!(summary["perception"], "network");
    // A header, then 11 vehicles at 20 times in each of two runs.
    assert_eq!(rows.lines().count(), 1 + 11 * 20 * 2);
    for name in [
        "sharing-on.rrd",
        "sharing-off.rrd",
        "trajectories.png",
        "speeds.png",
    ] {
        assert!(folders[0].path().join(name).is_file(), "{name}");
    }
}
