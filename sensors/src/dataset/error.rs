use std::path::Path;

use crate::mcap::McapError;

/// Why a data set can't be written, or not to its end.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The file system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: String,
        /// Its reason.
        source: std::io::Error,
    },
    /// More frames than file names have numbers for.
    #[error(
        "{frames} frames from number {start} on are too many: file names have six digits; stay below 1000000"
    )]
    TooMany {
        /// Number of the first frame.
        start: u64,
        /// Frames that were asked for.
        frames: u64,
    },
    /// The folder holds something else.
    #[error("{path} holds {what}; choose another folder or remove it")]
    Foreign {
        /// The folder.
        path: String,
        /// What it holds.
        what: &'static str,
    },
    /// Another process writes into the folder.
    #[error("another process is writing into {path}; wait for it or choose another folder")]
    Busy {
        /// The folder.
        path: String,
    },
    /// A frame can't be put in its file format.
    #[error("frame {frame}: {what}")]
    Encoding {
        /// Number of the frame.
        frame: u64,
        /// What failed.
        what: String,
    },
    /// The frames can't be joined into MCAP.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// It was asked to stop.
    #[error(
        "stopped: {done} of {frames} frames in {path} are finished and listed; the same command goes on from there"
    )]
    Stopped {
        /// The folder.
        path: String,
        /// Frames that are there.
        done: usize,
        /// Frames that were asked for.
        frames: usize,
    },
}

pub(super) fn io_error(path: &Path) -> impl Fn(std::io::Error) -> DatasetError {
    let path = path.display().to_string();
    move |source| DatasetError::Io {
        path: path.clone(),
        source,
    }
}

pub(super) fn encoding<E: std::fmt::Display>(frame: u64) -> impl Fn(E) -> DatasetError {
    move |error| DatasetError::Encoding {
        frame,
        what: error.to_string(),
    }
}
