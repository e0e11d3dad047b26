use std::path::Path;

use covista_world::Validate;
use rerun::ApplicationId;

use crate::rrd::RrdFile;
use crate::series::StateMemory;
use crate::{FocusFrame, SceneRecord, StepRecord, ViewerError};
use crate::{layout, objects, perception, scene, series};

/// The one timeline.
pub const TIMELINE: &str = "time";

/// A run's recording (.rrd) on its way to the disk.
///
/// It is written beside its place under another name; [`Recording::finish`] puts it there. A
/// recording that is dropped unfinished leaves nothing behind.
#[derive(Debug)]
pub struct Recording {
    file: RrdFile,
    scene: SceneRecord,
    states: StateMemory,
}

impl Recording {
    /// Begins the recording at `path` with its blueprint and all that does not change.
    ///
    /// # Errors
    /// When the folder can't be written.
    pub fn create(path: &Path, scene: SceneRecord) -> Result<Self, ViewerError> {
        let application = ApplicationId::new_or_unknown(format!("covista {}", scene.scenario));
        let recording = Self {
            file: RrdFile::create(path, application.clone(), &scene.run)?,
            scene,
            states: StateMemory::default(),
        };
        recording
            .log_static(application)
            .map_err(|error| recording.file.error(error))?;
        Ok(recording)
    }

    fn log_static(&self, application: ApplicationId) -> rerun::RecordingStreamResult<()> {
        layout::send_blueprint(&self.file.stream, application, &self.scene)?;
        scene::log_scene(&self.file.stream, &self.scene)?;
        objects::log_bodies(&self.file.stream, &self.scene)?;
        perception::log_mounting(&self.file.stream, &self.scene.calibration, true)?;
        series::log_styles(&self.file.stream, &self.scene)
    }

    /// Adds one instant. Every 0.1 s is smooth; each perception frame costs some 0.4 MB.
    ///
    /// # Errors
    /// When a number is not finite, an image has the wrong size, or rerun refuses the message.
    pub fn log_step(&mut self, step: &StepRecord) -> Result<(), ViewerError> {
        check(step)?;
        self.log_checked(step)
            .map_err(|error| self.file.error(error))
    }

    fn log_checked(&mut self, step: &StepRecord) -> rerun::RecordingStreamResult<()> {
        self.file.stream.set_duration_secs(TIMELINE, step.time_s);
        objects::log_vehicles(&self.file.stream, &self.scene, step)?;
        if let Some(frame) = &step.focus {
            perception::log_focus(&self.file.stream, &self.scene, frame, step.time_s)?;
        }
        series::log_series(&self.file.stream, &self.scene, step, &mut self.states)
    }

    /// Completes the file and puts it in its place.
    ///
    /// # Errors
    /// When it can't be written to the end, as on a full disk.
    pub fn finish(self) -> Result<(), ViewerError> {
        self.file.finish()
    }
}

/// The boundary of this crate: only what can be drawn gets in.
fn check(step: &StepRecord) -> Result<(), ViewerError> {
    let bad = |what: String| ViewerError::BadRecord {
        time_s: step.time_s,
        what,
    };
    let finite = |what: &str, values: &[f64]| {
        if values.iter().all(|value| value.is_finite()) {
            Ok(())
        } else {
            Err(bad(format!("{what} is not finite")))
        }
    };
    finite("its time", &[step.time_s])?;
    for vehicle in &step.vehicles {
        let pose = vehicle.pose;
        finite(
            &format!("the state of vehicle {}", vehicle.id),
            &[
                pose.x_m,
                pose.y_m,
                pose.yaw_rad,
                vehicle.speed_mps,
                vehicle.accel_mps2,
            ],
        )?;
    }
    match &step.focus {
        None => Ok(()),
        Some(frame) => check_frame(frame, step.time_s),
    }
}

/// The same for what sensors measured and networks found.
pub fn check_frame(frame: &FocusFrame, time_s: f64) -> Result<(), ViewerError> {
    let bad = |what: String| ViewerError::BadRecord { time_s, what };
    let finite = |what: &str, values: &[f64]| {
        if values.iter().all(|value| value.is_finite()) {
            Ok(())
        } else {
            Err(bad(format!("{what} is not finite")))
        }
    };
    finite(
        "the pose of the perception frame",
        &[frame.pose.x_m, frame.pose.y_m, frame.pose.yaw_rad],
    )?;
    if let Some(image) = &frame.image {
        image.validate().map_err(|error| bad(error.to_string()))?;
    }
    for point in frame.marks.iter().flatten().flatten() {
        finite("a mark", point)?;
    }
    if let Some(cloud) = &frame.cloud {
        cloud.validate().map_err(|error| bad(error.to_string()))?;
    }
    let states = frame.boxes.iter().map(|seen| &seen.state);
    for state in states.chain(frame.tracks.iter().map(|track| &track.state)) {
        finite(
            "a box or track",
            &[
                state.center.x_m,
                state.center.y_m,
                state.center.yaw_rad,
                state.velocity_mps.x,
                state.velocity_mps.y,
                state.length_m,
                state.width_m,
                state.height_m,
            ],
        )?;
    }
    Ok(())
}
