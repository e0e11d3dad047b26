//! The pipeline through ONNX Runtime, on tiny networks whose answers are known. ONNX Runtime is
//! found or fetched as at any other run.

#![allow(clippy::expect_used)]

use std::path::{Path, PathBuf};

use covista_perception::{
    Detector, FramePercepts, LaneFinder, ModelCard, ModelError, OnnxRuntime, Perceiver,
    SessionSettings, list_models, verify_model,
};
use covista_world::{Calibration, CameraImage, LaneIndex, ObjectClass, PointCloud, SensorFrame};
use nalgebra::Vector3;

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

fn runtime() -> OnnxRuntime {
    OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime")
}

fn frame(points: Vec<[f32; 4]>) -> SensorFrame {
    SensorFrame {
        time_s: 1.5,
        image: CameraImage {
            width_px: 1242,
            height_px: 375,
            rgb: vec![90; 3 * 1242 * 375],
        },
        points: PointCloud { points },
    }
}

fn perceive(frame: &SensorFrame, threads: usize) -> FramePercepts {
    Perceiver::new(&runtime(), &fixtures(), SessionSettings::cpu(threads))
        .expect("models")
        .perceive(frame, &Calibration::kitti())
        .expect("percepts")
}

#[test]
fn a_frame_goes_through_both_networks() {
    // The tiny detector sees one car in the cell around (20, 3) m of the LIDAR frame.
    let frame = frame(vec![[20.0, 3.0, -1.0, 0.4]; 40]);
    for threads in [1, 2] {
        let found = perceive(&frame, threads);
        assert_eq!(found.percepts.len(), 1);
        let car = found.percepts[0].detection;
        assert_eq!(car.class, ObjectClass::Car);
        let center = Vector3::new(20.0 + 0.9, 3.0, 1.73 - 0.95);
        assert!((car.center_m - center).norm() < 0.25, "{car:?}");
        assert!((car.score - 1.0 / (1.0 + (-4f64).exp())).abs() < 1e-6);
        // The tiny lane network sees upright marks at cells 20, 40, 60, 80: at x = 20.9 m they
        // lie at y = 9.7, 2.9, -3.9 and -10.7 m.
        for (mark, pixels) in found.marks.pixels.iter().enumerate() {
            let expected = (20.0 * (mark as f32 + 1.0) + 0.5) * 12.42;
            assert!(
                pixels
                    .iter()
                    .all(|u| u.is_some_and(|u| (u - expected).abs() < 0.01))
            );
        }
        assert_eq!(found.percepts[0].lane, Some(LaneIndex::LEFTMOST));
        let bins = found.free_space.ranges_m.len() as f64;
        let bin = (3f64.atan2(20.0) / std::f64::consts::TAU * bins) as usize;
        assert!((f64::from(found.free_space.ranges_m[bin]) - 409f64.sqrt()).abs() < 1e-3);
        assert!(found.timings.lanes_s > 0.0 && found.timings.detector_s > 0.0);
    }
}

#[test]
fn an_empty_sweep_has_no_vehicle() {
    assert!(perceive(&frame(Vec::new()), 1).percepts.is_empty());
}

fn detector(id: &str) -> Detector {
    Detector::open(&runtime(), &fixtures(), id, SessionSettings::cpu(1)).expect("a detector")
}

#[test]
fn a_detector_of_the_papers_shape_works_from_its_card_alone() {
    // Two cars, the second one beside the range of the closed loop's detector.
    let mut points = vec![[20.0, 3.0, -1.0, 0.4]; 40];
    points.extend([[50.0, -30.0, -1.0, 0.4]; 3]);
    let points = PointCloud { points };
    let mut paper = detector("pointpillars-kitti");
    assert_eq!(paper.id(), "pointpillars-kitti");
    let mut found = paper.detect(&points).expect("boxes");
    found.sort_by(|a, b| a.center_m.x.total_cmp(&b.center_m.x));
    let expected = [[20.0, 3.0, -0.95], [50.0, -30.0, -0.95]];
    assert_eq!(found.len(), expected.len());
    for (found, center) in found.iter().zip(expected) {
        assert!(
            (found.center_m - Vector3::from(center)).norm() < 0.25,
            "{found:?}"
        );
    }
    let near = detector("pointpillars").detect(&points).expect("boxes");
    assert_eq!(near.len(), 1);
}

#[test]
fn less_sure_boxes_come_on_demand_after_the_sure_ones() {
    let mut detector = detector("pointpillars");
    let points = PointCloud {
        points: vec![[20.0, 3.0, -1.0, 0.4]; 40],
    };
    let sure = detector.detect(&points).expect("boxes");
    // Empty cells have a score of 1 / (1 + e^4) = 0.018.
    let all = detector.detect_down_to(&points, 0.01).expect("boxes");
    assert_eq!(all[..sure.len()], sure);
    assert!(all.len() > 20 && all[sure.len()..].iter().all(|found| found.score < 0.02));
    assert_eq!(detector.detect_down_to(&points, 0.05).expect("boxes"), sure);
}

#[test]
fn another_kind_of_network_and_unknown_ones_are_refused_with_what_there_is() {
    let refused = |id: &str| {
        let error = Detector::open(&runtime(), &fixtures(), id, SessionSettings::cpu(1));
        error.expect_err("refused").to_string()
    };
    assert!(refused("ufld-resnet18").contains("`ufld-resnet18` is no detector"));
    let message = refused("pointpillars-x");
    for part in [
        "pointpillars-x",
        "pointpillars, pointpillars-kitti, ufld-resnet18",
    ] {
        assert!(message.contains(part), "{message}");
    }
    let lanes = LaneFinder::open(
        &runtime(),
        &fixtures(),
        "pointpillars",
        SessionSettings::cpu(1),
    );
    let message = lanes.expect_err("refused").to_string();
    assert!(message.contains("is no lane network"), "{message}");
}

#[test]
fn strange_sweeps_have_an_answer() {
    let mut detector = detector("pointpillars-kitti");
    let mut count = |points: Vec<[f32; 4]>| {
        let found = detector.detect(&PointCloud { points });
        found.expect("an answer").len()
    };
    assert_eq!(count(Vec::new()), 0);
    assert_eq!(count(vec![[20.0, 3.0, -1.0, 0.4]]), 1);
    assert_eq!(count(vec![[-20.0, 0.0, -1.0, 0.4]; 9]), 0);
    let in_one_pillar = |i: u32| [20.0 + 0.1 * (i as f32 / 2e6), 3.0, -1.0, 0.4];
    assert_eq!(count((0..2_000_000).map(in_one_pillar).collect()), 1);
    // All over the range and beyond: more pillars than there is room for.
    let everywhere = |i: u32| {
        let [x, y, z] = [12.9898, 78.233, 37.719].map(|step: f64| (step * f64::from(i)).fract());
        [100.0 * x - 10.0, 90.0 * y - 45.0, 5.0 * z - 3.5, z].map(|value| value as f32)
    };
    assert!(count((0..2_000_000).map(everywhere).collect()) > 10);
    let far = vec![[f32::MAX, -f32::MAX, f32::MIN_POSITIVE, 0.0]; 5];
    assert_eq!(count(far), 0);
}

#[test]
fn a_sweep_or_an_image_with_nothing_in_it_has_an_answer() {
    let mut black = frame(vec![[1.0, 0.0, -1.0, 0.0]]);
    black.image.rgb.fill(0);
    assert_eq!(perceive(&black, 1).marks.pixels.len(), 4);
    let mut detector = detector("pointpillars");
    for value in [f32::NAN, f32::INFINITY] {
        for axis in 0..4 {
            let mut point = [20.0, 3.0, -1.0, 0.4];
            point[axis] = value;
            let points = vec![[20.0, 3.0, -1.0, 0.4], point];
            let error = detector
                .detect(&PointCloud { points })
                .expect_err("refused");
            assert!(error.to_string().contains("point 1"), "{error}");
        }
    }
}

#[test]
fn frames_that_are_not_valid_are_refused_in_one_line() {
    let mut perceiver =
        Perceiver::new(&runtime(), &fixtures(), SessionSettings::cpu(1)).expect("models");
    let mut refused = |frame: &SensorFrame| {
        let error = perceiver.perceive(frame, &Calibration::kitti());
        error.expect_err("refused").to_string()
    };
    let message = refused(&frame(vec![[f32::NAN, 0.0, 0.0, 0.0]]));
    assert!(message.contains("point 0"), "{message}");
    let mut short = frame(Vec::new());
    short.image.rgb.pop();
    assert!(refused(&short).contains("needs 1397250 bytes"));
    let mut small = frame(Vec::new());
    small.image = CameraImage {
        width_px: 2,
        height_px: 1,
        rgb: vec![0; 6],
    };
    assert!(refused(&small).contains("[2, 1]"));
}

#[test]
fn the_models_of_a_folder_are_listed_and_verified() {
    let cards = list_models(&fixtures()).expect("cards");
    let ids: Vec<_> = cards.iter().map(|card| card.id.as_str()).collect();
    assert_eq!(ids, ["pointpillars", "pointpillars-kitti", "ufld-resnet18"]);
    for card in &cards {
        verify_model(&runtime(), card).expect("fits its card");
    }
    let error = list_models(Path::new("nowhere")).expect_err("no folder");
    assert!(
        error.to_string().starts_with("nowhere is no folder"),
        "{error}"
    );
}

#[test]
fn a_model_that_is_not_its_cards_is_refused_in_one_line() {
    let card = ModelCard::load(&fixtures().join("pointpillars.toml")).expect("card");
    let refused = |change: &dyn Fn(&mut ModelCard)| {
        let mut card = card.clone();
        change(&mut card);
        let message = verify_model(&runtime(), &card)
            .expect_err("refused")
            .to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    };
    let message = refused(&|card| card.file = "nowhere.onnx".into());
    assert!(
        message.starts_with("the model nowhere.onnx can't be read"),
        "{message}"
    );
    let message = refused(&|card| card.outputs[0].name = "scores".into());
    assert!(message.contains("output class_logits"), "{message}");
    let message = refused(&|card| card.inputs[0].dtype = "int64".into());
    assert!(message.contains("input canvas"), "{message}");

    let folder = tempfile::tempdir().expect("folder");
    let damaged = folder.path().join("damaged.onnx");
    let mut bytes = std::fs::read(&card.file).expect("model");
    bytes[200] ^= 1;
    std::fs::write(&damaged, &bytes).expect("written");
    let message = refused(&|card| card.file = damaged.clone());
    assert!(
        message.contains("is damaged") && message.contains("restore it"),
        "{message}"
    );

    // A file with the hash of its card that is no ONNX model.
    std::fs::write(&damaged, b"").expect("written");
    let error = verify_model(
        &runtime(),
        &ModelCard {
            file: damaged,
            sha256: "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855".into(),
            ..card.clone()
        },
    )
    .expect_err("refused");
    assert!(matches!(error, ModelError::Refused { .. }), "{error}");
}

/// The fixture's detector with its file changed byte by byte and its card by text; ONNX files are
/// protocol buffers, in which text of the same length can be exchanged.
fn changed_detector(
    folder: &Path,
    bytes: [&str; 2],
    card: &[[&str; 2]],
) -> Result<Detector, ModelError> {
    use sha2::{Digest, Sha256};
    let [from, to] = bytes.map(str::as_bytes);
    assert_eq!(from.len(), to.len());
    let mut model = std::fs::read(fixtures().join("pointpillars.onnx")).expect("model");
    let at = model.windows(from.len()).position(|part| part == from);
    let at = at.expect("the text in the file");
    model[at..at + to.len()].copy_from_slice(to);
    let mut text = std::fs::read_to_string(fixtures().join("pointpillars.toml")).expect("card");
    let sha256 = text.lines().find(|line| line.starts_with("sha256"));
    let sha256 = sha256.expect("a hash").to_owned();
    let hash: String = Sha256::digest(&model)
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect();
    text = text.replace(&sha256, &format!("sha256 = \"{hash}\""));
    for [from, to] in card {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    std::fs::write(folder.join("pointpillars.onnx"), model).expect("written");
    std::fs::write(folder.join("pointpillars.toml"), text).expect("written");
    Detector::open(&runtime(), folder, "pointpillars", SessionSettings::cpu(1))
}

#[test]
fn a_detector_that_does_not_fit_is_refused_before_the_first_frame() {
    let folder = tempfile::tempdir().expect("folder");
    let none = ["pillar_features", "pillar_features"];
    assert!(changed_detector(folder.path(), none, &[]).is_ok());
    // The file, what is replaced in its card, what the error says.
    type Case<'a> = ([&'a str; 2], &'a [[&'a str; 2]], &'a str);
    let cases: [Case<'_>; 7] = [
        (
            ["pillar_features", "pillar_weather_"],
            &[],
            "has no pillar_features",
        ),
        (
            ["shift = [1, 0]", "shift = [1   ]"],
            &[],
            "differ in length",
        ),
        (
            ["shift = [1, 0]", "shift = [1,nan"],
            &[],
            "in pillar_features",
        ),
        (["shift = [1, 0]", "shift=[1,inf] "], &[], "not finite"),
        (
            ["shift = [1, 0]", "shift = \"1, 0\""],
            &[],
            "in pillar_features",
        ),
        (
            none,
            &[["[1, 2, 160, 864]", "[1, 2, 160, 862]"]],
            "takes a canvas [1, C, 160, 864]",
        ),
        (
            none,
            &[["[1, 28, 80, 432]", "[1, 80, 432, 28]"]],
            "[1, 28, 80, 432]",
        ),
    ];
    for (bytes, card, part) in cases {
        let error = changed_detector(folder.path(), bytes, card).expect_err(part);
        let message = error.to_string();
        assert!(
            message.contains(part) && !message.contains('\n'),
            "{message}"
        );
        assert!(
            message.ends_with("export it again and update its card"),
            "{message}"
        );
    }
}
