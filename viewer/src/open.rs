use std::path::Path;
use std::process::{Command, Stdio};

use crate::ViewerError;

/// The viewer's version that is sure to read our files: that of the crate we write them with.
const VERSION: &str = "0.36.3";

/// Shows recordings in rerun's viewer, which goes on after this process has ended.
///
/// # Errors
/// When a recording isn't there, or pip's viewer of the right version isn't.
pub fn open_viewer(paths: &[impl AsRef<Path>]) -> Result<(), ViewerError> {
    for path in paths.iter().map(AsRef::as_ref) {
        if !path.is_file() {
            return Err(ViewerError::NoRecording(path.to_owned()));
        }
    }
    find_viewer()?
        // Nobody but this machine shall be able to send to it.
        .args(["--bind", "127.0.0.1"])
        .args(paths.iter().map(AsRef::as_ref))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map(drop)
        .map_err(|error| no_viewer(format!("rerun's viewer does not start ({error})")))
}

/// `rerun` on the PATH, or else the module of the machine's Python.
fn find_viewer() -> Result<Command, ViewerError> {
    let candidates: [&[&str]; 2] = [&["rerun"], &["python3", "-m", "rerun"]];
    let mut found = "there is no rerun viewer on this machine".to_owned();
    for candidate in candidates {
        let [program, arguments @ ..] = candidate else {
            continue;
        };
        let mut command = Command::new(program);
        command.args(arguments);
        let Some(version) = version_of(program, arguments) else {
            continue;
        };
        if version == VERSION {
            return Ok(command);
        }
        found = format!("`{}` is of version {version}", candidate.join(" "));
    }
    Err(no_viewer(found))
}

/// The word after `rerun-cli` in the answer to `--version`.
fn version_of(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(program)
        .args(arguments)
        .arg("--version")
        .stdin(Stdio::null())
        .output()
        .ok()?;
    let answer = String::from_utf8_lossy(&output.stdout);
    output
        .status
        .success()
        .then(|| {
            let mut words = answer.split_whitespace();
            words.find(|word| *word == "rerun-cli")?;
            words.next().map(str::to_owned)
        })
        .flatten()
}

fn no_viewer(found: String) -> ViewerError {
    ViewerError::NoViewer {
        found,
        version: VERSION,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_recording_is_named() {
        let message = open_viewer(&["/nowhere/run.rrd"])
            .expect_err("there is none")
            .to_string();
        assert!(message.contains("/nowhere/run.rrd"), "{message}");
    }

    #[test]
    fn a_missing_viewer_says_how_to_get_it() {
        let message = no_viewer("there is no rerun viewer on this machine".to_owned()).to_string();
        assert_eq!(
            message,
            "there is no rerun viewer on this machine: install rerun's viewer with \
             `pip install rerun-sdk==0.36.3`"
        );
    }
}
