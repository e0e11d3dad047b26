use serde_json::Value;

use crate::binary::covista;

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
