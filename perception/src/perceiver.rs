//! One frame through both networks and their fusion.

use std::path::Path;
use std::time::Instant;

use covista_world::{
    Calibration, CameraImage, Detection3d, FreeSpace, InvalidPayload, LaneMarks, Percept,
    PointCloud, SensorFrame, Validate,
};

use crate::free_space::free_space;
use crate::fusion::{LaneCourse, fuse};
use crate::ground::Ground;
use crate::lanes::{decode::FoundMarks, finder::LaneFinder, ground::to_lane_marks};
use crate::models::{DETECTOR_MODEL, LANE_MODEL, ModelError};
use crate::pointpillars::detector::Detector;
use crate::runtime::{OnnxRuntime, Provider, SessionSettings};

/// Why a frame can't be perceived; each message is one line.
#[derive(Debug, thiserror::Error)]
pub enum PerceiveError {
    /// A number is not finite or the image has another size than it says.
    #[error("a sensor frame is refused: {0}")]
    Frame(#[source] InvalidPayload),
    /// The image is not the lane network's.
    #[error(
        "the image is {found:?} pixels wide and high and the lane network was trained on \
         {expected:?}: use the camera of its model card"
    )]
    ImageSize {
        /// Width and height of the frame's image.
        found: [u32; 2],
        /// Width and height on the model card.
        expected: [u32; 2],
    },
    /// ONNX Runtime fails on the frame.
    #[error("ONNX Runtime fails in {model}: {reason}")]
    Inference {
        /// Id of the model.
        model: String,
        /// What ONNX Runtime says.
        reason: String,
    },
}

/// What is perceived in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePercepts {
    /// The lane marks in the image and on the ground.
    pub marks: LaneMarks,
    /// Where the lanes run; `None` where too little of their marks is seen.
    pub course: Option<LaneCourse>,
    /// The vehicles, the surest first.
    pub percepts: Vec<Percept>,
    /// How far the way is seen free.
    pub free_space: FreeSpace,
    /// Wall time of the stages.
    pub timings: StageTimes,
}

/// Wall time of the stages of one frame, from input to decoded output, in seconds. Lanes and
/// detector may run side by side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageTimes {
    /// Image to marks.
    pub lanes_s: f64,
    /// Sweep to boxes.
    pub detector_s: f64,
    /// Marks, boxes and sweep to percepts and free space.
    pub fusion_s: f64,
}

/// Both networks, ready to perceive frame after frame.
#[derive(Debug)]
pub struct Perceiver {
    lanes: LaneFinder,
    detector: Detector,
    side_by_side: bool,
}

impl Perceiver {
    /// Opens [`LANE_MODEL`] and [`DETECTOR_MODEL`] in the folder `models`. A frame takes up to
    /// `settings.threads` threads: from two on the networks run side by side, the lane network on
    /// one.
    ///
    /// # Errors
    /// A model or its card is missing, damaged or doesn't fit.
    pub fn new(
        runtime: &OnnxRuntime,
        models: &Path,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let on = |threads: usize| SessionSettings {
            threads,
            ..settings
        };
        let detector_threads = settings.threads.saturating_sub(1).max(1);
        Ok(Self {
            lanes: LaneFinder::open(runtime, models, LANE_MODEL, on(1))?,
            detector: Detector::open(runtime, models, DETECTOR_MODEL, on(detector_threads))?,
            side_by_side: settings.threads > 1,
        })
    }

    /// What computes the networks.
    pub fn provider(&self) -> Provider {
        self.detector.provider()
    }

    /// Width and height of the images that the lane network was trained on, in pixels.
    pub fn image_size_px(&self) -> [u32; 2] {
        self.lanes.image_size_px()
    }

    /// The detector's range in the LIDAR frame in metres: least x, y, z, greatest x, y, z.
    pub fn range_m(&self) -> [f32; 6] {
        self.detector.range_m()
    }

    /// The lane marks in an image.
    ///
    /// # Errors
    /// The image is not valid or of another size, or ONNX Runtime fails.
    pub fn find_marks(&mut self, image: &CameraImage) -> Result<FoundMarks, PerceiveError> {
        self.lanes.find_marks(image)
    }

    /// The vehicles in a sweep, in the LIDAR frame, the surest first.
    ///
    /// # Errors
    /// The sweep is not valid or ONNX Runtime fails.
    pub fn detect(&mut self, sweep: &PointCloud) -> Result<Vec<Detection3d>, PerceiveError> {
        self.detector.detect(sweep)
    }

    /// Perceives one frame; the same frame always gives the same percepts.
    ///
    /// # Errors
    /// The frame is not valid or ONNX Runtime fails.
    pub fn perceive(
        &mut self,
        frame: &SensorFrame,
        calibration: &Calibration,
    ) -> Result<FramePercepts, PerceiveError> {
        self.lanes.check(&frame.image)?;
        check(&frame.points)?;
        let Self {
            lanes, detector, ..
        } = self;
        let mut lanes = || timed(|| lanes.find_marks(&frame.image));
        let mut detector = || timed(|| detector.detect(&frame.points));
        let ((found, lanes_s), (detections, detector_s)) = if self.side_by_side {
            std::thread::scope(|scope| {
                let lanes = scope.spawn(lanes);
                let detections = detector();
                let found = lanes
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                (found, detections)
            })
        } else {
            (lanes(), detector())
        };
        let (found, detections) = (found?, detections?);
        let ((marks, fused, free_space), fusion_s) = timed(|| {
            let ground = Ground::fit(&frame.points, calibration);
            let marks = to_lane_marks(&found, &ground, calibration);
            let fused = fuse(&marks, &detections, calibration);
            (marks, fused, free_space(&frame.points, calibration))
        });
        Ok(FramePercepts {
            marks,
            course: fused.course,
            percepts: fused.percepts,
            free_space,
            timings: StageTimes {
                lanes_s,
                detector_s,
                fusion_s,
            },
        })
    }
}

pub(crate) fn check(payload: &impl Validate) -> Result<(), PerceiveError> {
    payload.validate().map_err(PerceiveError::Frame)
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}
