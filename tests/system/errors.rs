use std::{fs, path::Path};

use crate::binary::{assert_one_line_error, covista, root};

#[test]
fn an_unknown_scenario_field_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mine.toml");
    let original = root().join("assets/scenarios/obstacle-at-corner.toml");
    let text = fs::read_to_string(original).expect("a scenario");
    fs::write(&path, format!("speed_limit = 3\n{text}")).expect("written");
    assert_one_line_error(
        covista().args(["demo", path.to_str().expect("a path")]),
        &["mine.toml", "speed_limit"],
    );
}

#[test]
fn control_settings_that_are_none_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mine.toml");
    let demo = || {
        let mut command = covista();
        command.args(["demo", "--control", path.to_str().expect("a path")]);
        command
    };
    assert_one_line_error(&mut demo(), &["cannot read", "mine.toml", "--control"]);
    for (text, named) in [
        ("[safety]\nbrakes = 3", "brakes"),
        ("mode = \"fast\"", "fast"),
        ("[safety]\neta = 1.5", "`eta` is 1.5"),
        ("[safety]\nbrake_mps2 = nan", "brake_mps2"),
        ("[qp]\nslack_max = -1", "slack_max"),
    ] {
        fs::write(&path, text).expect("written");
        assert_one_line_error(&mut demo(), &["mine.toml", named]);
    }
}

#[test]
fn an_unknown_scenario_is_named_with_those_there_are() {
    assert_one_line_error(
        covista().args(["demo", "no-such-scene"]),
        &["no-such-scene", "obstacle-at-corner"],
    );
}

#[test]
fn an_unwritable_output_folder_is_told_before_any_work() {
    // A file stands where the folder would be; that fails for root, too.
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("taken");
    fs::write(&file, b"").expect("written");
    assert_one_line_error(
        covista().arg("demo").arg("--out").arg(file.join("out")),
        &["cannot write to the output folder", "--out"],
    );
}

/// A copy of the models folder.
fn models_copy(folder: &Path) {
    for entry in fs::read_dir(root().join("models")).expect("models") {
        let path = entry.expect("an entry").path();
        if let (true, Some(name)) = (path.is_file(), path.file_name()) {
            fs::copy(&path, folder.join(name)).expect("copied");
        }
    }
}

#[test]
fn a_damaged_network_is_refused() {
    let (models, out) = (tempfile::tempdir(), tempfile::tempdir());
    let (models, out) = (models.expect("a folder"), out.expect("a folder"));
    models_copy(models.path());
    let path = models.path().join("pointpillars.onnx");
    let mut bytes = fs::read(&path).expect("a network");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    fs::write(&path, bytes).expect("written");
    assert_one_line_error(
        covista()
            .args(["demo", "--models"])
            .arg(models.path())
            .arg("--out")
            .arg(out.path()),
        &["pointpillars.onnx"],
    );
    assert!(!out.path().join("summary.json").exists());
}

#[test]
fn a_missing_network_is_named() {
    let models = tempfile::tempdir().expect("a folder");
    let out = tempfile::tempdir().expect("a folder");
    assert_one_line_error(
        covista()
            .args(["demo", "--models"])
            .arg(models.path())
            .arg("--out")
            .arg(out.path()),
        &["ufld-resnet18.toml"],
    );
}

#[test]
fn without_onnx_runtime_and_network_it_says_how_to_get_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = covista()
        .args(["demo", "--out"])
        .arg(folder.path().join("out"))
        .env("COVISTA_CACHE", folder.path().join("cache"))
        .env_remove("ORT_DYLIB_PATH")
        // No index: what a machine without network comes to.
        .env("PIP_NO_INDEX", "1")
        .env_remove("PIP_FIND_LINKS")
        .output()
        .expect("covista starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    let error: Vec<&str> = stderr
        .lines()
        .filter(|line| line.contains("ORT_DYLIB_PATH"))
        .collect();
    assert_eq!(error.len(), 1, "{stderr}");
}

#[test]
fn a_dataset_without_frames_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    assert_one_line_error(
        covista()
            .args(["eval", "lanes", "--data"])
            .arg(folder.path()),
        &["no frame", "covista dataset"],
    );
}
