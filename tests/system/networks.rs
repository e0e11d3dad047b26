use std::{fs, path::Path};

use serde_json::Value;

use crate::binary::{assert_one_line_error, covista};

/// What `covista eval WHAT --data PATH` prints.
fn eval(what: &str, data: &Path, more: &[&str]) -> String {
    let mut command = covista();
    command.args(["eval", what, "--data"]).arg(data).args(more);
    let output = command.output().expect("covista starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    String::from_utf8(output.stdout).expect("text")
}

fn rows(path: &Path) -> Vec<Value> {
    let text = fs::read_to_string(path).expect("a file");
    let mut report: Value = serde_json::from_str(&text).expect("JSON");
    match report["rows"].take() {
        Value::Array(rows) => rows,
        other => panic!("no rows but {other}"),
    }
}

#[test]
fn the_figures_of_both_networks_are_in_their_rows() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = folder.path().join("data");
    let mut dataset = covista();
    dataset.args(["dataset", "--frames", "2", "--seed", "3", "--split", "test"]);
    let written = dataset.arg("--out").arg(&data).output();
    assert!(written.expect("covista starts").status.success());
    let json = folder.path().join("figures.json");
    let more = ["--json", json.to_str().expect("a path")];

    let said = eval("detector", &data, &more);
    for part in [
        "KITTI, in the picture",
        "recall, %",
        "labels, %",
        "headings flipped",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let detector = rows(&json);
    assert_eq!(detector.len(), 2);
    for (row, class) in detector.iter().zip(["car", "truck"]) {
        let fields = row.as_object().expect("fields");
        assert_eq!(
            (&row["model"], &row["frames"]),
            (&"pointpillars".into(), &2.into())
        );
        for name in [
            "ap_bev_50_r40",
            "ap_bev_70_r40",
            "boxes",
            "recall",
            "mean_bev_iou",
        ] {
            assert!(fields.contains_key(name), "{name} in {row}");
        }
        for level in ["easy", "moderate", "hard"] {
            assert!(row[format!("boxes_{level}")].is_u64(), "{row}");
            for view in ["3d", "bev"] {
                let name = format!("ap_{view}_{class}_{level}_r40");
                for name in [name.replace("r40", "r11"), format!("{name}_iou50"), name] {
                    assert!(fields.contains_key(&name), "{name} in {row}");
                }
            }
        }
        assert_eq!(
            row["recall_by_distance_m"].as_array().map(Vec::len),
            Some(7)
        );
        assert_eq!(row["recall_by_occlusion"].as_array().map(Vec::len), Some(3));
        assert_eq!(
            row["labelled_by_distance_m"].as_array().map(Vec::len),
            Some(8)
        );
    }

    let said = eval("lanes", &data, &more);
    assert!(said.contains("false negatives"), "{said}");
    for name in [
        "accuracy_tusimple",
        "accuracy_ufld",
        "accuracy_paper",
        "false_positive",
        "false_negative",
    ] {
        let value = rows(&json)[0][name].as_f64().expect("a number");
        assert!((0.0..=100.0).contains(&value), "{name}: {value}");
    }
}

#[test]
fn a_network_is_named_by_its_id_and_no_other_is_opened() {
    let folder = tempfile::tempdir().expect("a folder");
    let cloud = folder.path().join("one.bin");
    let point = [20.0_f32, 0.0, -1.0, 0.3].map(f32::to_le_bytes).concat();
    fs::write(&cloud, &point).expect("written");
    let eval = |what: &str, id: &str, models: &str| {
        let mut command = covista();
        command.args(["eval", what, "--model", id, "--models", models, "--data"]);
        command.arg(&cloud);
        command
    };
    let fixtures = "perception/tests/fixtures";
    let output = eval("detector", "pointpillars-kitti", fixtures).output();
    let output = output.expect("covista starts");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("car"), "{said}");
    assert_one_line_error(
        &mut eval("detector", "pointpillars-x", fixtures),
        &["`pointpillars-x`", "pointpillars, pointpillars-kitti"],
    );
    assert_one_line_error(
        &mut eval("detector", "ufld-resnet18", fixtures),
        &["`ufld-resnet18` is no detector", "covista models list"],
    );
    // A detector as they were before the canvas is refused before the first frame.
    let old = folder.path().join("old");
    fs::create_dir(&old).expect("a folder");
    let fixture = |name: &str| crate::binary::root().join(fixtures).join(name);
    let card = fs::read_to_string(fixture("pointpillars.toml")).expect("a card");
    let card = card.replace("[1, 2, 160, 864]", "[\"P\", 32, 9]");
    fs::write(old.join("pointpillars.toml"), card).expect("written");
    fs::copy(fixture("pointpillars.onnx"), old.join("pointpillars.onnx")).expect("copied");
    assert_one_line_error(
        &mut eval("detector", "pointpillars", old.to_str().expect("a path")),
        &[
            "pointpillars.onnx does not fit",
            "[1, C, 160, 864]",
            "export it again",
        ],
    );
    // The detector alone is enough.
    let alone = folder.path().join("alone");
    fs::create_dir(&alone).expect("a folder");
    for name in ["pointpillars.toml", "pointpillars.onnx"] {
        let from = crate::binary::root().join(fixtures).join(name);
        fs::copy(from, alone.join(name)).expect("copied");
    }
    let output = eval("detector", "pointpillars", alone.to_str().expect("a path")).output();
    assert!(output.expect("covista starts").status.success());
}

#[test]
fn strange_sweeps_and_a_black_picture_have_an_answer() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, points: &mut dyn Iterator<Item = [f32; 4]>| {
        let path = folder.path().join(name);
        let bytes: Vec<u8> = points.flatten().flat_map(f32::to_le_bytes).collect();
        fs::write(&path, bytes).expect("written");
        path
    };
    let one = write("one.bin", &mut std::iter::once([20.0, 0.0, -1.0, 0.3]));
    let in_one_pillar = |i: u32| [20.0, 0.0, -1.0 + 1e-6 * i as f32, 0.3];
    let heap = write("heap.bin", &mut (0..200_000).map(in_one_pillar));
    let everywhere = |i: u32| {
        let turn = i as f32 * 0.0123;
        let range_m = 2.0 + 70.0 * (i as f32 / 2e6);
        [range_m * turn.cos(), range_m * turn.sin(), -1.7, 0.2]
    };
    let many = write("many.bin", &mut (0..2_000_000).map(everywhere));
    for cloud in [one, heap, many] {
        let said = eval("detector", &cloud, &[]);
        assert!(said.starts_with("class"), "{said}");
    }
    let black = folder.path().join("black.png");
    image::RgbImage::new(1242, 375)
        .save(&black)
        .expect("written");
    let said = eval("lanes", &black, &[]);
    assert!(
        said.starts_with("mark_0_px") && said.lines().count() == 29,
        "{said}"
    );
}
