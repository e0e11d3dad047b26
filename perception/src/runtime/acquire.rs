//! Where ONNX Runtime comes from: the user's choice, the cache, or PyPI's wheel through pip.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use sha2::{Digest, Sha256};

use super::{RuntimeError, one_line};

/// The version that is fetched, and the oldest that works.
pub const ONNX_RUNTIME_VERSION: &str = "1.31.1";

/// A build of the library on PyPI. The wheels of all Python versions hold the same library, so
/// one Python version is asked for whatever the machine runs.
struct Build {
    platform: &'static str,
    sha256: &'static str,
}

/// The build for this machine, where there is one.
fn build() -> Option<Build> {
    match (env::consts::OS, env::consts::ARCH) {
        ("linux", "x86_64") => Some(Build {
            platform: "manylinux_2_28_x86_64",
            sha256: "fc44112fbe06d7d689c57e11d3862031f64711007e4ee020f8eed5185fd2c1d3",
        }),
        ("linux", "aarch64") => Some(Build {
            platform: "manylinux_2_28_aarch64",
            sha256: "8aa3b76b28c778a2b1dd660d34161adb1d508c9ccd04ff9dc80e26eca5df8467",
        }),
        _ => None,
    }
}

/// The library to load, fetched if need be.
pub(super) fn locate(progress: &dyn Fn(&str)) -> Result<PathBuf, RuntimeError> {
    if let Some(chosen) = env::var_os("ORT_DYLIB_PATH").filter(|path| !path.is_empty()) {
        return Ok(chosen.into());
    }
    let missing = |reason: String| RuntimeError::Missing { reason };
    let build = build().ok_or_else(|| {
        missing(format!(
            "no library is pinned for {} on {}",
            env::consts::OS,
            env::consts::ARCH
        ))
    })?;
    let cache =
        cache_folder().ok_or_else(|| missing("neither COVISTA_CACHE nor HOME is set".into()))?;
    cached(&cache, build.sha256, progress, &|into| fetch(&build, into)).map_err(missing)
}

/// `COVISTA_CACHE`, else `XDG_CACHE_HOME/covista`, else `~/.cache/covista`.
fn cache_folder() -> Option<PathBuf> {
    let folder = |name| {
        env::var_os(name)
            .filter(|path| !path.is_empty())
            .map(PathBuf::from)
    };
    folder("COVISTA_CACHE")
        .or_else(|| Some(folder("XDG_CACHE_HOME")?.join("covista")))
        .or_else(|| Some(folder("HOME")?.join(".cache/covista")))
}

/// The library in `cache` if it is whole, else the one that `fetch` puts into the folder it is
/// given, verified and moved into `cache` in one step.
fn cached(
    cache: &Path,
    sha256: &str,
    progress: &dyn Fn(&str),
    fetch: &dyn Fn(&Path) -> Result<PathBuf, String>,
) -> Result<PathBuf, String> {
    let folder = cache.join(format!("onnxruntime-{ONNX_RUNTIME_VERSION}"));
    let library = folder.join(library_name());
    if fs::read(&library).is_ok_and(|bytes| hex_sha256(&bytes) == sha256) {
        return Ok(library);
    }
    progress(&format!(
        "fetching ONNX Runtime {ONNX_RUNTIME_VERSION} with pip, once, into {}",
        folder.display()
    ));
    let cannot_write = |error: std::io::Error| format!("{}: {error}", folder.display());
    fs::create_dir_all(&folder).map_err(cannot_write)?;
    let temporary = tempfile::Builder::new()
        .prefix("fetch-")
        .tempdir_in(&folder)
        .map_err(cannot_write)?;
    let fetched = fetch(temporary.path())?;
    let bytes = fs::read(&fetched).map_err(|error| format!("{}: {error}", fetched.display()))?;
    let found = hex_sha256(&bytes);
    if found != sha256 {
        return Err(format!(
            "what was fetched has SHA-256 {found}, not {sha256}"
        ));
    }
    fs::rename(&fetched, &library).map_err(cannot_write)?;
    Ok(library)
}

/// Downloads and unpacks PyPI's wheel in `folder`; returns the library.
fn fetch(build: &Build, folder: &Path) -> Result<PathBuf, String> {
    let package = format!("onnxruntime=={ONNX_RUNTIME_VERSION}");
    python(
        "pip download",
        Command::new("python3")
            .args(["-m", "pip", "download", "--quiet", "--no-input"])
            .args([
                "--disable-pip-version-check",
                "--retries",
                "2",
                "--timeout",
                "20",
            ])
            .args(["--no-deps", "--only-binary=:all:"])
            .args(["--implementation", "cp", "--python-version", "3.11"])
            .args(["--abi", "cp311", "--platform", build.platform])
            .arg("--dest")
            .arg(folder)
            .arg(package),
    )?;
    let wheel = fs::read_dir(folder)
        .map_err(|error| error.to_string())?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .find(|path| path.extension() == Some(OsStr::new("whl")))
        .ok_or("pip download left no wheel")?;
    python(
        "unpacking the wheel",
        Command::new("python3")
            .args(["-m", "zipfile", "-e"])
            .args([wheel.as_path(), folder]),
    )?;
    Ok(folder.join("onnxruntime/capi").join(library_name()))
}

fn library_name() -> String {
    format!("libonnxruntime.so.{ONNX_RUNTIME_VERSION}")
}

/// Runs a Python command silently; `what` and its last line of output say why it failed.
fn python(what: &str, command: &mut Command) -> Result<(), String> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("python3 can't be run: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    let stderr = String::from_utf8_lossy(&output.stderr);
    let last = stderr.lines().rfind(|line| !line.trim().is_empty());
    Err(format!(
        "{what} failed: {}",
        one_line(last.unwrap_or("it says nothing"))
    ))
}

/// SHA-256 of `bytes` in lower-case hexadecimal.
pub(crate) fn hex_sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    fn write_library(content: &'static str) -> impl Fn(&Path) -> Result<PathBuf, String> {
        move |folder| {
            let path = folder.join("library");
            fs::write(&path, content).map_err(|error| error.to_string())?;
            Ok(path)
        }
    }

    #[test]
    fn a_library_is_fetched_once_and_again_when_it_is_damaged() {
        let cache = tempfile::tempdir().unwrap();
        let sha256 = hex_sha256(b"library");
        let fetches = Cell::new(0);
        let get = || {
            cached(
                cache.path(),
                &sha256,
                &|_| fetches.set(fetches.get() + 1),
                &write_library("library"),
            )
        };
        let path = get().unwrap();
        assert!(path.ends_with("onnxruntime-1.31.1/libonnxruntime.so.1.31.1"));
        assert_eq!(get().unwrap(), path);
        assert_eq!(fetches.get(), 1);
        fs::write(&path, "cut").unwrap();
        assert_eq!(fs::read(get().unwrap()).unwrap(), b"library");
        assert_eq!(fetches.get(), 2);
        // Nothing but the library is left behind.
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
    }

    #[test]
    fn a_library_that_is_not_the_pinned_one_is_refused() {
        let cache = tempfile::tempdir().unwrap();
        let error = cached(
            cache.path(),
            &hex_sha256(b"library"),
            &|_| (),
            &write_library("other"),
        )
        .unwrap_err();
        assert!(error.starts_with("what was fetched has SHA-256"), "{error}");
    }

    #[test]
    fn without_library_and_network_one_line_says_how_to_get_it() {
        let cache = tempfile::tempdir().unwrap();
        let reason = cached(cache.path(), "", &|_| (), &|_| {
            Err("pip download failed: ERROR: No matching distribution found".into())
        })
        .unwrap_err();
        let message = RuntimeError::Missing { reason }.to_string();
        assert!(!message.contains('\n'));
        assert!(message.contains("No matching distribution"), "{message}");
        assert!(
            message.contains("pip install onnxruntime==1.31.1"),
            "{message}"
        );
        assert!(message.contains("ORT_DYLIB_PATH"), "{message}");
    }

    #[test]
    fn a_missing_python_is_named() {
        let error = python("pip", &mut Command::new("/nonexistent/python3")).unwrap_err();
        assert!(error.starts_with("python3 can't be run"), "{error}");
    }

    #[test]
    fn the_last_line_of_a_failure_is_kept() {
        let script = "import sys; print('first\\nlast  reason', file=sys.stderr); sys.exit(1)";
        let error = python("pip", Command::new("python3").args(["-c", script])).unwrap_err();
        assert_eq!(error, "pip failed: last reason");
    }
}
