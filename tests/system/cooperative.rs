use std::{fs, path::Path};

use serde_json::Value;

use crate::binary::{assert_one_line_error, covista, root};

const CONDITIONS: [&str; 5] = [
    "alone",
    "ideal",
    "latency",
    "pose-noise",
    "latency-and-pose-noise",
];

/// `covista eval cooperative` on exact percepts: what it prints, and its rows.
fn evaluate(arguments: &[&str]) -> (String, Vec<Value>) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("cooperative.json");
    let output = covista()
        .args(["eval", "cooperative", "--perception", "truth"])
        .args(arguments)
        .arg("--json")
        .arg(&file)
        .output()
        .expect("covista runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = fs::read_to_string(file).expect("the report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(report["command"], "eval cooperative");
    let rows = report["rows"].as_array().expect("rows").clone();
    (String::from_utf8_lossy(&output.stdout).into_owned(), rows)
}

fn number(row: &Value, set: &str, field: &str) -> f64 {
    row[set][field]
        .as_f64()
        .unwrap_or_else(|| panic!("{set}.{field} of {row}"))
}

#[test]
fn sharing_shows_what_is_hidden_and_noise_costs_precision() {
    let arguments = ["obstacle-at-corner", "--seeds", "1", "--duration", "14"];
    let (table, rows) = evaluate(&arguments);
    assert!(table.contains("hidden from the ego"), "{table}");
    assert!(rows.iter().map(|row| &row["sharing"]).eq(&CONDITIONS));
    let [alone, ideal, late, noisy, both] = &rows[..] else {
        panic!("{rows:?}");
    };
    // Six CAVs, a frame every 0.4 s for 14 s.
    assert!(
        rows.iter()
            .all(|row| row["frames"] == 210 && row["seed"] == 1000)
    );
    assert_eq!(alone["channel"], Value::Null);
    assert_eq!(both["channel"]["latency_s"], 0.1);
    assert_eq!(both["channel"]["pose_noise"]["position_std_m"], 0.2);
    for row in &rows {
        let vehicles = |set: &str| row[set]["vehicles"].as_u64().expect("a count");
        assert_eq!(
            vehicles("all"),
            vehicles("seen_by_ego") + vehicles("hidden_from_ego")
        );
        assert!(vehicles("all") >= vehicles("seen_by_a_cav"));
        assert!(vehicles("seen_by_a_cav") >= vehicles("seen_by_ego"));
        assert!(vehicles("hidden_from_ego") > 0);
    }

    let shown = |row: &Value, set: &str| number(row, set, "shown_percent");
    let ap = |row: &Value| number(row, "all", "ap_bev_70_r40");
    let position = |row: &Value| number(row, "all", "position_rmse_m");
    assert!(shown(ideal, "hidden_from_ego") > shown(alone, "hidden_from_ego") + 20.0);
    assert!(ap(ideal) > ap(alone) + 10.0 && ap(ideal) > ap(both) + 5.0);
    for worse in [late, noisy, both] {
        assert!(position(worse) > position(ideal));
    }
    assert!(position(noisy) < 0.6, "{}", position(noisy));

    // The same again, to the byte.
    assert_eq!(rows, evaluate(&arguments).1);
}

#[test]
fn several_scenarios_and_seeds_make_rows_each() {
    let (_, rows) = evaluate(&[
        "mixed-traffic",
        "open-corner",
        "--seeds",
        "2",
        "--seed",
        "7",
        "--duration",
        "0.5",
    ]);
    assert_eq!(rows.len(), 2 * CONDITIONS.len());
    for row in &rows {
        // Two runs, six CAVs, frames at 0 and 0.4 s.
        assert_eq!(row["frames"], 24);
        assert_eq!(row["seeds"], 2);
        assert_eq!(row["perception"], "truth");
    }
    assert_eq!(rows[0]["scenario"], "mixed-traffic");
    assert_eq!(rows[5]["scenario"], "open-corner");
}

#[test]
fn bad_arguments_are_told_in_one_line() {
    let refused = |arguments: &[&str], parts: &[&str]| {
        let mut command = covista();
        command.args(["eval", "cooperative", "--perception", "truth"]);
        assert_one_line_error(command.args(arguments), parts);
    };
    refused(&["no-such-scene"], &["no-such-scene", "mixed-traffic"]);
    refused(&["--seeds", "0"], &["--seeds 0", "at least 1"]);
    refused(&["--duration", "0"], &["--duration", "out of range"]);
    refused(&["--json", "/nowhere/x.json"], &["/nowhere/x.json"]);

    let folder = tempfile::tempdir().expect("a folder");
    let refused_scene = |from: &str, to: &str, parts: &[&str]| {
        let original = root().join("assets/scenarios/obstacle-at-corner.toml");
        let text = fs::read_to_string(original).expect("a scenario");
        assert!(text.contains(from));
        let path: &Path = &folder.path().join("mine.toml");
        fs::write(path, text.replace(from, to)).expect("written");
        refused(&[path.to_str().expect("a path")], parts);
    };
    refused_scene("kind = \"cav\"", "kind = \"human\"", &["no CAV"]);
    refused_scene(
        "perception_period_s = 0.4",
        "perception_period_s = 0.25",
        &["perception_period_s", "0.25", "multiple of 0.1 s"],
    );
}
