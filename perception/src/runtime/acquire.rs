//! Where ONNX Runtime and its plugins come from: the user's choice, the cache, or PyPI's wheel
//! through pip.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use sha2::{Digest, Sha256};

use super::one_line;

/// The version that is fetched, and the oldest that works.
pub const ONNX_RUNTIME_VERSION: &str = "1.31.1";
/// The version of OpenVINO's plugin that is fetched.
pub(super) const OPENVINO_VERSION: &str = "1.8.1";

/// Libraries in a wheel on PyPI, pinned.
pub(super) struct Package {
    /// What the user may choose another library with.
    variable: &'static str,
    name: &'static str,
    version: &'static str,
    /// Where in the wheel the libraries lie.
    folder: &'static str,
    /// The builds for the machines there are builds for.
    builds: &'static [Build],
}

struct Build {
    arch: &'static str,
    platform: &'static str,
    /// Name and SHA-256 of each file, the library to load first.
    files: &'static [(&'static str, &'static str)],
}

/// The wheels of all Python versions hold the same library, so one Python version is asked for
/// whatever the machine runs.
pub(super) const ONNX_RUNTIME: Package = Package {
    variable: "ORT_DYLIB_PATH",
    name: "onnxruntime",
    version: ONNX_RUNTIME_VERSION,
    folder: "onnxruntime/capi",
    builds: &[
        Build {
            arch: "x86_64",
            platform: "manylinux_2_28_x86_64",
            files: &[(
                "libonnxruntime.so.1.31.1",
                "fc44112fbe06d7d689c57e11d3862031f64711007e4ee020f8eed5185fd2c1d3",
            )],
        },
        Build {
            arch: "aarch64",
            platform: "manylinux_2_28_aarch64",
            files: &[(
                "libonnxruntime.so.1.31.1",
                "8aa3b76b28c778a2b1dd660d34161adb1d508c9ccd04ff9dc80e26eca5df8467",
            )],
        },
    ],
};

/// The plugin and what it needs of OpenVINO to compute on processors.
pub(super) const OPENVINO: Package = Package {
    variable: "COVISTA_OPENVINO_PLUGIN",
    name: "onnxruntime-ep-openvino",
    version: OPENVINO_VERSION,
    folder: "onnxruntime_ep_openvino",
    builds: &[Build {
        arch: "x86_64",
        platform: "manylinux_2_28_x86_64",
        files: &[
            (
                "libonnxruntime_providers_openvino_plugin.so",
                "99644306dea90173d2fac5e2ad8d10c9574ecf6e6e71ca30e426531abd5a717f",
            ),
            (
                "libopenvino.so.2641",
                "9b9a80ac1f18e07b13ed54459d9a865bcfe9dc170dbf8fe740c2974b85ecedc1",
            ),
            (
                "libopenvino_intel_cpu_plugin.so",
                "6599e3dd300d047b5ed72f8e48101c5f312c25321f35f57f803641ff8372900b",
            ),
            (
                "libopenvino_onnx_frontend.so.2641",
                "82d499f5b5e8514def7aaa1ecd5a9f570542d33ae9d00a0077f707cccd0e0192",
            ),
            (
                "libtbb.so.12",
                "ac9518497a4f2cb6729792730f145ee58367316031511923fef263c9ac81ca61",
            ),
        ],
    }],
};

impl Package {
    /// The library that the user names.
    fn chosen(&self) -> Option<PathBuf> {
        let path = env::var_os(self.variable).filter(|path| !path.is_empty())?;
        Some(path.into())
    }

    /// The build for this machine.
    fn build(&self) -> Result<&'static Build, String> {
        let (os, arch) = (env::consts::OS, env::consts::ARCH);
        let builds: &'static [Build] = self.builds;
        builds
            .iter()
            .find(|build| os == "linux" && build.arch == arch)
            .ok_or_else(|| format!("no library is pinned for {os} on {arch}"))
    }

    fn cache(&self) -> Result<PathBuf, String> {
        let cache = cache_folder().ok_or("neither COVISTA_CACHE nor HOME is set")?;
        Ok(cache.join(format!("{}-{}", self.name, self.version)))
    }

    /// The library to load, where it is on this machine.
    pub(super) fn present(&self) -> Option<PathBuf> {
        let cached = || whole(&self.cache().ok()?, self.build().ok()?);
        self.chosen().or_else(cached)
    }

    /// The library to load, fetched if need be; `progress` is told before.
    pub(super) fn locate(&self, progress: &dyn Fn(&str)) -> Result<PathBuf, String> {
        if let Some(chosen) = self.chosen() {
            return Ok(chosen);
        }
        let build = self.build()?;
        let folder = self.cache()?;
        cached(&folder, build, &|into| {
            progress(&format!(
                "fetching {} {} with pip, once, into {}",
                self.name,
                self.version,
                folder.display()
            ));
            self.fetch(build, into)
        })
    }

    /// Downloads and unpacks PyPI's wheel in `folder`; returns where its libraries lie.
    fn fetch(&self, build: &Build, folder: &Path) -> Result<PathBuf, String> {
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
                .arg(format!("{}=={}", self.name, self.version)),
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
        Ok(folder.join(self.folder))
    }
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

/// The library to load of a `build` in `folder`, where all its files are as pinned.
fn whole(folder: &Path, build: &Build) -> Option<PathBuf> {
    let is_whole = |(name, sha256): &(&str, &str)| {
        fs::read(folder.join(name)).is_ok_and(|bytes| hex_sha256(&bytes) == *sha256)
    };
    let (library, _) = build.files.first()?;
    build
        .files
        .iter()
        .all(is_whole)
        .then(|| folder.join(library))
}

/// The library to load in `folder` if it is whole there, else what `fetch` puts into the folder
/// it is given and says where, verified and moved into `folder` file by file.
fn cached(
    folder: &Path,
    build: &Build,
    fetch: &dyn Fn(&Path) -> Result<PathBuf, String>,
) -> Result<PathBuf, String> {
    if let Some(library) = whole(folder, build) {
        return Ok(library);
    }
    let cannot_write = |error: std::io::Error| format!("{}: {error}", folder.display());
    fs::create_dir_all(folder).map_err(cannot_write)?;
    let temporary = tempfile::Builder::new()
        .prefix("fetch-")
        .tempdir_in(folder)
        .map_err(cannot_write)?;
    let fetched = fetch(temporary.path())?;
    for (name, sha256) in build.files {
        let path = fetched.join(name);
        let bytes = fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        let found = hex_sha256(&bytes);
        if found != *sha256 {
            return Err(format!(
                "the {name} that was fetched has SHA-256 {found}, not {sha256}"
            ));
        }
        fs::rename(&path, folder.join(name)).map_err(cannot_write)?;
    }
    let (library, _) = build.files.first().ok_or("nothing is pinned")?;
    Ok(folder.join(library))
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

    /// Two files, with "first" and "second" in them.
    const BUILD: Build = Build {
        arch: "any",
        platform: "any",
        files: &[
            (
                "first.so",
                "a7937b64b8caa58f03721bb6bacf5c78cb235febe0e70b1b84cd99541461a08e",
            ),
            (
                "second.so",
                "16367aacb67a4a017c8da8ab95682ccb390863780f7114dda0a0e0c55644c7c4",
            ),
        ],
    };

    fn write(folder: &Path, contents: [&str; 2]) -> Result<PathBuf, String> {
        let inner = folder.join("inner");
        fs::create_dir(&inner).unwrap();
        for ((name, _), content) in BUILD.files.iter().zip(contents) {
            fs::write(inner.join(name), content).unwrap();
        }
        Ok(inner)
    }

    #[test]
    fn libraries_are_fetched_once_and_again_when_one_is_damaged() {
        let cache = tempfile::tempdir().unwrap();
        let folder = cache.path().join("package-1.0");
        let fetches = Cell::new(0);
        let get = || {
            cached(&folder, &BUILD, &|into| {
                fetches.set(fetches.get() + 1);
                write(into, ["first", "second"])
            })
        };
        assert_eq!(whole(&folder, &BUILD), None);
        assert_eq!(get().unwrap(), folder.join("first.so"));
        assert_eq!(get().unwrap(), folder.join("first.so"));
        assert_eq!(fetches.get(), 1);
        fs::write(folder.join("second.so"), "cut").unwrap();
        get().unwrap();
        assert_eq!(fs::read(folder.join("second.so")).unwrap(), b"second");
        assert_eq!(fetches.get(), 2);
        // Nothing but the libraries is left behind.
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
    }

    #[test]
    fn a_library_that_is_not_the_pinned_one_is_refused() {
        let cache = tempfile::tempdir().unwrap();
        let fetch = |into: &Path| write(into, ["first", "other"]);
        let error = cached(cache.path(), &BUILD, &fetch).unwrap_err();
        assert!(
            error.starts_with("the second.so that was fetched has SHA-256"),
            "{error}"
        );
        assert_eq!(whole(cache.path(), &BUILD), None);
    }

    #[test]
    fn without_library_and_network_one_line_says_how_to_get_it() {
        let cache = tempfile::tempdir().unwrap();
        let reason = cached(cache.path(), &BUILD, &|_| {
            Err("pip download failed: ERROR: No matching distribution found".into())
        })
        .unwrap_err();
        let message = super::super::RuntimeError::Missing { reason }.to_string();
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
