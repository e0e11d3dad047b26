use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Duration,
};

use serde_json::Value;

use crate::binary::{assert_one_line_error, covista};

fn dataset(out: &Path, arguments: &[&str]) -> Command {
    let mut command = covista();
    command.arg("dataset").arg("--out").arg(out).args(arguments);
    command
}

fn output_of(command: &mut Command) -> String {
    let output = command.output().expect("covista starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    String::from_utf8(output.stdout).expect("text")
}

/// A folder with one frame.
fn one_frame() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("data");
    output_of(&mut dataset(&out, &["--frames", "1", "--seed", "3"]));
    (folder, out)
}

fn manifest(out: &Path) -> Value {
    let text = fs::read_to_string(out.join("manifest.json")).expect("a manifest");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn a_dataset_is_complete_and_says_what_it_holds() {
    let (_folder, out) = one_frame();
    let again = ["--frames", "3", "--seed", "3", "--format", "tusimple,kitti"];
    assert!(output_of(&mut dataset(&out, &again)).starts_with("3 frames in"));
    let manifest = manifest(&out);
    assert_eq!(
        (&manifest["version"], &manifest["frames"]),
        (&2.into(), &3.into())
    );
    for file in manifest["files"].as_object().expect("files").keys() {
        assert!(out.join(file).is_file(), "{file}");
    }
    let list = fs::read_to_string(out.join("ImageSets/train.txt")).expect("a list");
    assert_eq!(list, "000000\n000001\n000002\n");
    let fewer = output_of(&mut dataset(&out, &["--frames", "2", "--seed", "3"]));
    assert!(
        fewer.contains("3 frames in") && fewer.contains("the 2 asked for"),
        "{fewer}"
    );

    assert_one_line_error(
        &mut dataset(&out, &["--frames", "3", "--seed", "4"]),
        &["another seed", "choose another folder"],
    );
    assert_one_line_error(
        &mut dataset(&out, &["--frames", "3", "--format", "kitty"]),
        &["kitty", "kitti, tusimple or mcap"],
    );
    assert_one_line_error(
        &mut dataset(&out, &["--frames", "3", "--lidar", "hdl-65"]),
        &["hdl-65", "hdl-64e"],
    );
}

#[cfg(unix)]
#[test]
fn a_dataset_that_is_stopped_is_valid_and_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("data");
    let mut child = dataset(&out, &["--frames", "500"])
        .stderr(Stdio::piped())
        .spawn()
        .expect("covista starts");
    let is_begun = || out.join("scenes/000000.json").is_file();
    while !is_begun() {
        assert!(
            child.try_wait().expect("a process").is_none(),
            "it ended early"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    // A second process keeps out.
    assert_one_line_error(&mut dataset(&out, &["--frames", "1"]), &["another process"]);
    let interrupt = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    assert!(interrupt.expect("kill starts").success());
    let output = child.wait_with_output().expect("it ends");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(
        stderr.contains("of 500 frames") && stderr.contains("goes on"),
        "{stderr}"
    );

    let frames = manifest(&out)["frames"].as_u64().expect("a count");
    assert!((1..500).contains(&frames));
    let lines = |name: &str| {
        let text = fs::read_to_string(out.join(name)).expect("a list");
        text.lines().count() as u64
    };
    assert_eq!(
        (lines("ImageSets/train.txt"), lines("label_data.json")),
        (frames, frames)
    );
    let pictures = fs::read_dir(out.join("image_2")).expect("pictures").count() as u64;
    assert_eq!(pictures, frames);
    assert!(!out.join(".partial").exists());
}

#[test]
fn folders_and_single_files_are_evaluated_and_frames_left_out_are_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("data");
    output_of(&mut dataset(&out, &["--frames", "3", "--split", "test"]));
    fs::remove_file(out.join("label_2/000002.txt")).expect("removed");
    let eval = |what: &str, data: &Path| {
        let mut command = covista();
        command.args(["eval", what, "--data"]).arg(data);
        output_of(&mut command)
    };
    let said = eval("detector", &out);
    assert!(
        said.contains("on 2 frames (1 others lack label_2)"),
        "{said}"
    );
    let said = eval("lanes", &out);
    assert!(said.contains("on 3 frames: TuSimple accuracy"), "{said}");

    let said = eval("detector", &out.join("velodyne/000001.bin"));
    assert!(
        said.starts_with("class") && said.contains("on 1 frames"),
        "{said}"
    );
    let said = eval("detector", &out.join("velodyne/000002.bin"));
    assert!(said.starts_with("class") && !said.contains("AP"), "{said}");
    let said = eval("lanes", &out.join("image_2/000001.png"));
    assert!(
        said.starts_with("mark_0_px") && said.contains("accuracy"),
        "{said}"
    );

    let recording = folder.path().join("seen");
    let mut demo = covista();
    let said = output_of(demo.arg("demo").arg(&out).arg("--out").arg(&recording));
    assert!(
        said.lines().count() == 5 && said.contains("000002"),
        "{said}"
    );
    assert!(recording.join("frames.rrd").is_file());
}

#[test]
fn a_photograph_of_another_camera_is_seen_through_its_calibration() {
    const CAMERA: &str = "assets/calibration/windscreen-1280x720.toml";
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("data");
    output_of(&mut dataset(
        &out,
        &["--frames", "1", "--seed", "1", "--calibration", CAMERA],
    ));
    // Away from its labels, which stand at rows above the horizon of this camera.
    let picture = folder.path().join("photograph.png");
    fs::copy(out.join("image_2/000000.png"), &picture).expect("copied");
    let eval = |picture: &Path, calibration: &Path| {
        let mut command = covista();
        command.args(["eval", "lanes", "--data"]).arg(picture);
        command.arg("--calibration").arg(calibration);
        command
    };
    let said = output_of(&mut eval(&picture, Path::new(CAMERA)));
    assert!(said.starts_with("mark_0_px"), "{said}");
    let places: Vec<[f64; 2]> = said
        .split_whitespace()
        .filter_map(|cell| {
            let (u, v) = cell.split_once(',')?;
            Some([u.parse().ok()?, v.parse().ok()?])
        })
        .collect();
    assert!(places.len() > 20, "{said}");
    let is_road = |&[u, v]: &[f64; 2]| (0.0..1280.0).contains(&u) && (410.0..720.0).contains(&v);
    assert!(places.iter().all(is_road), "{said}");

    let seen = folder.path().join("seen");
    let mut demo = covista();
    demo.arg("demo")
        .arg(&picture)
        .args(["--calibration", CAMERA]);
    output_of(demo.arg("--out").arg(&seen));
    assert!(seen.join("frames.rrd").is_file());

    let small = folder.path().join("small.png");
    image::RgbImage::new(640, 480)
        .save(&small)
        .expect("written");
    let parts = ["small.png", "640x480", CAMERA, "1280x720"];
    assert_one_line_error(&mut eval(&small, Path::new(CAMERA)), &parts);
    let torn = folder.path().join("torn.toml");
    fs::write(&torn, "[camera]\nwidth_px = 12").expect("written");
    assert_one_line_error(&mut eval(&picture, &torn), &["torn.toml"]);
    let text = folder.path().join("torn.txt");
    fs::write(&text, "P2: 1 2 3\n").expect("written");
    assert_one_line_error(&mut eval(&picture, &text), &["torn.txt"]);
}

#[test]
fn bad_recorded_input_is_one_clear_line() {
    let (folder, out) = one_frame();
    let cloud = out.join("velodyne/000000.bin");
    let bytes = fs::read(&cloud).expect("a cloud");
    let write = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).expect("written");
        path
    };
    let json = folder.path().join("figures.json");
    let refused = |what: &str, data: &Path, parts: &[&str]| {
        let mut command = covista();
        command.args(["eval", what, "--data"]).arg(data);
        assert_one_line_error(command.arg("--json").arg(&json), parts);
        assert!(!json.exists());
    };
    let truncated = write("truncated.bin", &bytes[..bytes.len() - 5]);
    refused(
        "detector",
        &truncated,
        &["truncated.bin", "multiple of the 16"],
    );
    refused(
        "detector",
        &write("empty.bin", b""),
        &["empty.bin", "is empty"],
    );
    let mut nan = bytes;
    for point in [7, 9] {
        nan[16 * point..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    }
    nan[16 * 11..][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    let nan = write("nan.bin", &nan);
    refused(
        "detector",
        &nan,
        &["nan.bin", "3 of", "the first is point 7"],
    );
    refused(
        "detector",
        &folder.path().join("none.bin"),
        &["none.bin", "no such file"],
    );
    refused(
        "lanes",
        &write("torn.png", b"\x89PNG\r\n\x1a\n"),
        &["torn.png"],
    );
    let small = folder.path().join("small.png");
    image::RgbImage::new(640, 480)
        .save(&small)
        .expect("written");
    refused("lanes", &small, &["small.png", "640x480", "1242x375"]);

    let calibration = out.join("calib/000000.txt");
    let whole = fs::read_to_string(&calibration).expect("a calibration");
    let lines = whole
        .lines()
        .filter(|line| !line.starts_with("Tr_velo_to_cam"));
    let without: Vec<&str> = lines.collect();
    fs::write(&calibration, without.join("\n")).expect("written");
    refused(
        "detector",
        &out,
        &["calib/000000.txt", "no line `Tr_velo_to_cam:`"],
    );
    fs::write(&calibration, whole).expect("written");
    fs::write(out.join("label_2/000000.txt"), "Car 0.00 0 1.57\n").expect("written");
    refused(
        "detector",
        &out,
        &["label_2/000000.txt", "line 1", "15 columns"],
    );

    let seen = folder.path().join("seen");
    assert_one_line_error(
        covista().arg("demo").arg(&nan).arg("--out").arg(&seen),
        &["nan.bin", "3 of"],
    );
    let left: Vec<_> = fs::read_dir(&seen).expect("a folder").collect();
    assert!(left.is_empty(), "{left:?}");
}
