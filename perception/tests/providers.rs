//! What computes a network: the providers beside each other, on tiny networks. OpenVINO's plugin
//! is found or fetched as at any other run.

#![cfg(all(target_os = "linux", target_arch = "x86_64"))]
#![allow(clippy::expect_used)]

use std::{collections::HashMap, fs, path::PathBuf};

use covista_perception::{
    Detector, LaneFinder, OnnxRuntime, Perceiver, Provider, ProviderChoice, SessionSettings,
};
use covista_world::{CameraImage, PointCloud};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn fixtures() -> PathBuf {
    root().join("perception/tests/fixtures")
}

fn picture() -> CameraImage {
    let hash = |at: usize| (at.wrapping_mul(0x9E37_79B9) >> 13) as u8;
    CameraImage {
        width_px: 1242,
        height_px: 375,
        rgb: (0..3 * 1242 * 375).map(hash).collect(),
    }
}

fn openvino(threads: usize) -> (OnnxRuntime, SessionSettings) {
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    let choice = ProviderChoice::Only(Provider::OpenVino);
    let provider = runtime.provide(choice, &|_| ()).expect("OpenVINO");
    assert_eq!(provider, Provider::OpenVino);
    (runtime, SessionSettings { provider, threads })
}

/// Plugins are loaded for the whole process and other tests compute in it at the same time: whether
/// this process has the test `name` alone, which otherwise was run in one that has.
fn is_alone(name: &str) -> bool {
    const ALONE: &str = "COVISTA_TEST_ALONE";
    if std::env::var_os(ALONE).is_some() {
        return true;
    }
    let this = std::env::current_exe().expect("this program");
    let output = std::process::Command::new(this)
        .args(["--exact", name])
        .env(ALONE, "1")
        .output()
        .expect("started");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && said.contains("1 passed"),
        "{said}"
    );
    false
}

#[test]
fn the_cpu_provider_stays_the_cpu_provider_when_openvino_is_loaded() {
    if !is_alone("the_cpu_provider_stays_the_cpu_provider_when_openvino_is_loaded") {
        return;
    }
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    let picture = picture();
    let marks = || {
        let models = root().join("models");
        let settings = SessionSettings::cpu(1);
        let mut finder =
            LaneFinder::open(&runtime, &models, "ufld-resnet18", settings).expect("a network");
        assert_eq!(finder.provider(), Provider::Cpu);
        finder.find_marks(&picture).expect("marks")
    };
    let before = marks();
    openvino(1);
    assert_eq!(marks(), before);
}

#[test]
fn both_networks_see_the_same_on_openvino() {
    let (runtime, settings) = openvino(2);
    let points = PointCloud {
        points: vec![[20.0, 3.0, -1.0, 0.4]; 40],
    };
    let found = |settings| {
        let mut perceiver = Perceiver::new(&runtime, &fixtures(), settings).expect("networks");
        assert_eq!(perceiver.provider(), settings.provider);
        (
            perceiver.find_marks(&picture()).expect("marks"),
            perceiver.detect(&points).expect("boxes"),
        )
    };
    let (cpu_marks, cpu_boxes) = found(SessionSettings::cpu(2));
    let (marks, boxes) = found(settings);
    assert_eq!((boxes.len(), cpu_boxes.len()), (1, 1));
    assert!((boxes[0].center_m - cpu_boxes[0].center_m).norm() < 0.02);
    for (a, b) in marks
        .pixels
        .iter()
        .flatten()
        .zip(cpu_marks.pixels.iter().flatten())
    {
        let (Some(a), Some(b)) = (a, b) else {
            panic!("{a:?} {b:?}");
        };
        assert!((a - b).abs() < 1.0, "{a} {b}");
    }
}

/// How long each thread of this process has computed, in nanoseconds.
fn computed() -> HashMap<String, u64> {
    let tasks = fs::read_dir("/proc/self/task").expect("threads");
    let of_task = |entry: fs::DirEntry| {
        let text = fs::read_to_string(entry.path().join("schedstat")).ok()?;
        let time = text.split(' ').next()?.parse().ok()?;
        Some((entry.file_name().into_string().ok()?, time))
    };
    tasks.filter_map(|entry| of_task(entry.ok()?)).collect()
}

#[test]
fn one_thread_is_one_thread() {
    if !is_alone("one_thread_is_one_thread") {
        return;
    }
    for settings in [openvino(1).1, SessionSettings::cpu(1)] {
        let (runtime, _) = openvino(1);
        let models = root().join("models");
        let mut finder =
            LaneFinder::open(&runtime, &models, "ufld-resnet18", settings).expect("a network");
        let picture = picture();
        let before = computed();
        for _ in 0..10 {
            finder.find_marks(&picture).expect("marks");
        }
        let after = computed();
        let mut spent: Vec<u64> = after
            .iter()
            .map(|(task, time)| time - before.get(task).copied().unwrap_or(0))
            .collect();
        spent.sort_unstable();
        let most = spent.pop().expect("a thread");
        let others: u64 = spent.iter().sum();
        assert!(most > 20 * others, "{settings:?}: {most} and {others} ns");
    }
}

#[test]
fn a_provider_that_was_not_made_ready_is_refused() {
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    let settings = SessionSettings {
        provider: Provider::Cuda,
        threads: 1,
    };
    let error = Detector::open(&runtime, &fixtures(), "pointpillars", settings);
    let message = error.expect_err("refused").to_string();
    assert!(
        message.starts_with("the provider cuda can't compute the model")
            && message.ends_with("choose the provider cpu")
            && !message.contains('\n'),
        "{message}"
    );
    let error = runtime.provide(ProviderChoice::Only(Provider::Cuda), &|_| ());
    let message = error.expect_err("refused").to_string();
    assert!(message.contains("built without it"), "{message}");
    let auto = runtime.provide(ProviderChoice::Auto, &|message| panic!("{message}"));
    assert_ne!(auto.expect("a provider"), Provider::Cuda);
}
