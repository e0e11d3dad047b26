//! ONNX Runtime as a library that is loaded when it is needed.

mod acquire;
mod provider;

pub(crate) use acquire::hex_sha256;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::environment::Environment;
use ort::ep;
use ort::session::Session;

pub use acquire::ONNX_RUNTIME_VERSION;
pub use provider::{Provider, ProviderChoice, SessionSettings, UnknownProvider};

/// Why ONNX Runtime can't be used; each message is one line.
#[derive(Debug, thiserror::Error)]
pub enum RuntimeError {
    /// It is nowhere and could not be fetched.
    #[error(
        "ONNX Runtime {ONNX_RUNTIME_VERSION} is not on this machine and could not be fetched \
         ({reason}): run `python3 -m pip install onnxruntime=={ONNX_RUNTIME_VERSION}` where a \
         package index can be reached and set ORT_DYLIB_PATH to its \
         onnxruntime/capi/libonnxruntime.so.{ONNX_RUNTIME_VERSION}"
    )]
    Missing {
        /// What went wrong when fetching it.
        reason: String,
    },
    /// The provider is not to be had on this machine.
    #[error("the provider {provider} is not available ({reason}): choose cpu or auto")]
    Unavailable {
        /// What was asked for.
        provider: Provider,
        /// Why.
        reason: String,
    },
    /// The library is there and can't be loaded.
    #[error(
        "{path} can't be loaded as ONNX Runtime ({reason}): set ORT_DYLIB_PATH to a \
         libonnxruntime.so.{ONNX_RUNTIME_VERSION}, or unset it to have one fetched"
    )]
    Unloadable {
        /// The library.
        path: PathBuf,
        /// What the loader says.
        reason: String,
    },
}

/// ONNX Runtime, loaded. Cheap to clone; a process has one, whoever asks.
#[derive(Debug, Clone)]
pub struct OnnxRuntime {
    environment: Environment,
    library: PathBuf,
}

/// Kept for the life of the process: ONNX Runtime allows one environment, and releasing it at
/// exit is what made processes hang.
static LOADED: Mutex<Option<OnnxRuntime>> = Mutex::new(None);

impl OnnxRuntime {
    /// Loads ONNX Runtime from `ORT_DYLIB_PATH`, else from covista's cache, else fetches it there
    /// with the machine's pip; `progress` is told before anything that takes long.
    ///
    /// # Errors
    /// One line that says how to get it.
    pub fn acquire(progress: &dyn Fn(&str)) -> Result<Self, RuntimeError> {
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(runtime) = loaded.as_ref() {
            return Ok(runtime.clone());
        }
        let runtime = Self::load(&acquire::locate(progress)?)?;
        *loaded = Some(runtime.clone());
        Ok(runtime)
    }

    fn load(library: &Path) -> Result<Self, RuntimeError> {
        let unloadable = |reason: String| RuntimeError::Unloadable {
            path: library.to_owned(),
            reason: one_line(&reason),
        };
        // ort resolves a relative path against the executable, so it gets an absolute one.
        let library = library
            .canonicalize()
            .map_err(|error| unloadable(error.to_string()))?;
        let environment = ort::init_from(&library)
            .map_err(|error| unloadable(error.to_string()))?
            .with_telemetry(false)
            .build()
            .map_err(|error| unloadable(error.to_string()))?;
        Ok(Self {
            environment,
            library,
        })
    }

    /// The library that was loaded.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// Makes the provider that is asked for ready for sessions, fetched if need be, and says which
    /// it is; `progress` is told before anything that takes long. For [`ProviderChoice::Auto`]
    /// nothing is fetched.
    ///
    /// # Errors
    /// It is not to be had on this machine; one line says why.
    pub fn provide(
        &self,
        choice: ProviderChoice,
        _progress: &dyn Fn(&str),
    ) -> Result<Provider, RuntimeError> {
        match choice {
            ProviderChoice::Auto | ProviderChoice::Only(Provider::Cpu) => Ok(Provider::Cpu),
            ProviderChoice::Only(provider) => Err(unavailable(provider)),
        }
    }

    /// A session for the ONNX file in `model`; its provider was made ready by [`Self::provide`].
    pub(crate) fn session(&self, model: &[u8], settings: SessionSettings) -> ort::Result<Session> {
        let SessionSettings { provider, threads } = settings;
        if provider != Provider::Cpu {
            return Err(ort::Error::new(unavailable(provider).to_string()));
        }
        Session::builder(&self.environment)?
            .with_execution_providers([ep::CPU::default().with_arena_allocator(true).build()])?
            .with_intra_threads(threads)?
            .with_intra_op_spinning(false)?
            .commit_from_memory(model)
    }
}

fn unavailable(provider: Provider) -> RuntimeError {
    RuntimeError::Unavailable {
        provider,
        reason: "it is not built in".into(),
    }
}

/// `text` with its line breaks taken out.
pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
