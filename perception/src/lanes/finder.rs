//! A lane network, from image to marks.

use std::path::Path;

use covista_world::CameraImage;

use super::{decode, decode::FoundMarks, network::LaneNetwork, preprocess::Resize};
use crate::card::{Network, UfldSpec};
use crate::models::{ModelError, find_model};
use crate::perceiver::{PerceiveError, check};
use crate::runtime::{OnnxRuntime, Provider, SessionSettings, one_line};

/// Any lane network of a folder with models.
#[derive(Debug)]
pub struct LaneFinder {
    id: String,
    provider: Provider,
    spec: UfldSpec,
    resize: Resize,
    network: LaneNetwork,
}

impl LaneFinder {
    /// Opens the lane network `id` in the folder `models`.
    ///
    /// # Errors
    /// The model or its card is missing or damaged, doesn't fit or is no lane network.
    pub fn open(
        runtime: &OnnxRuntime,
        models: &Path,
        id: &str,
        settings: SessionSettings,
    ) -> Result<Self, ModelError> {
        let card = find_model(models, id)?;
        let Network::Ufld(spec) = &card.network else {
            return Err(ModelError::WrongKind {
                id: card.id,
                expected: "lane network",
            });
        };
        let network = LaneNetwork::open(runtime, &card, spec, settings)?;
        let image_size = [spec.image_width_px, spec.image_height_px].map(|side| side as usize);
        Ok(Self {
            spec: spec.clone(),
            resize: Resize::new(image_size, network.input_size(), spec.mean, spec.std),
            network,
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

    /// Width and height of the images that the network was trained on, in pixels.
    pub fn image_size_px(&self) -> [u32; 2] {
        [self.spec.image_width_px, self.spec.image_height_px]
    }

    /// The lane marks in an image.
    ///
    /// # Errors
    /// The image is not valid or of another size, or ONNX Runtime fails.
    pub fn find_marks(&mut self, image: &CameraImage) -> Result<FoundMarks, PerceiveError> {
        self.prepare(image)?;
        self.infer()?;
        Ok(self.decode())
    }

    /// Brings an image to the network's input.
    ///
    /// # Errors
    /// The image is not valid or of another size.
    pub(crate) fn prepare(&mut self, image: &CameraImage) -> Result<(), PerceiveError> {
        self.check(image)?;
        self.resize.apply(image, self.network.input_mut());
        Ok(())
    }

    /// The network's input, [3, height, width].
    pub(crate) fn input(&mut self) -> &[f32] {
        self.network.input_mut()
    }

    /// Runs the network on its input.
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

    /// The marks in the logits of the last run.
    pub(crate) fn decode(&self) -> FoundMarks {
        let UfldSpec {
            grid_cells,
            image_width_px,
            ..
        } = self.spec;
        decode::decode(self.network.logits(), grid_cells, image_width_px)
    }

    /// # Errors
    /// The image is not valid or of another size than the network's.
    pub(crate) fn check(&self, image: &CameraImage) -> Result<(), PerceiveError> {
        check(image)?;
        let found = [image.width_px, image.height_px];
        let expected = self.image_size_px();
        if found == expected {
            Ok(())
        } else {
            Err(PerceiveError::ImageSize { found, expected })
        }
    }
}
