//! How fast the networks are: the measurements behind `covista bench perception`.

use std::path::Path;
use std::time::{Duration, Instant};

use covista_world::{Calibration, PointCloud, SensorFrame};

use crate::card::{ModelCard, Network};
use crate::lanes::finder::LaneFinder;
use crate::models::{ModelError, find_model};
use crate::perceiver::{PerceiveError, Perceiver};
use crate::pointpillars::detector::Detector;
use crate::runtime::{OnnxRuntime, Provider, SessionSettings};

/// What the sensors measured at one instant, in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchFrame {
    /// The camera's image, of the size that lane networks take, and the LIDAR's sweep.
    pub measured: SensorFrame,
    /// Those of its points that the picture shows: what a detector that looks ahead is given.
    pub ahead: PointCloud,
    /// Of camera and LIDAR.
    pub calibration: Calibration,
}

/// Wall times of the stages of one frame, run one after the other without a break.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BenchTimes {
    /// Points or image to the network's input.
    pub prepare: Duration,
    /// The network.
    pub network: Duration,
    /// Its output to boxes or marks.
    pub decode: Duration,
}

impl BenchTimes {
    /// From points or image in memory to boxes or marks.
    pub fn end_to_end(&self) -> Duration {
        self.prepare + self.network + self.decode
    }
}

/// The arithmetic in which a network runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// 32-bit floating point.
    Fp32,
    /// 16-bit floating point with float32's range, sums in float32.
    Bf16,
    /// 8-bit integers where the file is quantised.
    Int8,
}

impl Precision {
    /// Its name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fp32 => "fp32",
            Self::Bf16 => "bf16",
            Self::Int8 => "int8",
        }
    }

    /// What `provider` runs an ONNX file in that is or is not quantised.
    fn of(is_quantised: bool, provider: Provider) -> Self {
        match provider {
            _ if is_quantised => Self::Int8,
            Provider::OpenVino if has_bf16() => Self::Bf16,
            _ => Self::Fp32,
        }
    }
}

/// Whether the processor computes in bfloat16: then OpenVINO runs float32 models in it.
#[cfg(target_arch = "x86_64")]
fn has_bf16() -> bool {
    std::arch::is_x86_feature_detected!("avx512bf16")
}

/// OpenVINO's plugin is there for x86-64 alone.
#[cfg(not(target_arch = "x86_64"))]
fn has_bf16() -> bool {
    false
}

/// The marks of quantised ONNX files: their operators' names, as they stand in the file.
fn is_quantised(onnx: &[u8]) -> bool {
    const OPERATOR: &[u8] = b"DequantizeLinear";
    onnx.windows(OPERATOR.len()).any(|bytes| bytes == OPERATOR)
}

/// A network under the clock.
#[derive(Debug)]
pub struct BenchNetwork {
    card: ModelCard,
    file_bytes: usize,
    precision: Precision,
    kind: Kind,
}

#[derive(Debug)]
enum Kind {
    Detector {
        detector: Box<Detector>,
        /// Of its grid.
        cells: usize,
        looks_ahead: bool,
    },
    Lanes(Box<LaneFinder>),
}

/// A network's input as another program can be given it.
#[derive(Debug, Clone, PartialEq)]
pub enum BenchInput {
    /// The occupied cells of a detector's canvas, ascending, and their features [cells, channels].
    Canvas {
        /// `iy * nx + ix` of each.
        cells: Vec<u32>,
        /// Their features, cell by cell.
        values: Vec<f32>,
    },
    /// The lane network's [3, height, width].
    Image(Vec<f32>),
}

impl BenchNetwork {
    /// Opens the network `id` in the folder `models`.
    ///
    /// # Errors
    /// The model or its card is missing or damaged or doesn't fit.
    pub fn open(
        runtime: &OnnxRuntime,
        models: &Path,
        id: &str,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let card = find_model(models, id)?;
        let kind = match &card.network {
            Network::PointPillars(spec) => {
                let detector = Detector::open(runtime, models, id, settings)?;
                let [nx, ny] = spec.grid();
                Kind::Detector {
                    cells: nx * ny,
                    looks_ahead: detector.range_m()[0] >= 0.0,
                    detector: Box::new(detector),
                }
            }
            Network::Ufld(_) => {
                Kind::Lanes(Box::new(LaneFinder::open(runtime, models, id, settings)?))
            }
        };
        let onnx = std::fs::read(&card.file).map_err(|source| ModelError::Missing {
            path: card.file.clone(),
            source,
        })?;
        Ok(Self {
            file_bytes: onnx.len(),
            precision: Precision::of(is_quantised(&onnx), settings.provider),
            kind,
            card,
        })
    }

    /// What it is.
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// Size of the ONNX file.
    pub fn file_bytes(&self) -> usize {
        self.file_bytes
    }

    /// The arithmetic in which it runs.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Whether it finds boxes, not lane marks.
    pub fn is_detector(&self) -> bool {
        matches!(self.kind, Kind::Detector { .. })
    }

    /// Runs the stages of one frame under the clock; the second number is how many boxes, or
    /// places of marks, were found.
    ///
    /// # Errors
    /// The frame is refused or ONNX Runtime fails.
    pub fn time_frame(&mut self, frame: &BenchFrame) -> Result<(BenchTimes, usize), PerceiveError> {
        let began = Instant::now();
        self.prepare(frame)?;
        let prepared = Instant::now();
        self.infer()?;
        let inferred = Instant::now();
        let found = self.decode();
        let times = BenchTimes {
            prepare: prepared - began,
            network: inferred - prepared,
            decode: inferred.elapsed(),
        };
        Ok((times, found))
    }

    /// Runs the network alone under the clock, on the input made of `frame` before.
    ///
    /// # Errors
    /// The frame is refused or ONNX Runtime fails.
    pub fn time_network(&mut self, frame: &BenchFrame) -> Result<Duration, PerceiveError> {
        self.prepare(frame)?;
        let began = Instant::now();
        self.infer()?;
        Ok(began.elapsed())
    }

    /// The network's input for `frame`.
    ///
    /// # Errors
    /// The frame is refused.
    pub fn input(&mut self, frame: &BenchFrame) -> Result<BenchInput, PerceiveError> {
        self.prepare(frame)?;
        Ok(match &mut self.kind {
            Kind::Detector {
                detector, cells, ..
            } => occupied(detector.canvas(), *cells),
            Kind::Lanes(lanes) => BenchInput::Image(lanes.input().to_vec()),
        })
    }

    fn prepare(&mut self, frame: &BenchFrame) -> Result<(), PerceiveError> {
        match &mut self.kind {
            Kind::Detector {
                detector,
                looks_ahead: true,
                ..
            } => detector.prepare(&frame.ahead).map(drop),
            Kind::Detector { detector, .. } => detector.prepare(&frame.measured.points).map(drop),
            Kind::Lanes(lanes) => lanes.prepare(&frame.measured.image),
        }
    }

    fn infer(&mut self) -> Result<(), PerceiveError> {
        match &mut self.kind {
            Kind::Detector { detector, .. } => detector.infer(),
            Kind::Lanes(lanes) => lanes.infer(),
        }
    }

    fn decode(&mut self) -> usize {
        match &mut self.kind {
            Kind::Detector { detector, .. } => detector.decode(detector.score_threshold()).len(),
            Kind::Lanes(lanes) => lanes.decode().pixels.iter().flatten().flatten().count(),
        }
    }
}

/// Runs both networks of the closed loop and their fusion under the clock.
///
/// # Errors
/// The frame is refused or ONNX Runtime fails.
pub fn time_perceiver(
    perceiver: &mut Perceiver,
    frame: &BenchFrame,
) -> Result<Duration, PerceiveError> {
    let began = Instant::now();
    perceiver.perceive(&frame.measured, &frame.calibration)?;
    Ok(began.elapsed())
}

/// The cells of a canvas [channels, cells] in which a feature is not 0.
fn occupied(canvas: &[f32], cell_count: usize) -> BenchInput {
    let of_cell = |cell: usize| canvas.iter().skip(cell).step_by(cell_count.max(1));
    let is_occupied = |cell: &usize| of_cell(*cell).any(|value| *value != 0.0);
    let cells: Vec<usize> = (0..cell_count).filter(is_occupied).collect();
    BenchInput::Canvas {
        values: cells
            .iter()
            .flat_map(|&cell| of_cell(cell).copied())
            .collect(),
        cells: cells.iter().map(|&cell| cell as u32).collect(),
    }
}

/// Wall times in seconds, sorted.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sorted(Vec<f64>);

impl FromIterator<f64> for Sorted {
    fn from_iter<I: IntoIterator<Item = f64>>(times_s: I) -> Self {
        let mut times_s: Vec<f64> = times_s.into_iter().collect();
        times_s.sort_by(f64::total_cmp);
        Self(times_s)
    }
}

impl Sorted {
    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The value below which `percent` of them lie, linear between neighbours (type 7 of Hyndman
    /// and Fan, NumPy's default); NaN of none.
    pub fn percentile(&self, percent: f64) -> f64 {
        let Some(last) = self.0.len().checked_sub(1) else {
            return f64::NAN;
        };
        let at = (percent / 100.0).clamp(0.0, 1.0) * last as f64;
        let low = (at as usize).min(last);
        let high = (low + 1).min(last);
        self.0[low] + (at - low as f64) * (self.0[high] - self.0[low])
    }

    /// Half of them lie below.
    pub fn median(&self) -> f64 {
        self.percentile(50.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn near(value: f64, expected: f64) {
        assert!((value - expected).abs() < 1e-12, "{value}, not {expected}");
    }

    #[test]
    fn percentiles_in_closed_form() {
        let four: Sorted = [4.0, 1.0, 3.0, 2.0].into_iter().collect();
        near(four.median(), 2.5);
        near(four.percentile(0.0), 1.0);
        near(four.percentile(100.0), 4.0);
        near(four.percentile(95.0), 1.0 + 3.0 * 0.95);
        let hundred_and_one: Sorted = (0..=100).map(f64::from).collect();
        for percent in [50.0, 95.0, 99.0] {
            near(hundred_and_one.percentile(percent), percent);
        }
        near(Sorted::from_iter([7.0]).percentile(99.0), 7.0);
        assert!(Sorted::default().median().is_nan());
    }

    proptest! {
        #[test]
        fn percentiles_rise_and_stay_within(
            times in prop::collection::vec(0f64..1e3, 1..50),
            a in 0f64..100.0,
            b in 0f64..100.0,
        ) {
            let sorted: Sorted = times.iter().copied().collect();
            prop_assert!(sorted.percentile(a.min(b)) <= sorted.percentile(a.max(b)));
            prop_assert!(times.contains(&sorted.percentile(0.0)));
            let below = times.iter().filter(|time| **time <= sorted.percentile(a)).count();
            prop_assert!(below as f64 >= a / 100.0 * (times.len() - 1) as f64);
        }
    }

    #[test]
    fn quantised_files_run_in_integers_and_openvino_in_bf16_where_it_can() {
        assert!(is_quantised(b"..\x22\x10DequantizeLinear.."));
        assert!(!is_quantised(b"Conv"));
        let of = Precision::of;
        assert_eq!(of(true, Provider::OpenVino), Precision::Int8);
        assert_eq!(of(false, Provider::Cpu), Precision::Fp32);
        assert_eq!(of(false, Provider::OpenVino) == Precision::Bf16, has_bf16());
    }

    #[test]
    fn a_canvas_is_told_by_its_occupied_cells() {
        // Two channels, four cells; the second and the fourth hold something.
        let canvas = [0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 3.0];
        let expected = BenchInput::Canvas {
            cells: vec![1, 3],
            values: vec![1.0, 2.0, 0.0, 3.0],
        };
        assert_eq!(occupied(&canvas, 4), expected);
    }
}
