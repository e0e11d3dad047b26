use std::path::PathBuf;

/// Why something can't be shown; each message says what, where and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ViewerError {
    /// The file can't be created, written or renamed.
    #[error("cannot write {}: {source}; choose another folder with --out", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// rerun refused a message.
    #[error("cannot record {}: {reason}", path.display())]
    Record {
        /// Which recording.
        path: PathBuf,
        /// What rerun says.
        reason: String,
    },
    /// A number in a record is not finite, or an image has the wrong size.
    #[error("the record at {time_s:.2} s can't be drawn: {what}")]
    BadRecord {
        /// Time of the step in seconds.
        time_s: f64,
        /// What is wrong.
        what: String,
    },
    /// A plot can't be drawn.
    #[error("cannot draw {}: {reason}", path.display())]
    Plot {
        /// Which picture.
        path: PathBuf,
        /// What plotters says.
        reason: String,
    },
    /// A recording that is to be shown isn't there.
    #[error("there is no recording {}: run the demo first", .0.display())]
    NoRecording(PathBuf),
    /// No viewer of the right version on this machine.
    #[error("{found}: install rerun's viewer with `pip install rerun-sdk=={version}`")]
    NoViewer {
        /// What was found instead.
        found: String,
        /// The version that reads our files.
        version: &'static str,
    },
}

impl ViewerError {
    pub(crate) fn record(path: &std::path::Path, reason: impl std::fmt::Display) -> Self {
        Self::Record {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }

    pub(crate) fn plot(path: &std::path::Path, reason: impl std::fmt::Display) -> Self {
        Self::Plot {
            path: path.to_owned(),
            reason: reason.to_string(),
        }
    }
}
