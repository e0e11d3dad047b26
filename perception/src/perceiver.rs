//! One frame through both networks and their fusion.

use std::path::Path;
use std::time::Instant;

use covista_world::{
    Calibration, CameraImage, Detection3d, FreeSpace, InvalidPayload, LaneMarks, Percept,
    PointCloud, SensorFrame, Validate,
};

use crate::card::{CardError, ModelCard, Network, UfldSpec};
use crate::free_space::free_space;
use crate::fusion::{LaneCourse, fuse};
use crate::ground::Ground;
use crate::lanes::decode::FoundMarks;
use crate::lanes::ground::to_lane_marks;
use crate::lanes::{decode, network::LaneNetwork, preprocess::Resize};
use crate::models::{DETECTOR_MODEL, LANE_MODEL, ModelError};
use crate::pointpillars::{decode::BoxDecoder, network::DetectorNetwork, preprocess::PillarGrid};
use crate::runtime::{OnnxRuntime, one_line};

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
        model: &'static str,
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
pub struct Perceiver {
    lanes: LaneStage,
    detector: DetectorStage,
    side_by_side: bool,
}

struct LaneStage {
    spec: UfldSpec,
    resize: Resize,
    network: LaneNetwork,
}

struct DetectorStage {
    grid: PillarGrid,
    network: DetectorNetwork,
    decoder: BoxDecoder,
}

impl Perceiver {
    /// Opens [`LANE_MODEL`] and [`DETECTOR_MODEL`] in the folder `models`. A frame takes up to
    /// `threads` threads: from two on the networks run side by side, the lane network on one.
    ///
    /// # Errors
    /// A model or its card is missing, damaged or doesn't fit.
    pub fn new(runtime: &OnnxRuntime, models: &Path, threads: usize) -> Result<Self, ModelError> {
        let card = |id: &str| ModelCard::load(&models.join(format!("{id}.toml")));
        let (lane_card, detector_card) = (card(LANE_MODEL)?, card(DETECTOR_MODEL)?);
        let side_by_side = threads > 1;
        let detector_threads = threads.saturating_sub(1).max(1);
        let lanes = match &lane_card.network {
            Network::Ufld(spec) => LaneStage::open(runtime, &lane_card, spec)?,
            Network::PointPillars(_) => return Err(wrong_kind(models, &lane_card, "ufld")),
        };
        let detector = match &detector_card.network {
            Network::PointPillars(spec) => DetectorStage {
                grid: PillarGrid::new(spec),
                network: DetectorNetwork::open(runtime, &detector_card, spec, detector_threads)?,
                decoder: BoxDecoder::new(spec),
            },
            Network::Ufld(_) => return Err(wrong_kind(models, &detector_card, "pointpillars")),
        };
        Ok(Self {
            lanes,
            detector,
            side_by_side,
        })
    }

    /// Width and height of the images that the lane network was trained on, in pixels.
    pub fn image_size_px(&self) -> [u32; 2] {
        [
            self.lanes.spec.image_width_px,
            self.lanes.spec.image_height_px,
        ]
    }

    /// The detector's range in the LIDAR frame in metres: least x, y, z, greatest x, y, z.
    pub fn range_m(&self) -> [f32; 6] {
        self.detector.grid.range_m()
    }

    /// The lane marks in an image.
    ///
    /// # Errors
    /// The image is not valid or of another size, or ONNX Runtime fails.
    pub fn find_marks(&mut self, image: &CameraImage) -> Result<FoundMarks, PerceiveError> {
        self.lanes.check(image)?;
        self.lanes.run(image).map_err(failed(LANE_MODEL))
    }

    /// The vehicles in a sweep, in the LIDAR frame, the surest first.
    ///
    /// # Errors
    /// The sweep is not valid or ONNX Runtime fails.
    pub fn detect(&mut self, sweep: &PointCloud) -> Result<Vec<Detection3d>, PerceiveError> {
        check(sweep)?;
        self.detector.run(sweep).map_err(failed(DETECTOR_MODEL))
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
        let mut lanes = || timed(|| lanes.run(&frame.image));
        let mut detector = || timed(|| detector.run(&frame.points));
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
        let found = found.map_err(failed(LANE_MODEL))?;
        let detections = detections.map_err(failed(DETECTOR_MODEL))?;
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

fn check(payload: &impl Validate) -> Result<(), PerceiveError> {
    payload.validate().map_err(PerceiveError::Frame)
}

fn failed(model: &'static str) -> impl Fn(ort::Error) -> PerceiveError {
    move |error| PerceiveError::Inference {
        model,
        reason: one_line(&error.to_string()),
    }
}

impl LaneStage {
    fn open(runtime: &OnnxRuntime, card: &ModelCard, spec: &UfldSpec) -> Result<Self, ModelError> {
        let network = LaneNetwork::open(runtime, card, spec, 1)?;
        let image_size = [spec.image_width_px, spec.image_height_px].map(|side| side as usize);
        Ok(Self {
            spec: spec.clone(),
            resize: Resize::new(image_size, network.input_size(), spec.mean, spec.std),
            network,
        })
    }

    fn check(&self, image: &CameraImage) -> Result<(), PerceiveError> {
        check(image)?;
        let found = [image.width_px, image.height_px];
        let expected = [self.spec.image_width_px, self.spec.image_height_px];
        if found == expected {
            Ok(())
        } else {
            Err(PerceiveError::ImageSize { found, expected })
        }
    }

    fn run(&mut self, image: &CameraImage) -> ort::Result<FoundMarks> {
        let UfldSpec {
            grid_cells,
            image_width_px,
            ..
        } = self.spec;
        let input = self.resize.apply(image);
        self.network.run(input, |logits| {
            decode::decode(logits, grid_cells, image_width_px)
        })
    }
}

impl DetectorStage {
    fn run(&mut self, sweep: &PointCloud) -> ort::Result<Vec<Detection3d>> {
        let pillars = self.grid.apply(sweep);
        if pillars.coords.is_empty() {
            return Ok(Vec::new());
        }
        self.network.run(pillars, |maps| self.decoder.decode(maps))
    }
}

fn wrong_kind(models: &Path, card: &ModelCard, expected: &str) -> ModelError {
    ModelError::Card(CardError::Malformed {
        path: models.join(format!("{}.toml", card.id)),
        reason: format!("its kind is not {expected}"),
    })
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}
