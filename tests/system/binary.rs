use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};

/// The `covista` binary, run from the repository's root.
pub fn covista() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_covista"));
    command.current_dir(root());
    command
}

/// The repository's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Runs `command` and asserts that it ends with exit code 2 and exactly one line on stderr that
/// contains each of `parts`.
pub fn assert_one_line_error(command: &mut Command, parts: &[&str]) -> Output {
    let output = command.output().expect("covista starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "stderr: {stderr}");
    assert_eq!(stderr.trim_end().lines().count(), 1, "stderr: {stderr}");
    for part in parts {
        assert!(stderr.contains(part), "no {part:?} in: {stderr}");
    }
    output
}
