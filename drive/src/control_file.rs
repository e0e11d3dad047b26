use std::path::{Path, PathBuf};

use covista_control::{ControlSettings, SettingsError};

/// Why settings of the controller cannot be taken from a file.
#[derive(Debug, thiserror::Error)]
pub enum ControlFileError {
    /// It cannot be read.
    #[error("cannot read {path}: {source}; check the path given to --control")]
    Read {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        source: std::io::Error,
    },
    /// It is no TOML of these settings.
    #[error("{path}: {reason}; see docs/safety.md for the settings there are")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What is wrong, in one line.
        reason: String,
    },
    /// A setting is out of its range.
    #[error("{path}: {source}")]
    Settings {
        /// The file.
        path: PathBuf,
        /// Which one.
        source: SettingsError,
    },
}

/// The controller's settings in a TOML file; what it leaves out keeps its default.
///
/// # Errors
/// When the file cannot be read, has an unknown field or a setting out of its range.
pub fn load_control_settings(path: &Path) -> Result<ControlSettings, ControlFileError> {
    let text = std::fs::read_to_string(path).map_err(|source| ControlFileError::Read {
        path: path.to_owned(),
        source,
    })?;
    let settings: ControlSettings =
        toml::from_str(&text).map_err(|error| ControlFileError::Syntax {
            path: path.to_owned(),
            reason: error.message().lines().collect::<Vec<_>>().join(" "),
        })?;
    settings
        .validate()
        .map_err(|source| ControlFileError::Settings {
            path: path.to_owned(),
            source,
        })?;
    Ok(settings)
}
