use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use anyhow::Context;
use serde::Serialize;

/// Makes sure that `folder` is there and can be written to, before any work is done.
pub fn prepare_folder(folder: &Path) -> anyhow::Result<()> {
    let attempt = || -> std::io::Result<()> {
        fs::create_dir_all(folder)?;
        let probe = folder.join(".covista-write-test");
        fs::write(&probe, b"")?;
        fs::remove_file(&probe)
    };
    attempt().with_context(|| {
        format!(
            "cannot write to the output folder {}; choose another with --out",
            folder.display()
        )
    })
}

/// Makes sure that `file` can be written to, before any work is done.
pub fn prepare_file(file: &Path) -> anyhow::Result<()> {
    let attempt = || -> std::io::Result<()> {
        if !is_replaceable(file) {
            return fs::OpenOptions::new().write(true).open(file).map(drop);
        }
        let partial = partial_path(file);
        fs::write(&partial, b"")?;
        fs::remove_file(&partial)
    };
    attempt().with_context(|| format!("cannot write {}; choose another place", file.display()))
}

/// Prints a line for the user; whoever reads it may stop reading at any time.
pub fn say(text: &str) -> anyhow::Result<()> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(error).context("cannot write to the terminal")
        }
        _ => Ok(()),
    }
}

/// Whether a new file may take the place of `path`: not of a device, a pipe or a link.
fn is_replaceable(path: &Path) -> bool {
    fs::symlink_metadata(path).map_or(true, |found| found.is_file())
}

/// Writes `bytes` to `path` whole or not at all; into a device, a pipe or the target of a link as
/// they come.
pub fn write_whole(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    if !is_replaceable(path) {
        return fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()));
    }
    let partial = partial_path(path);
    let attempt = || -> std::io::Result<()> {
        let mut file = fs::File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&partial, path)
    };
    attempt()
        .inspect_err(|_| {
            let _ = fs::remove_file(&partial);
        })
        .with_context(|| format!("cannot write {}", path.display()))
}

fn partial_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".partial");
    PathBuf::from(name)
}

/// Writes `value` as indented JSON, whole or not at all.
pub fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let mut text = serde_json::to_vec_pretty(value)?;
    text.push(b'\n');
    write_whole(path, &text)
}

/// What `--json` writes: the command, the version, the machine and the rows.
#[derive(Serialize)]
pub struct Report<R> {
    command: String,
    version: &'static str,
    machine: Machine,
    #[serde(skip_serializing_if = "Option::is_none")]
    settings: Option<serde_json::Value>,
    rows: Vec<R>,
}

#[derive(Serialize)]
struct Machine {
    cpu: String,
    threads: usize,
}

impl<R: Serialize> Report<R> {
    /// A report of `rows` by `command` on this machine.
    pub fn new(command: impl Into<String>, rows: Vec<R>) -> Self {
        let cpu = fs::read_to_string("/proc/cpuinfo")
            .ok()
            .and_then(|text| {
                let line = text.lines().find(|line| line.starts_with("model name"))?;
                Some(line.split(':').nth(1)?.trim().to_owned())
            })
            .unwrap_or_else(|| std::env::consts::ARCH.to_owned());
        Self {
            command: command.into(),
            version: env!("CARGO_PKG_VERSION"),
            machine: Machine {
                cpu,
                threads: std::thread::available_parallelism().map_or(1, Into::into),
            },
            settings: None,
            rows,
        }
    }

    /// The report with how the rows were made.
    pub fn with_settings(self, settings: serde_json::Value) -> Self {
        Self {
            settings: Some(settings),
            ..self
        }
    }
}

/// The folder of the networks: the one named, `models` where the command runs, or the one beside
/// the sources this binary was built from.
pub fn models_folder(named: Option<&Path>) -> PathBuf {
    match named {
        Some(folder) => folder.to_owned(),
        None if Path::new("models").is_dir() => PathBuf::from("models"),
        None => Path::new(env!("CARGO_MANIFEST_DIR")).join("../models"),
    }
}
