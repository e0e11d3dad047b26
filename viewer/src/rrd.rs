use std::path::{Path, PathBuf};

use rerun::log::ChunkBatcherConfig;
use rerun::{ApplicationId, RecordingStream, RecordingStreamBuilder};

use crate::ViewerError;

/// An .rrd file that is written beside its place and put there when it is complete; dropped
/// before, it leaves nothing behind.
#[derive(Debug)]
pub struct RrdFile {
    path: PathBuf,
    partial: PathBuf,
    pub stream: RecordingStream,
}

impl RrdFile {
    /// Begins the recording `name` at `path`.
    pub fn create(
        path: &Path,
        application: ApplicationId,
        name: &str,
    ) -> Result<Self, ViewerError> {
        let partial = path.with_extension("rrd.part");
        // Found out here, because rerun writes in a thread of its own.
        std::fs::File::create(&partial).map_err(|source| ViewerError::Write {
            path: path.to_owned(),
            source,
        })?;
        let stream = RecordingStreamBuilder::new(application)
            .recording_name(name)
            // Few large chunks, however slowly the steps come.
            .batcher_config(ChunkBatcherConfig {
                flush_tick: std::time::Duration::from_secs(3600),
                ..ChunkBatcherConfig::DEFAULT
            })
            .save(&partial)
            .map_err(|error| ViewerError::record(path, error))?;
        Ok(Self {
            path: path.to_owned(),
            partial,
            stream,
        })
    }

    /// An error of rerun's about this file.
    pub fn error(&self, reason: impl std::fmt::Display) -> ViewerError {
        ViewerError::record(&self.path, reason)
    }

    /// Completes the file and puts it in its place.
    pub fn finish(self) -> Result<(), ViewerError> {
        self.stream
            .flush_blocking()
            .map_err(|error| self.error(error))?;
        self.stream.disconnect();
        std::fs::rename(&self.partial, &self.path).map_err(|source| ViewerError::Write {
            path: self.path.clone(),
            source,
        })
    }
}

impl Drop for RrdFile {
    fn drop(&mut self) {
        if self.partial.exists() {
            self.stream.disconnect();
            // Nobody is left to be told when even this fails.
            std::fs::remove_file(&self.partial).ok();
        }
    }
}
