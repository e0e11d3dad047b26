use std::path::{Path, PathBuf};

use covista_world::Validate;
use rerun::log::ChunkBatcherConfig;
use rerun::{ApplicationId, RecordingStream, RecordingStreamBuilder};

use crate::series::StateMemory;
use crate::{SceneRecord, StepRecord, ViewerError};
use crate::{layout, objects, perception, scene, series};

/// The one timeline.
pub const TIMELINE: &str = "time";

/// A rerun recording (.rrd) on its way to the disk.
///
/// It is written beside its place under another name; [`Recording::finish`] puts it there. A
/// recording that is dropped unfinished leaves nothing behind.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    partial: PathBuf,
    stream: RecordingStream,
    scene: SceneRecord,
    states: StateMemory,
}

impl Recording {
    /// Begins the recording at `path` with its blueprint and all that does not change.
    ///
    /// # Errors
    /// When the folder can't be written.
    pub fn create(path: &Path, scene: SceneRecord) -> Result<Self, ViewerError> {
        let partial = path.with_extension("rrd.part");
        // Found out here, because rerun writes in a thread of its own.
        std::fs::File::create(&partial).map_err(|source| ViewerError::Write {
            path: path.to_owned(),
            source,
        })?;
        let application = ApplicationId::new_or_unknown(format!("covista {}", scene.scenario));
        let stream = RecordingStreamBuilder::new(application.clone())
            .recording_name(scene.run.as_str())
            // Few large chunks, however slowly the steps come.
            .batcher_config(ChunkBatcherConfig {
                flush_tick: std::time::Duration::from_secs(3600),
                ..ChunkBatcherConfig::DEFAULT
            })
            .save(&partial)
            .map_err(|error| ViewerError::record(path, error))?;
        let recording = Self {
            path: path.to_owned(),
            partial,
            stream,
            scene,
            states: StateMemory::default(),
        };
        recording
            .log_static(application)
            .map_err(|error| ViewerError::record(path, error))?;
        Ok(recording)
    }

    fn log_static(&self, application: ApplicationId) -> rerun::RecordingStreamResult<()> {
        layout::send_blueprint(&self.stream, application, &self.scene)?;
        scene::log_scene(&self.stream, &self.scene)?;
        objects::log_bodies(&self.stream, &self.scene)?;
        perception::log_mounting(&self.stream, &self.scene.calibration)?;
        series::log_styles(&self.stream, &self.scene)
    }

    /// Adds one instant. Every 0.1 s is smooth; each perception frame costs some 0.4 MB.
    ///
    /// # Errors
    /// When a number is not finite, an image has the wrong size, or rerun refuses the message.
    pub fn log_step(&mut self, step: &StepRecord) -> Result<(), ViewerError> {
        check(step)?;
        self.log_checked(step)
            .map_err(|error| ViewerError::record(&self.path, error))
    }

    fn log_checked(&mut self, step: &StepRecord) -> rerun::RecordingStreamResult<()> {
        self.stream.set_duration_secs(TIMELINE, step.time_s);
        objects::log_vehicles(&self.stream, &self.scene, step)?;
        if let Some(frame) = &step.focus {
            perception::log_focus(&self.stream, &self.scene, frame, step.time_s)?;
        }
        series::log_series(&self.stream, &self.scene, step, &mut self.states)
    }

    /// Completes the file and puts it in its place.
    ///
    /// # Errors
    /// When it can't be written to the end, as on a full disk.
    pub fn finish(self) -> Result<(), ViewerError> {
        self.stream
            .flush_blocking()
            .map_err(|error| ViewerError::record(&self.path, error))?;
        self.stream.disconnect();
        std::fs::rename(&self.partial, &self.path).map_err(|source| ViewerError::Write {
            path: self.path.clone(),
            source,
        })
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        if self.partial.exists() {
            self.stream.disconnect();
            // Nobody is left to be told when even this fails.
            std::fs::remove_file(&self.partial).ok();
        }
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
    let Some(frame) = &step.focus else {
        return Ok(());
    };
    finite(
        "the pose of the perception frame",
        &[frame.pose.x_m, frame.pose.y_m, frame.pose.yaw_rad],
    )?;
    if let Some(image) = &frame.image {
        image.validate().map_err(|error| bad(error.to_string()))?;
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
