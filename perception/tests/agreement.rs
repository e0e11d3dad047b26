//! The shipped networks here and in PyTorch, on the same input: `models/training/export.py` writes
//! what PyTorch makes of it to `tests/networks`.

#![allow(clippy::expect_used)]

use std::path::{Path, PathBuf};

use covista_perception::{
    DETECTOR_MODEL, LANE_MODEL, ModelCard, Network, OnnxRuntime, SessionSettings,
    lanes::{decode::decode, network::LaneNetwork, preprocess::Resize},
    pointpillars::{decode::BoxDecoder, network::DetectorNetwork, preprocess::PillarGrid},
};
use covista_world::{CameraImage, ObjectClass, PointCloud, wrap_angle};
use serde_json::Value;

const RELATIVE: f64 = 1e-3;
const WITHIN_M: f64 = 0.01;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn card(id: &str) -> ModelCard {
    ModelCard::load(&root().join("models").join(format!("{id}.toml"))).expect("card")
}

fn reference(name: &str) -> Value {
    let path = root().join("tests/networks").join(name);
    let text = std::fs::read_to_string(path).expect("reference");
    serde_json::from_str(&text).expect("JSON")
}

fn numbers(value: &Value) -> Vec<f64> {
    let array = value.as_array().expect("an array");
    array.iter().map(|x| x.as_f64().expect("number")).collect()
}

/// The sampled outputs differ by at most a thousandth of their value, or of their spread.
fn assert_alike(output: &[f32], samples: &Value) {
    let spread = samples["deviation"].as_f64().expect("number");
    let places = numbers(&samples["at"]).into_iter().map(|at| at as usize);
    for (at, expected) in places.zip(numbers(&samples["values"])) {
        let difference = (f64::from(output[at]) - expected).abs();
        let allowed = RELATIVE * expected.abs().max(spread);
        assert!(difference <= allowed, "{at}: {} {expected}", output[at]);
    }
}

#[test]
fn detectors_agree_with_pytorch() {
    let bytes = std::fs::read(root().join("tests/networks/sweep.bin")).expect("sweep");
    let value = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().expect("four bytes"));
    let points = bytes
        .chunks_exact(16)
        .map(|point| std::array::from_fn(|i| value(&point[4 * i..4 * i + 4])));
    let sweep = PointCloud {
        points: points.collect(),
    };
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    for id in [DETECTOR_MODEL, "pointpillars-kitti"] {
        let card = card(id);
        let Network::PointPillars(spec) = &card.network else {
            panic!("{id} is not a detector");
        };
        let mut network =
            DetectorNetwork::open(&runtime, &card, spec, SessionSettings::cpu(1)).expect("network");
        let reference = reference(&format!("{id}.json"));
        let mut grid = PillarGrid::new(spec);
        network.paint(grid.apply(&sweep));
        network.run().expect("maps");
        let (maps, outputs) = (network.maps(), &reference["outputs"]);
        assert_alike(maps.class_logits, &outputs["class_logits"]);
        assert_alike(maps.box_deltas, &outputs["box_deltas"]);
        assert_alike(maps.direction_logits, &outputs["direction_logits"]);
        let boxes = BoxDecoder::new(spec).decode(maps, spec.score_threshold);
        let expected: Vec<Vec<f64>> = reference["boxes"]
            .as_array()
            .expect("boxes")
            .iter()
            .map(numbers)
            .filter(|row| row[7] >= spec.score_threshold)
            .collect();
        assert_eq!(boxes.len(), expected.len(), "{id}");
        assert!(boxes.len() >= 3, "{id}: {boxes:?}");
        for (found, row) in boxes.iter().zip(&expected) {
            let here = found.center_m.iter().chain(found.size_m.iter());
            for (found, expected) in here.zip(row) {
                assert!(
                    (found - expected).abs() < WITHIN_M,
                    "{id}: {found} {expected}"
                );
            }
            assert!(wrap_angle(found.yaw_rad - row[6]).abs() < 0.01, "{id}");
            assert!((found.score - row[7]).abs() < 1e-3, "{id}");
            assert_eq!(found.class == ObjectClass::Truck, row[8] > 0.5, "{id}");
        }
    }
}

/// The picture that `road_picture` in `models/training/deploy.py` draws.
fn road_picture() -> CameraImage {
    let (width, height) = (1242, 375);
    let gray = |u: i32, v: i32| {
        let below = v - 173;
        let is_on_line = |side: i32| (4 * (u - 609) - side * below).abs() * 16 <= 4 * below;
        if below > 0 && [-9, -3, 3, 9].into_iter().any(is_on_line) {
            return 225;
        }
        let grain = (u * 7919 + v * 104_729) % 31;
        grain + if below > 0 { 90 } else { 170 }
    };
    let pixels = (0..height).flat_map(|v| (0..width).flat_map(move |u| [gray(u, v) as u8; 3]));
    CameraImage {
        width_px: width as u32,
        height_px: height as u32,
        rgb: pixels.collect(),
    }
}

#[test]
fn the_lane_network_agrees_with_pytorch() {
    let card = card(LANE_MODEL);
    let Network::Ufld(spec) = &card.network else {
        panic!("not a lane network");
    };
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    let mut network =
        LaneNetwork::open(&runtime, &card, spec, SessionSettings::cpu(1)).expect("network");
    let size = [spec.image_width_px, spec.image_height_px].map(|side| side as usize);
    let mut resize = Resize::new(size, network.input_size(), spec.mean, spec.std);
    let reference = reference("lanes.json");
    resize.apply(&road_picture(), network.input_mut());
    network.run().expect("a run");
    let logits = network.logits();
    assert_alike(logits, &reference["cells"]);
    let marks = decode(logits, spec.grid_cells, spec.image_width_px);
    let expected = reference["marks_px"].as_array().expect("marks");
    for (mark, expected) in marks.pixels.iter().zip(expected) {
        for (u, expected) in mark.iter().zip(expected.as_array().expect("rows")) {
            match (u, expected.as_f64()) {
                (Some(u), Some(expected)) => assert!((f64::from(*u) - expected).abs() < 0.1),
                (u, expected) => assert!(u.is_none() && expected.is_none()),
            }
        }
    }
}
