//! Checkpoints: safetensors, with what they are about as JSON in the metadata.

use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::network::Network;
use super::{LearningError, Shape, TrainingSettings};

const FORMAT: &str = "covista.learning";
const VERSION: u32 = 1;

/// What a checkpoint is about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointHeader {
    /// Version of the format.
    pub version: u32,
    /// Sizes of the environments.
    pub shape: Shape,
    /// What was trained, with its seed.
    pub settings: TrainingSettings,
    /// What the environments were set up with.
    #[serde(default)]
    pub environment: serde_json::Value,
    /// Rounds of episodes trained.
    pub rounds: u64,
    /// Of each learner.
    pub learners: Vec<Counts>,
}

/// How far a learner is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Counts {
    /// Updates, which are also the steps of both optimisers.
    pub updates: u64,
    /// Decisions.
    pub decisions: u64,
}

impl CheckpointHeader {
    pub(super) fn new(
        shape: Shape,
        settings: TrainingSettings,
        environment: serde_json::Value,
        rounds: u64,
        learners: Vec<Counts>,
    ) -> Self {
        Self {
            version: VERSION,
            shape,
            settings,
            environment,
            rounds,
            learners,
        }
    }
}

/// Tensors to be written.
#[derive(Default)]
pub(super) struct Writer {
    tensors: Vec<(String, Vec<usize>, Vec<u8>)>,
}

impl Writer {
    /// Adds the parts of `network` that `numbers` holds.
    pub fn add(&mut self, prefix: &str, network: &Network, numbers: &[f32]) {
        for tensor in network.tensors() {
            let part = &numbers[tensor.start..][..tensor.len()];
            let bytes = part.iter().flat_map(|x| x.to_le_bytes()).collect();
            let name = format!("{prefix}.{}", tensor.name);
            self.tensors.push((name, tensor.shape.clone(), bytes));
        }
    }

    /// Writes the file whole or not at all.
    pub fn save(self, path: &Path, header: &CheckpointHeader) -> Result<(), LearningError> {
        let fail = |problem: String| problem_with(path, format!("cannot be written: {problem}"));
        let views: Vec<(&str, TensorView<'_>)> = self
            .tensors
            .iter()
            .map(|(name, shape, bytes)| {
                let view = TensorView::new(Dtype::F32, shape.clone(), bytes);
                Ok((
                    name.as_str(),
                    view.map_err(|error| fail(error.to_string()))?,
                ))
            })
            .collect::<Result<_, LearningError>>()?;
        let header = serde_json::to_string(header).map_err(|error| fail(error.to_string()))?;
        let metadata = HashMap::from([(FORMAT.to_owned(), header)]);
        let bytes = safetensors::serialize(views, Some(metadata))
            .map_err(|error| fail(error.to_string()))?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let mut file = tempfile::NamedTempFile::new_in(folder).map_err(|e| fail(e.to_string()))?;
        file.write_all(&bytes)
            .map_err(|error| fail(error.to_string()))?;
        file.as_file()
            .sync_all()
            .map_err(|error| fail(error.to_string()))?;
        file.persist(path)
            .map_err(|error| fail(error.to_string()))?;
        Ok(())
    }
}

/// A checkpoint that has been read.
pub(super) struct Reader {
    path: PathBuf,
    bytes: Vec<u8>,
    pub header: CheckpointHeader,
}

impl Reader {
    pub fn open(path: &Path) -> Result<Self, LearningError> {
        let fail = |problem: String| problem_with(path, problem);
        let bytes =
            std::fs::read(path).map_err(|error| fail(format!("cannot be read: {error}")))?;
        let damaged = |error| fail(format!("is damaged ({error}); use another copy of it"));
        SafeTensors::deserialize(&bytes).map_err(damaged)?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes).map_err(damaged)?;
        let header = metadata.metadata().as_ref().and_then(|all| all.get(FORMAT));
        let Some(header) = header else {
            let problem = format!("has no entry {FORMAT}; give one that covista train has written");
            return Err(fail(problem));
        };
        let header: CheckpointHeader = serde_json::from_str(header).map_err(|error| {
            fail(format!(
                "is of another version ({error}); train anew or use that version"
            ))
        })?;
        if header.version != VERSION {
            let version = header.version;
            let problem = format!("has version {version}, this program reads version {VERSION}");
            return Err(fail(problem));
        }
        header.settings.hyperparameters.validate()?;
        header.shape.validate()?;
        Ok(Self {
            path: path.to_owned(),
            bytes,
            header,
        })
    }

    /// The numbers of `network` under `prefix`.
    pub fn numbers(&self, prefix: &str, network: &Network) -> Result<Vec<f32>, LearningError> {
        let damaged = |error| self.problem(format!("is damaged ({error})"));
        let tensors = SafeTensors::deserialize(&self.bytes).map_err(damaged)?;
        let mut numbers = Vec::with_capacity(network.len());
        for tensor in network.tensors() {
            let name = format!("{prefix}.{}", tensor.name);
            let view = tensors.tensor(&name).map_err(|_| {
                self.problem(format!("has no tensor {name}; use a whole checkpoint"))
            })?;
            if view.dtype() != Dtype::F32 || view.shape() != tensor.shape {
                return Err(self.problem(format!(
                    "holds {name} as {:?} {:?}, the network needs F32 {:?}; use the sizes it was trained with",
                    view.dtype(),
                    view.shape(),
                    tensor.shape
                )));
            }
            let (parts, _) = view.data().as_chunks::<4>();
            numbers.extend(parts.iter().map(|&part| f32::from_le_bytes(part)));
            if !numbers[tensor.start..].iter().all(|x| x.is_finite()) {
                return Err(self.problem(format!(
                    "has a number in {name} that is not finite; go back to an earlier one"
                )));
            }
        }
        Ok(numbers)
    }

    pub fn problem(&self, problem: String) -> LearningError {
        problem_with(&self.path, problem)
    }
}

fn problem_with(path: &Path, problem: String) -> LearningError {
    LearningError::Checkpoint {
        path: path.to_owned(),
        problem,
    }
}
