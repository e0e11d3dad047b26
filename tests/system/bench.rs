use std::{fs, os::unix::fs::PermissionsExt, path::Path, process::Command};

use serde_json::Value;

use crate::binary::{assert_one_line_error, covista, root};

const FIXTURES: &str = "perception/tests/fixtures";

#[test]
fn bench_sensors_prints_a_table_and_writes_its_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("sensors.json");
    let output = covista()
        .args(["bench", "sensors", "--json"])
        .arg(&file)
        .output()
        .expect("covista runs");
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stdout).contains("Mrays/s core"));
    let text = std::fs::read_to_string(file).expect("the report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(report["command"], "bench sensors");
    let rows = report["rows"].as_array().expect("rows");
    let vehicles: Vec<_> = rows.iter().map(|row| &row["vehicles"]).collect();
    assert!(vehicles.iter().any(|count| **count == 1000));
    for row in rows {
        for field in ["mrays_per_s_core", "sweep_ms", "camera_frames_per_s"] {
            let value = row[field].as_f64().expect("a number");
            assert!(value.is_finite() && value > 0.0, "{field}: {value}");
        }
    }
}

#[test]
fn bench_traffic_has_a_row_for_each_number_of_vehicles() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("traffic.json");
    let output = covista()
        .args(["bench", "traffic", "--json"])
        .arg(&json)
        .output()
        .expect("covista runs");
    assert!(output.status.success(), "{output:?}");
    let table = String::from_utf8(output.stdout).expect("text");
    assert!(table.contains("vehicle-steps/s core"), "{table}");
    let text = fs::read_to_string(&json).expect("the report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(report["command"], "bench traffic");
    let rows = report["rows"].as_array().expect("rows");
    let numbers: Vec<_> = rows.iter().map(|row| row["vehicles"].as_u64()).collect();
    assert_eq!(numbers, [Some(30), Some(90), Some(1000)]);
    for row in rows {
        let number = |field: &str| row[field].as_f64().expect("a number");
        let steps_per_s = number("times_real_time") * 100.0 * number("vehicles");
        assert!((steps_per_s / number("vehicle_steps_per_s_core") - 1.0).abs() < 1e-9);
        assert!(steps_per_s > 100_000.0, "{row}");
    }
}

#[test]
fn bench_training_tells_what_an_update_costs_among_30_and_1000_cavs() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("training.json");
    let output = covista()
        .args(["bench", "training", "--decisions", "4", "--json"])
        .arg(&json)
        .output()
        .expect("covista runs");
    assert!(output.status.success(), "{output:?}");
    let table = String::from_utf8(output.stdout).expect("text");
    assert!(table.contains("x real time"), "{table}");
    let text = fs::read_to_string(&json).expect("the report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    let rows = report["rows"].as_array().expect("rows");
    let bytes = |algorithm: &str, agents: u64| {
        let is = |row: &&Value| row["algorithm"] == algorithm && row["agents"] == agents;
        let row = rows.iter().find(is).expect("a row");
        assert!(row["median_ms"].as_f64().expect("a number") > 0.0);
        row["critic_input_bytes"].as_u64().expect("a number")
    };
    let ours = "safe-actor-critic";
    assert_eq!(bytes(ours, 30), bytes(ours, 1000));
    assert!(bytes("maddpg", 1000) > 30 * bytes("maddpg", 30));
}

/// `covista bench training` of 25 updates in turns with `program`.
fn training_against(program: &Path) -> Command {
    let mut command = covista();
    command
        .args([
            "bench",
            "training",
            "--decisions",
            "25",
            "--against",
            "pytorch",
        ])
        .env("PATH", program);
    command
}

#[test]
fn another_program_makes_the_same_updates_in_turns() {
    let folder = tempfile::tempdir().expect("a folder");
    let json = folder.path().join("training.json");
    // Turns of 20 and 5 updates, a long second each.
    let program = python(
        "asked() { seconds=1000; n=$1; while [ $n -gt 1 ]; do seconds=$seconds,1000; n=$((n-1)); done; \
         echo \"{\\\"seconds\\\": [$seconds]}\"; }; \
         while read -r line; do case $line in \
         *open*) echo '{\"versions\": \"torch 9\"}' ;; \
         *'\"updates\":20'*) asked 20 ;; \
         *'\"updates\":5'*) asked 5 ;; \
         esac; done",
    );
    let output = training_against(program.path())
        .arg("--json")
        .arg(&json)
        .output()
        .expect("covista runs");
    assert!(output.status.success(), "{output:?}");
    let table = String::from_utf8(output.stdout).expect("text");
    assert!(table.contains("in turns with torch 9"), "{table}");
    let report: Value = serde_json::from_slice(&fs::read(json).expect("the report")).expect("JSON");
    let rows = report["rows"].as_array().expect("rows");
    let mut peers = rows.iter().filter(|row| row["run_by"] == "pytorch");
    let row = peers.next().expect("a row");
    assert_eq!(row["median_ms"].as_f64(), Some(1e6));
    assert_eq!(
        (&row["updates"], &row["sizes"]["minibatch"]),
        (&25.into(), &64.into())
    );
    let number = |name: &str| row[name].as_f64().expect("a number");
    assert!(
        (number("covista_updates_per_s") * number("covista_median_ms") / 1e3 - 1.0).abs() < 1e-9
    );
    assert!(number("covista_speed_ratio") > 1000.0, "{row}");
}

#[test]
fn what_python_lacks_for_an_update_is_named_before_the_first_one() {
    let fails = |program: &Path, parts: &[&str]| {
        let output = assert_one_line_error(&mut training_against(program), parts);
        assert!(output.stdout.is_empty(), "{output:?}");
    };
    let nothing = tempfile::tempdir().expect("a folder");
    fails(
        nothing.path(),
        &["python3 can't be run", "leave out --against"],
    );
    let bare =
        python("read -r line; echo '{\"error\": \"ModuleNotFoundError: No module named torch\"}'");
    fails(
        bare.path(),
        &[
            "--against pytorch",
            "No module named torch",
            "pip install numpy torch",
        ],
    );
    let other = python("read -r line; echo '{\"version\": 3}'; read -r line");
    fails(other.path(), &["--against pytorch", "makes no sense"]);
}

/// `covista bench perception` of the networks in `models`, on the CPU, three frames each.
fn perception(models: &Path) -> Command {
    let mut command = covista();
    command.args(["bench", "perception", "--provider", "cpu"]);
    command.args(["--repetitions", "3", "--models"]).arg(models);
    command
}

/// A fixture, the id that its copy gets and what is replaced in the copy's card.
type Change<'a> = (&'a str, &'a str, &'a [(&'a str, &'a str)]);

/// The tiny networks in a folder of their own, with the files of `change` made from them: from, to,
/// and what to replace in the card.
fn networks(changes: &[Change<'_>]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (from, to, replace) in changes {
        let fixture = root().join(FIXTURES).join(from);
        fs::copy(
            fixture.with_extension("onnx"),
            folder.path().join(format!("{from}.onnx")),
        )
        .expect("copied");
        let card = fs::read_to_string(fixture.with_extension("toml")).expect("a card");
        let card = replace.iter().fold(card, |card, (old, new)| {
            assert!(card.contains(old), "no {old} in {card}");
            card.replacen(old, new, 1)
        });
        fs::write(folder.path().join(format!("{to}.toml")), card).expect("written");
    }
    folder
}

#[test]
fn bench_perception_has_every_network_alone_and_end_to_end() {
    let measured = "[metrics]\ncommand = \"covista eval\"\ncar_frames = 7\n\
                    ap_3d_car_moderate_r40 = 71.5\n\n[cost]\nmultiply_accumulates = 2000000\n\
                    parameters = 9\nnonzero_parameters = 8\n";
    let models = networks(&[
        ("pointpillars", "pointpillars", &[]),
        ("ufld-resnet18", "ufld-resnet18", &[]),
        (
            "pointpillars",
            "pointpillars-p4",
            &[
                ("id = \"pointpillars\"", "id = \"pointpillars-p4\""),
                ("[metrics]\n", measured),
            ],
        ),
    ]);
    let (json, plot) = (models.path().join("rows.json"), models.path().join("a.png"));
    let output = perception(models.path())
        .args(["--threads", "2", "--json"])
        .arg(&json)
        .arg("--plot")
        .arg(&plot)
        .output()
        .expect("covista runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{output:?}");
    for part in [
        "2 threads; 3 frames each",
        "end to end",
        "GMAC/s",
        "SHA-256",
        "71.50",
    ] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    assert!(fs::read(plot).expect("a plot").starts_with(b"\x89PNG"));

    let report: Value = serde_json::from_slice(&fs::read(json).expect("the report")).expect("JSON");
    assert_eq!(report["command"], "bench perception");
    assert_eq!(report["settings"]["counted_frames"], 3);
    let rows = report["rows"].as_array().expect("rows");
    let row = |model: &str, stage: &str| {
        let mut of = rows
            .iter()
            .filter(|row| row["model"] == model && row["stage"] == stage);
        let found = of.next().unwrap_or_else(|| panic!("no {model}, {stage}"));
        assert!(of.next().is_none(), "{model}, {stage} twice");
        found
    };
    for model in ["pointpillars", "pointpillars-p4", "ufld-resnet18"] {
        for stage in ["network", "end_to_end"] {
            let row = row(model, stage);
            assert_eq!(
                (&row["provider"], &row["precision"]),
                (&"cpu".into(), &"fp32".into())
            );
            let ms = ["median_ms", "p95_ms", "p99_ms"].map(|name| row[name].as_f64());
            assert!(ms.is_sorted() && ms[0].is_some_and(|ms| ms > 0.0), "{row}");
            let img_per_s = row["img_per_s"].as_f64().expect("a number");
            assert!((img_per_s * ms[0].unwrap_or(0.0) / 1e3 - 1.0).abs() < 1e-9);
            assert_eq!(row["sha256"].as_str().map(str::len), Some(64));
        }
        let whole = row(model, "end_to_end");
        let stages = ["prepare_ms", "network_ms", "decode_ms"].map(|name| whole[name].as_f64());
        let sum: f64 = stages.iter().flatten().sum();
        assert!(stages.iter().all(Option::is_some) && sum > 0.0, "{whole}");
    }
    row("pointpillars + ufld-resnet18", "end_to_end");
    assert_eq!(rows.len(), 7);

    let pruned = row("pointpillars-p4", "network");
    for (name, expected) in [
        ("gmac", 0.002),
        ("params", 9.0),
        ("nonzero_params", 8.0),
        ("accuracy", 71.5),
        ("accuracy_frames", 7.0),
    ] {
        let found = pruned[name].as_f64().expect(name);
        assert!((found - expected).abs() < 1e-12, "{name}: {found}");
    }
    let [rate, speed] = ["gmac_per_s", "img_per_s"].map(|name| pruned[name].as_f64());
    let rate = rate.zip(speed).map(|(rate, speed)| rate / speed);
    assert!(rate.is_some_and(|gmac| (gmac - 0.002).abs() < 1e-12));
    let dense = row("pointpillars", "network");
    let ratio = dense["median_ms"]
        .as_f64()
        .zip(pruned["median_ms"].as_f64());
    let speedup = pruned["speedup_over_dense"].as_f64();
    let agrees = ratio
        .zip(speedup)
        .is_some_and(|((dense, pruned), speedup)| (dense / pruned - speedup).abs() < 1e-9);
    assert!(agrees && dense["speedup_over_dense"].is_null(), "{pruned}");
    assert!(dense["accuracy"].is_null() && dense["gmac"].is_null());
}

/// A `python3` that answers as `script` says, in a folder for PATH.
fn python(script: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("python3");
    fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("written");
    fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("allowed");
    folder
}

#[test]
fn another_program_runs_the_same_networks_in_turns() {
    let models = networks(&[("pointpillars", "pointpillars", &[])]);
    let json = models.path().join("rows.json");
    // Two frames that don't count, then three: a long second each.
    let program = python(
        "while read -r line; do case $line in \
         *hello*) echo '{\"versions\": \"numpy 9\"}' ;; \
         *open*) echo '{}' ;; \
         *) echo '{\"seconds\": [1000, 1000, 1000], \"found\": 6}' ;; \
         esac; done",
    );
    let output = perception(models.path())
        .args(["--against", "onnxruntime-python", "--json"])
        .arg(&json)
        .env("PATH", program.path())
        .output()
        .expect("covista runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{output:?}");
    assert!(
        said.contains("against onnxruntime-python (numpy 9)"),
        "{said}"
    );
    let report: Value = serde_json::from_slice(&fs::read(json).expect("the report")).expect("JSON");
    let rows = report["rows"].as_array().expect("rows");
    let theirs: Vec<_> = rows
        .iter()
        .filter(|row| row["run_by"] == "onnxruntime-python")
        .collect();
    assert_eq!(theirs.len(), 2);
    for row in theirs {
        assert_eq!(row["median_ms"].as_f64(), Some(1e6));
        assert!(
            row["covista_speed_ratio"]
                .as_f64()
                .is_some_and(|ratio| ratio > 1.0),
            "{row}"
        );
    }
    assert_eq!(rows[3]["found_per_frame"].as_f64(), Some(2.0));
}

#[test]
fn bench_perception_says_what_is_wrong_before_the_first_frame() {
    let fixtures = root().join(FIXTURES);
    let fails = |command: &mut Command, parts: &[&str]| {
        let output = assert_one_line_error(command, parts);
        assert!(output.stdout.is_empty(), "{output:?}");
    };
    fails(
        perception(&fixtures).args(["--model", "pointpillars-p3"]),
        &[
            "`pointpillars-p3`",
            "pointpillars, pointpillars-kitti, ufld-resnet18",
        ],
    );
    fails(
        perception(&fixtures).args(["--provider", "cuda"]),
        &["cuda", "cpu"],
    );
    fails(
        perception(&fixtures).args(["--provider", "tpu"]),
        &["`tpu` is no provider", "openvino"],
    );
    fails(
        perception(&fixtures).args(["--repetitions", "0"]),
        &["--repetitions"],
    );
    fails(
        perception(&fixtures).args(["--data", "no-such-folder"]),
        &["no-such-folder"],
    );
    fails(
        perception(Path::new("no-such-folder")).args([] as [&str; 0]),
        &["no-such-folder"],
    );

    let damaged = networks(&[(
        "pointpillars",
        "pointpillars",
        &[("sha256 = \"", "sha256 = \"0")],
    )]);
    fails(
        &mut perception(damaged.path()),
        &["pointpillars.onnx", "damaged", "SHA-256", "restore"],
    );
    let other = networks(&[(
        "ufld-resnet18",
        "ufld-resnet18",
        &[("[1, 3, 288, 800]", "[1, 3, 288, 801]")],
    )]);
    fails(
        &mut perception(other.path()),
        &["ufld-resnet18.onnx", "does not fit", "801"],
    );

    let taken = tempfile::NamedTempFile::new().expect("a file");
    for option in ["--json", "--plot"] {
        let inside = taken.path().join("out");
        fails(
            perception(&fixtures).arg(option).arg(inside),
            &["cannot write", "choose another"],
        );
    }
}

#[test]
fn what_python_lacks_is_named() {
    let models = networks(&[("pointpillars", "pointpillars", &[])]);
    let against = |program: &tempfile::TempDir, what: &str| {
        let mut command = perception(models.path());
        command
            .args(["--against", what])
            .env("PATH", program.path());
        command
    };
    let nothing = tempfile::tempdir().expect("a folder");
    assert_one_line_error(
        &mut against(&nothing, "pytorch"),
        &["python3 can't be run", "leave out --against"],
    );
    let bare = python("echo \"ModuleNotFoundError: No module named 'numpy'\" >&2; exit 1");
    assert_one_line_error(
        &mut against(&bare, "onnxruntime-python"),
        &[
            "--against onnxruntime-python",
            "No module named 'numpy'",
            "pip install numpy onnxruntime",
        ],
    );
    let without_torch =
        python("read -r line; echo '{\"error\": \"No module named torch\"}'; read -r line");
    assert_one_line_error(
        &mut against(&without_torch, "pytorch"),
        &["No module named torch", "pip install numpy onnx torch"],
    );
}

/// `covista bench control` with as few steps as its parts take.
fn control() -> Command {
    let mut command = covista();
    command.args(["bench", "control", "--steps", "24000", "--seed", "5"]);
    command
}

#[test]
fn bench_control_has_the_campaign_what_it_breaks_and_the_time_of_a_step() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("control.json");
    let output = control()
        .arg("--json")
        .arg(&file)
        .output()
        .expect("covista runs");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{output:?}");
    for part in ["one vehicle-step", "broken on purpose", "dynamic-bicycle"] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    let report: Value = serde_json::from_slice(&fs::read(file).expect("the report")).expect("JSON");
    assert_eq!(report["command"], "bench control");
    assert_eq!(report["settings"]["seed"], 5);
    let rows = report["rows"].as_array().expect("rows");

    for solver in ["closed-form", "clarabel"] {
        let timed: Vec<_> = rows.iter().filter(|row| row["solver"] == solver).collect();
        assert_eq!(timed.len(), 6, "{solver}");
        for row in timed {
            let us = ["clock_us", "median_us", "p99_us"].map(|name| row[name].as_f64());
            assert!(us.is_sorted() && us[1].is_some_and(|us| us > 0.0), "{row}");
        }
    }

    let campaign = |broken: bool| {
        let of = move |row: &&Value| row["broken_on_purpose"] == broken;
        rows.iter().filter(of).collect::<Vec<_>>()
    };
    let [whole] = campaign(false)[..] else {
        panic!("one row of the whole campaign");
    };
    for field in ["violations", "infeasible", "collisions", "unattributed"] {
        assert_eq!(whole[field], 0, "{field}: {whole}");
    }
    assert_eq!(whole["campaign_steps"], 24_000);
    assert!(whole["excused"].is_u64() && whole["smallest_h_m"].is_number());
    assert_eq!(whole["families"].as_array().map(Vec::len), Some(6));

    let broken = campaign(true);
    assert_eq!(broken.len(), 9);
    for row in broken {
        let count = |name: &str| row[name].as_u64().expect("a count");
        assert!(count("campaign_steps") >= 30_000);
        if !row["broken"]
            .as_str()
            .is_some_and(|of| of.starts_with("follower"))
        {
            assert!(count("violations") > 0, "{row}");
            assert_eq!(row["named"], true, "{row}");
        }
    }

    let plants: Vec<_> = rows.iter().filter(|row| row["plant"].is_string()).collect();
    assert_eq!(plants.len(), 10);
    assert!(plants.iter().all(|row| row["covered"].is_boolean()));
}

#[test]
fn bench_control_says_what_is_wrong_before_the_first_step() {
    let taken = tempfile::NamedTempFile::new().expect("a file");
    assert_one_line_error(
        control().arg("--json").arg(taken.path().join("out")),
        &["cannot write", "choose another"],
    );
    assert_one_line_error(
        covista().args(["bench", "control", "--steps", "0"]),
        &["--steps"],
    );
}
