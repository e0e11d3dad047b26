use std::{
    path::Path,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use covista_perception::{
    FramePercepts, ModelError, OnnxRuntime, PerceiveError, Perceiver, Provider, SessionSettings,
};
use covista_world::{Calibration, SensorFrame};

/// Both networks, several times over, for frames that are perceived side by side. Clones share
/// them.
#[derive(Debug, Clone)]
pub struct Networks(Arc<[Mutex<Perceiver>]>);

impl Networks {
    /// Opens those of the folder `models` for `at_once` frames at a time, or 1, each on
    /// `settings.threads` threads.
    ///
    /// # Errors
    /// When a model or its card is missing, damaged or doesn't fit.
    pub fn open(
        runtime: &OnnxRuntime,
        models: &Path,
        settings: SessionSettings,
        at_once: usize,
    ) -> Result<Self, ModelError> {
        let open = |_| Perceiver::new(runtime, models, settings).map(Mutex::new);
        let perceivers: Vec<_> = (0..at_once.max(1)).map(open).collect::<Result<_, _>>()?;
        Ok(Self(perceivers.into()))
    }

    /// What computes them.
    pub fn provider(&self) -> Provider {
        self.any().provider()
    }

    /// The detector's range in the LIDAR frame in metres: least x, y, z, greatest x, y, z.
    pub fn range_m(&self) -> [f32; 6] {
        self.any().range_m()
    }

    /// Perceives one frame, on any thread; the same frame always gives the same percepts.
    ///
    /// # Errors
    /// The frame is not valid or ONNX Runtime fails.
    pub fn perceive(
        &self,
        frame: &SensorFrame,
        calibration: &Calibration,
    ) -> Result<FramePercepts, PerceiveError> {
        self.any().perceive(frame, calibration)
    }

    /// One that is free, or that of this thread as soon as it is. Nobody who holds one waits for
    /// another.
    fn any(&self) -> MutexGuard<'_, Perceiver> {
        let free = self.0.iter().find_map(|one| one.try_lock().ok());
        free.unwrap_or_else(|| {
            let own = rayon::current_thread_index().unwrap_or(0) % self.0.len();
            self.0[own].lock().unwrap_or_else(PoisonError::into_inner)
        })
    }
}
