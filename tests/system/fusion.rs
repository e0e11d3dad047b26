use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::binary::{assert_one_line_error, covista};

fn succeed(command: &mut std::process::Command) -> String {
    let output = command.output().expect("covista starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    String::from_utf8(output.stdout).expect("text")
}

fn eval(data: &Path) -> std::process::Command {
    let mut command = covista();
    command.args(["eval", "fusion", "--data"]).arg(data);
    command
}

#[test]
fn lane_indices_are_counted_by_distance_and_what_is_missing_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let arguments = ["--frames", "4", "--seed", "2", "--split", "val"];
    succeed(
        covista()
            .arg("dataset")
            .arg("--out")
            .arg(&data)
            .args(arguments),
    );
    fs::remove_file(data.join("scenes/000003.json")).expect("removed");

    let json = folder.path().join("fusion.json");
    let said = succeed(eval(&data).arg("--json").arg(&json));
    assert!(
        said.starts_with("fusion on 3 frames (1 others lack scenes)"),
        "{said}"
    );
    assert!(
        said.contains("network, network") && said.contains("exact, exact"),
        "{said}"
    );
    assert!(said.contains("observation angle, deg"), "{said}");
    let text = fs::read_to_string(&json).expect("the report");
    let report: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(report["command"], "eval fusion");
    let rows = report["rows"].as_array().expect("rows");
    let of = |figure: &'static str| rows.iter().filter(move |row| row["figure"] == figure);
    for row in rows {
        assert_eq!((&row["seed"], &row["split"]), (&2.into(), &"val".into()));
        assert_eq!(
            (&row["model"], &row["frames"]),
            (&"fusion".into(), &3.into())
        );
    }
    let number = |row: &Value, field: &str| row[field].as_f64().expect("a number");
    let mut vehicles = 0;
    for row in of("lane_index").filter(|row| row["vehicles"] != 0) {
        let shares = ["lane_index_accuracy", "undetected", "undecided", "wrong"];
        let sum: f64 = shares.iter().map(|share| number(row, share)).sum();
        assert!((sum - 100.0).abs() < 1e-9, "{row}");
        vehicles += row["vehicles"].as_u64().expect("a count");
    }
    assert!(vehicles > 0);
    assert_eq!(of("reliability").count(), 10);
    assert_eq!(of("geometry").count(), 8);

    fs::write(data.join("scenes/000001.json"), "{\"seed\": 2}").expect("written");
    fs::remove_file(&json).expect("removed");
    assert_one_line_error(
        eval(&data).arg("--json").arg(&json),
        &["scenes/000001.json", "split"],
    );
    assert!(!json.exists());
    fs::remove_dir_all(data.join("scenes")).expect("removed");
    assert_one_line_error(&mut eval(&data), &["4 without scenes"]);
}
