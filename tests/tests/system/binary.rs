use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::OnceLock,
};

/// The `covista` binary of this profile, built on first use.
pub fn covista() -> Command {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    let binary = BINARY.get_or_init(|| {
        let root = root();
        let built = Command::new(env!("CARGO"))
            .args([
                "build",
                "--release",
                "--quiet",
                "--package",
                "covista-app",
                "--locked",
            ])
            .current_dir(&root)
            .status()
            .expect("cargo starts");
        assert!(built.success(), "covista builds");
        std::env::var_os("CARGO_TARGET_DIR")
            .map_or_else(|| root.join("target"), PathBuf::from)
            .join("release/covista")
    });
    let mut command = Command::new(binary);
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
