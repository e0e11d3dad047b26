use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

use serde_json::Value;

use crate::binary::{assert_one_line_error, covista};

/// A sweep with one car for the tiny detector.
fn sweep(folder: &Path) -> PathBuf {
    let path = folder.join("one.bin");
    let point = [20.0_f32, 3.0, -1.0, 0.4].map(f32::to_le_bytes).concat();
    fs::write(&path, point.repeat(40)).expect("written");
    path
}

/// `covista eval detector` on one sweep, on the provider that is named.
fn eval(sweep: &Path, provider: &str) -> Command {
    let mut command = covista();
    command.args(["eval", "detector", "--models", "perception/tests/fixtures"]);
    command.args(["--provider", provider, "--data"]).arg(sweep);
    command
}

/// ONNX Runtime as covista fetches it.
fn onnx_runtime() -> PathBuf {
    let verified = covista().args(["models", "verify"]).output();
    assert!(verified.expect("covista starts").status.success());
    let variable = |name| env::var_os(name).map(PathBuf::from);
    variable("ORT_DYLIB_PATH").unwrap_or_else(|| {
        let cache = variable("COVISTA_CACHE")
            .or_else(|| Some(variable("XDG_CACHE_HOME")?.join("covista")))
            .or_else(|| Some(variable("HOME")?.join(".cache/covista")));
        let folder = cache.expect("a cache").join("onnxruntime-1.31.1");
        folder.join("libonnxruntime.so.1.31.1")
    })
}

#[test]
fn a_provider_that_is_not_there_is_refused_before_the_first_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = sweep(folder.path());
    assert_one_line_error(
        &mut eval(&sweep, "tpu"),
        &["`tpu` is no provider", "cpu, openvino, cuda or auto"],
    );
    assert_one_line_error(
        eval(&sweep, "cuda").env("ORT_DYLIB_PATH", onnx_runtime()),
        &[
            "cuda is not available",
            "built without it",
            "ORT_DYLIB_PATH",
            "provider cpu",
        ],
    );
    assert_one_line_error(
        eval(&sweep, "openvino").env("COVISTA_OPENVINO_PLUGIN", &sweep),
        &["one.bin", "COVISTA_OPENVINO_PLUGIN", "provider cpu"],
    );
    let fetched_without_python = eval(&sweep, "openvino")
        .env("ORT_DYLIB_PATH", onnx_runtime())
        .env("COVISTA_CACHE", folder.path().join("cache"))
        .env("PATH", folder.path())
        .output()
        .expect("covista starts");
    let said = String::from_utf8_lossy(&fetched_without_python.stderr);
    assert_eq!(fetched_without_python.status.code(), Some(2), "{said}");
    let [progress, error] = said.lines().collect::<Vec<_>>()[..] else {
        panic!("{said}");
    };
    assert!(
        progress.contains("fetching onnxruntime-ep-openvino"),
        "{said}"
    );
    for part in [
        "python3 can't be run",
        "pip install onnxruntime-ep-openvino==1.8.1",
        "COVISTA_OPENVINO_PLUGIN",
    ] {
        assert!(error.contains(part), "{said}");
    }
    assert_one_line_error(
        covista().args(["demo", "--perception", "truth", "--provider", "openvino"]),
        &["--provider is for --perception network"],
    );
}

#[test]
fn auto_takes_the_fastest_that_is_there_fetches_nothing_and_says_which() {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = sweep(folder.path());
    let empty = folder.path().join("cache");
    let output = eval(&sweep, "auto")
        .env("ORT_DYLIB_PATH", onnx_runtime())
        .env("COVISTA_CACHE", &empty)
        .env_remove("COVISTA_OPENVINO_PLUGIN")
        .output()
        .expect("covista starts");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && said.contains("on the provider cpu"),
        "{said}"
    );
    assert!(!empty.exists());
}

/// OpenVINO is fetched as at any other run, and the process ends with its plugin loaded.
#[cfg(target_arch = "x86_64")]
#[test]
fn openvino_computes_and_the_rows_say_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let sweep = sweep(folder.path());
    let said = |provider: &str| {
        let output = eval(&sweep, provider).output().expect("covista starts");
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{stderr}");
        (String::from_utf8(output.stdout).expect("text"), stderr)
    };
    let (cpu, _) = said("cpu");
    let (openvino, _) = said("openvino");
    assert!(
        cpu.contains("car") && openvino.contains("car"),
        "{openvino}"
    );
    let (auto, chosen) = said("auto");
    assert_eq!(auto, openvino);
    assert!(chosen.contains("on the provider openvino"), "{chosen}");

    let data = folder.path().join("data");
    let mut dataset = covista();
    dataset.args(["dataset", "--frames", "1", "--seed", "3", "--out"]);
    let written = dataset.arg(&data).output();
    assert!(written.expect("covista starts").status.success());
    let json = folder.path().join("figures.json");
    for (what, provider) in [
        ("lanes", "openvino"),
        ("fusion", "openvino"),
        ("lanes", "cpu"),
    ] {
        let mut command = covista();
        command.args(["eval", what, "--models", "perception/tests/fixtures"]);
        command.args(["--provider", provider, "--data"]).arg(&data);
        let output = command.arg("--json").arg(&json).output();
        let output = output.expect("covista starts");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{stderr}");
        let text = fs::read_to_string(&json).expect("a file");
        let report: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(report["rows"][0]["provider"], provider);
    }
}
