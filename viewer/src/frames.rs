use std::path::Path;

use covista_world::{Calibration, StationId};
use rerun::ApplicationId;

use crate::objects::Class;
use crate::perception::{CAMERA, LIDAR, log_measured, log_mounting};
use crate::recording::check_frame;
use crate::rrd::RrdFile;
use crate::{FocusFrame, ViewerError};

/// Frames follow one another on this timeline, by number.
const TIMELINE: &str = "frame";

/// A recording of single frames: what was measured and what the networks found in it, in the
/// vehicle frame, with no road and no truth around it.
#[derive(Debug)]
pub struct FrameRecording {
    file: RrdFile,
    frames: u32,
}

impl FrameRecording {
    /// Begins the recording at `path`.
    ///
    /// # Errors
    /// When the folder can't be written.
    pub fn create(path: &Path, name: &str) -> Result<Self, ViewerError> {
        let application = ApplicationId::new_or_unknown("covista frames");
        let recording = Self {
            file: RrdFile::create(path, application, name)?,
            frames: 0,
        };
        let stream = &recording.file.stream;
        stream
            .log_static("world", &rerun::ViewCoordinates::RIGHT_HAND_Z_UP())
            .and_then(|()| stream.log_static("world", &Class::annotation_context()))
            .map_err(|error| recording.file.error(error))?;
        Ok(recording)
    }

    /// Adds a frame. Its pose is to be the origin, and `own` the station that saw its boxes.
    ///
    /// # Errors
    /// When a number is not finite, an image has the wrong size, or rerun refuses the message.
    pub fn log(
        &mut self,
        frame: &FocusFrame,
        calibration: &Calibration,
        own: StationId,
    ) -> Result<(), ViewerError> {
        check_frame(frame, f64::from(self.frames))?;
        self.log_checked(frame, calibration, own)
            .map_err(|error| self.file.error(error))?;
        self.frames += 1;
        Ok(())
    }

    fn log_checked(
        &self,
        frame: &FocusFrame,
        calibration: &Calibration,
        own: StationId,
    ) -> rerun::RecordingStreamResult<()> {
        let stream = &self.file.stream;
        stream.set_time_sequence(TIMELINE, i64::from(self.frames));
        // What this frame lacks must not stay from the one before.
        for sensor in [CAMERA, LIDAR] {
            stream.log(sensor, &rerun::Clear::recursive())?;
        }
        log_mounting(stream, calibration, false)?;
        log_measured(stream, frame, calibration, own)
    }

    /// Completes the file and puts it in its place.
    ///
    /// # Errors
    /// When it can't be written to the end, as on a full disk.
    pub fn finish(self) -> Result<(), ViewerError> {
        self.file.finish()
    }
}
