//! The models in a folder: list, verify, open.

use std::path::{Path, PathBuf};

use ort::session::Session;
use ort::value::{Outlet, TensorElementType, ValueType};

use crate::card::{CardError, Dimension, ModelCard, TensorSpec};
use crate::runtime::{OnnxRuntime, Provider, SessionSettings, hex_sha256, one_line};

/// Id of the lane network that the [`crate::Perceiver`] uses.
pub const LANE_MODEL: &str = "ufld-resnet18";
/// Id of the detector that the [`crate::Perceiver`] uses.
pub const DETECTOR_MODEL: &str = "pointpillars";

/// Why a model can't be used; each message is one line.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// Its card is missing or wrong.
    #[error(transparent)]
    Card(#[from] CardError),
    /// The folder with the models can't be read.
    #[error("{path} is no folder with models ({source}): name the folder with the models")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// No card in the folder has that name.
    #[error("there is no model `{id}` in {folder}: name one of {known}")]
    Unknown {
        /// What was asked for.
        id: String,
        /// The folder.
        folder: PathBuf,
        /// The models that are there.
        known: String,
    },
    /// It is a network for something else.
    #[error("the model `{id}` is no {expected}: `covista models list` shows what there is")]
    WrongKind {
        /// The model.
        id: String,
        /// What was asked for.
        expected: &'static str,
    },
    /// The ONNX file can't be read.
    #[error(
        "the model {path} can't be read ({source}): restore it from the repository, or train it \
         with models/training"
    )]
    Missing {
        /// The ONNX file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The ONNX file is not the one its card describes.
    #[error(
        "the model {path} is damaged (SHA-256 {found}, its card says {expected}): restore it from \
         the repository, or put the new hash into its card if you trained it"
    )]
    Damaged {
        /// The ONNX file.
        path: PathBuf,
        /// Of the file.
        found: String,
        /// Of the card.
        expected: String,
    },
    /// ONNX Runtime refuses the file.
    #[error(
        "ONNX Runtime refuses the model {path} ({reason}): export it again with models/training"
    )]
    Refused {
        /// The ONNX file.
        path: PathBuf,
        /// What ONNX Runtime says.
        reason: String,
    },
    /// A provider other than the CPU's does not take the file.
    #[error(
        "the provider {provider} can't compute the model {path} ({reason}): choose the provider cpu"
    )]
    Unsupported {
        /// The ONNX file.
        path: PathBuf,
        /// What was to compute it.
        provider: Provider,
        /// What ONNX Runtime says.
        reason: String,
    },
    /// The inputs or outputs are not the card's, or the card is for another kind of network.
    #[error("the model {path} does not fit ({reason}): export it again and update its card")]
    Mismatch {
        /// The ONNX file.
        path: PathBuf,
        /// The first difference.
        reason: String,
    },
}

/// The cards in `folder`, by id.
///
/// # Errors
/// The folder can't be read or a card in it is wrong.
pub fn list_models(folder: &Path) -> Result<Vec<ModelCard>, ModelError> {
    let unreadable = |source| ModelError::Folder {
        path: folder.to_owned(),
        source,
    };
    let mut cards = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            cards.push(ModelCard::load(&path)?);
        }
    }
    cards.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(cards)
}

/// The card of the model `id` in `folder`.
///
/// # Errors
/// There is none, or it is wrong.
pub fn find_model(folder: &Path, id: &str) -> Result<ModelCard, ModelError> {
    let path = folder.join(format!("{id}.toml"));
    if !path.exists() {
        let known: Vec<String> = list_models(folder)?
            .into_iter()
            .map(|card| card.id)
            .collect();
        if !known.is_empty() {
            return Err(ModelError::Unknown {
                id: id.to_owned(),
                folder: folder.to_owned(),
                known: known.join(", "),
            });
        }
    }
    Ok(ModelCard::load(&path)?)
}

/// Checks the ONNX file's hash, loads it and compares its inputs and outputs with its card.
///
/// # Errors
/// Says in one line what doesn't fit.
pub fn verify_model(runtime: &OnnxRuntime, card: &ModelCard) -> Result<(), ModelError> {
    open_model(runtime, card, SessionSettings::cpu(1)).map(drop)
}

/// A verified session for the model of `card`.
///
/// # Errors
/// Says in one line what doesn't fit.
pub fn open_model(
    runtime: &OnnxRuntime,
    card: &ModelCard,
    settings: SessionSettings,
) -> Result<Session, ModelError> {
    let path = || card.file.clone();
    let bytes = std::fs::read(&card.file).map_err(|source| ModelError::Missing {
        path: path(),
        source,
    })?;
    let found = hex_sha256(&bytes);
    if found != card.sha256 {
        return Err(ModelError::Damaged {
            path: path(),
            found,
            expected: card.sha256.clone(),
        });
    }
    let session = runtime
        .session(&bytes, settings)
        .map_err(|error| refused(card, settings.provider, &error))?;
    compare("input", &card.inputs, session.inputs())
        .and_then(|()| compare("output", &card.outputs, session.outputs()))
        .map_err(|reason| ModelError::Mismatch {
            path: path(),
            reason,
        })?;
    Ok(session)
}

/// ONNX Runtime's `error` with the model of `card` on a provider.
pub(crate) fn refused(card: &ModelCard, provider: Provider, error: &ort::Error) -> ModelError {
    let (path, reason) = (card.file.clone(), one_line(&error.to_string()));
    match provider {
        Provider::Cpu => ModelError::Refused { path, reason },
        _ => ModelError::Unsupported {
            path,
            provider,
            reason,
        },
    }
}

fn compare(what: &str, specs: &[TensorSpec], outlets: &[Outlet]) -> Result<(), String> {
    if specs.len() != outlets.len() {
        return Err(format!(
            "it has {} {what}s, its card {}",
            outlets.len(),
            specs.len()
        ));
    }
    for (spec, outlet) in specs.iter().zip(outlets) {
        let same = spec.name == outlet.name() && fits(spec, outlet.dtype());
        if !same {
            return Err(format!(
                "{what} {} is {}, its card says {} {} {:?}",
                outlet.name(),
                outlet.dtype(),
                spec.name,
                spec.dtype,
                spec.shape
            ));
        }
    }
    Ok(())
}

/// Whether a tensor of the type `found` is what the card says.
fn fits(spec: &TensorSpec, found: &ValueType) -> bool {
    let ValueType::Tensor { ty, shape, .. } = found else {
        return false;
    };
    let same_type = match spec.dtype.as_str() {
        "float32" => *ty == TensorElementType::Float32,
        "int64" => *ty == TensorElementType::Int64,
        _ => false,
    };
    same_type
        && spec.shape.len() == shape.len()
        && spec
            .shape
            .iter()
            .zip(shape.iter())
            .all(|(axis, length)| match axis {
                Dimension::Fixed(fixed) => fixed == length,
                Dimension::Dynamic(_) => *length == -1,
            })
}
