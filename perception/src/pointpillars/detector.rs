//! A detector, from sweep to boxes.

use std::path::Path;

use covista_world::{Detection3d, PointCloud};

use super::{decode::BoxDecoder, network::DetectorNetwork, preprocess::PillarGrid};
use crate::card::Network;
use crate::models::{ModelError, find_model};
use crate::perceiver::{PerceiveError, check};
use crate::runtime::{OnnxRuntime, Provider, SessionSettings, one_line};

/// Any detector of a folder with models; all that its range and shape ask for is on its card.
#[derive(Debug)]
pub struct Detector {
    id: String,
    provider: Provider,
    grid: PillarGrid,
    network: DetectorNetwork,
    decoder: BoxDecoder,
    score_threshold: f64,
}

impl Detector {
    /// Opens the detector `id` in the folder `models`.
    ///
    /// # Errors
    /// The model or its card is missing or damaged, doesn't fit or is no detector.
    pub fn open(
        runtime: &OnnxRuntime,
        models: &Path,
        id: &str,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let card = find_model(models, id)?;
        let Network::PointPillars(spec) = &card.network else {
            return Err(ModelError::WrongKind {
                id: card.id,
                expected: "detector",
            });
        };
        Ok(Self {
            grid: PillarGrid::new(spec),
            network: DetectorNetwork::open(runtime, &card, spec, settings)?,
            decoder: BoxDecoder::new(spec),
            score_threshold: spec.score_threshold,
            provider: settings.provider,
            id: card.id,
        })
    }

    /// What computes the network.
    pub fn provider(&self) -> Provider {
        self.provider
    }

    /// Id of the model.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The range in the LIDAR frame in metres: least x, y, z, greatest x, y, z.
    pub fn range_m(&self) -> [f32; 6] {
        self.grid.range_m()
    }

    /// The score from which a box counts where one has to decide, on the model's card.
    pub fn score_threshold(&self) -> f64 {
        self.score_threshold
    }

    /// The vehicles in a sweep, in the LIDAR frame, the surest first.
    ///
    /// # Errors
    /// The sweep is not valid or ONNX Runtime fails.
    pub fn detect(&mut self, sweep: &PointCloud) -> Result<Vec<Detection3d>, PerceiveError> {
        self.detect_down_to(sweep, self.score_threshold)
    }

    /// The boxes of a sweep with at least the score `least_score`, in (0, 1), in the LIDAR frame,
    /// the surest first: those that [`Self::detect`] gives and less sure ones.
    ///
    /// # Errors
    /// The sweep is not valid or ONNX Runtime fails.
    pub fn detect_down_to(
        &mut self,
        sweep: &PointCloud,
        least_score: f64,
    ) -> Result<Vec<Detection3d>, PerceiveError> {
        if !self.prepare(sweep)? {
            return Ok(Vec::new());
        }
        self.infer()?;
        Ok(self.decode(least_score))
    }

    /// Puts a sweep onto the network's canvas; whether any of it is in range.
    ///
    /// # Errors
    /// The sweep is not valid.
    pub(crate) fn prepare(&mut self, sweep: &PointCloud) -> Result<bool, PerceiveError> {
        check(sweep)?;
        let pillars = self.grid.apply(sweep);
        self.network.paint(pillars);
        Ok(!pillars.cells.is_empty())
    }

    /// The network's input, [C, ny, nx].
    pub(crate) fn canvas(&mut self) -> &[f32] {
        self.network.canvas()
    }

    /// Runs the network on the canvas.
    ///
    /// # Errors
    /// ONNX Runtime fails.
    pub(crate) fn infer(&mut self) -> Result<(), PerceiveError> {
        self.network
            .run()
            .map_err(|error| PerceiveError::Inference {
                model: self.id.clone(),
                reason: one_line(&error.to_string()),
            })
    }

    /// The boxes in the maps of the last run.
    pub(crate) fn decode(&mut self, least_score: f64) -> Vec<Detection3d> {
        self.decoder.decode(self.network.maps(), least_score)
    }
}
