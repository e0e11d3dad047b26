//! ONNX Runtime and its providers, as libraries that are loaded when they are needed.

mod acquire;
mod bound;
mod provider;

pub(crate) use acquire::hex_sha256;
pub(crate) use bound::BoundSession;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::device::Device;
use ort::environment::Environment;
use ort::ep::{self, ExecutionProvider};
use ort::logging::LogLevel;
use ort::memory::DeviceType;
use ort::session::Session;
use ort::session::builder::SessionBuilder;

pub use acquire::ONNX_RUNTIME_VERSION;
use acquire::OPENVINO_VERSION;
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
    /// OpenVINO's plugin is nowhere and could not be fetched.
    #[error(
        "the provider openvino is not on this machine and could not be fetched ({reason}): run \
         `python3 -m pip install onnxruntime-ep-openvino=={OPENVINO_VERSION}` where a package \
         index can be reached and set COVISTA_OPENVINO_PLUGIN to its onnxruntime_ep_openvino/\
         libonnxruntime_providers_openvino_plugin.so, or choose the provider cpu"
    )]
    NoOpenVino {
        /// What went wrong when fetching it.
        reason: String,
    },
    /// OpenVINO's plugin is there and does not work.
    #[error(
        "{path} can't be used as the provider openvino ({reason}): set COVISTA_OPENVINO_PLUGIN to \
         a libonnxruntime_providers_openvino_plugin.so of version {OPENVINO_VERSION}, unset it to \
         have one fetched, or choose the provider cpu"
    )]
    UnusableOpenVino {
        /// The plugin.
        path: PathBuf,
        /// What ONNX Runtime says.
        reason: String,
    },
    /// CUDA is not to be had.
    #[error(
        "the provider cuda is not available ({reason}): set ORT_DYLIB_PATH to an ONNX Runtime \
         with CUDA on a machine with an NVIDIA GPU, or choose the provider cpu"
    )]
    NoCuda {
        /// What is missing.
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

/// Held while a plugin is loaded, which ONNX Runtime takes once.
static PROVIDING: Mutex<()> = Mutex::new(());

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
        let library = acquire::ONNX_RUNTIME.locate(progress);
        let runtime = Self::load(&library.map_err(|reason| RuntimeError::Missing { reason })?)?;
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
        // What it would log as an error comes back as one.
        environment.set_log_level(LogLevel::Fatal);
        Ok(Self {
            environment,
            library,
        })
    }

    /// The library that was loaded.
    pub fn library(&self) -> &Path {
        &self.library
    }

    /// Makes the provider that is asked for ready for sessions and says which it is.
    ///
    /// OpenVINO's plugin is loaded from `COVISTA_OPENVINO_PLUGIN`, else from covista's cache, else
    /// fetched there with the machine's pip; `progress` is told before anything that takes long.
    /// For [`ProviderChoice::Auto`] nothing is fetched; a plugin that is there and does not work
    /// is told and left out.
    ///
    /// # Errors
    /// It is not to be had on this machine; one line says why.
    pub fn provide(
        &self,
        choice: ProviderChoice,
        progress: &dyn Fn(&str),
    ) -> Result<Provider, RuntimeError> {
        match choice {
            ProviderChoice::Only(provider) => {
                match provider {
                    Provider::Cpu => {}
                    Provider::OpenVino => {
                        let plugin = acquire::OPENVINO.locate(progress);
                        self.load_openvino(
                            &plugin.map_err(|reason| RuntimeError::NoOpenVino { reason })?,
                        )?;
                    }
                    Provider::Cuda => self.find_cuda()?,
                }
                Ok(provider)
            }
            ProviderChoice::Auto => {
                let is_present = |provider: &Provider| match provider {
                    Provider::Cpu => true,
                    Provider::OpenVino => acquire::OPENVINO.present().is_some_and(|plugin| {
                        let loaded = self.load_openvino(&plugin);
                        loaded
                            .inspect_err(|error| progress(&error.to_string()))
                            .is_ok()
                    }),
                    Provider::Cuda => self.find_cuda().is_ok(),
                };
                let found = Provider::ALL.into_iter().find(is_present);
                Ok(found.unwrap_or(Provider::Cpu))
            }
        }
    }

    fn load_openvino(&self, plugin: &Path) -> Result<(), RuntimeError> {
        let _one_by_one = PROVIDING.lock().unwrap_or_else(PoisonError::into_inner);
        if self.processor(OPENVINO_NAME).is_some() {
            return Ok(());
        }
        let unusable = |reason: String| RuntimeError::UnusableOpenVino {
            path: plugin.to_owned(),
            reason: one_line(&reason),
        };
        let absolute = plugin
            .canonicalize()
            .map_err(|error| unusable(error.to_string()))?;
        self.environment
            .register_ep_library("OpenVINO", absolute)
            .map_err(|error| unusable(error.to_string()))?;
        match self.processor(OPENVINO_NAME) {
            Some(_) => Ok(()),
            None => Err(unusable("it knows no processor here".into())),
        }
    }

    /// What computes on processors for the provider that calls itself `name`, once it is loaded.
    fn processor(&self, name: &str) -> Option<Device<'_>> {
        self.environment.devices().find(|device| {
            device.ep().is_ok_and(|found| found == name)
                && device.hardware_device().ty() == DeviceType::CPU
        })
    }

    fn find_cuda(&self) -> Result<(), RuntimeError> {
        if !ep::CUDA::is_available().unwrap_or(false) {
            return Err(RuntimeError::NoCuda {
                reason: format!("{} is built without it", self.library.display()),
            });
        }
        let probe = SessionSettings {
            provider: Provider::Cuda,
            threads: 1,
        };
        let opened = self.session(IDENTITY, probe);
        opened.map(drop).map_err(|error| RuntimeError::NoCuda {
            reason: one_line(&error.to_string()),
        })
    }

    /// A session for the ONNX file in `model`, all of it on the provider that is named, which
    /// [`Self::provide`] made ready.
    pub(crate) fn session(&self, model: &[u8], settings: SessionSettings) -> ort::Result<Session> {
        let SessionSettings { provider, threads } = settings;
        let builder = Session::builder(&self.environment)?
            .with_intra_threads(threads)?
            .with_intra_op_spinning(false)?;
        // ort lets ONNX Runtime choose among all that is loaded unless a device is named. Its own
        // `ep::CPU` names none: with OpenVINO loaded, OpenVINO would compute.
        let on = |builder: SessionBuilder, name, options: &[_]| -> ort::Result<SessionBuilder> {
            let device = self.processor(name);
            let device = device.ok_or_else(|| ort::Error::new("it was not loaded"))?;
            Ok(builder.with_devices([device], Some(options))?)
        };
        let mut builder = match provider {
            Provider::Cpu => on(builder, ep::CPU::NAME, &[])?,
            Provider::OpenVino => {
                let config = format!(
                    r#"{{"CPU": {{"INFERENCE_NUM_THREADS": "{threads}", "NUM_STREAMS": "1"}}}}"#
                );
                let options = [(format!("{OPENVINO_NAME}.load_config"), config)];
                on(builder, OPENVINO_NAME, &options)?.with_disable_cpu_fallback()?
            }
            Provider::Cuda => builder
                .with_execution_providers([ep::CUDA::default().build().error_on_failure()])?
                .with_disable_cpu_fallback()?,
        };
        builder.commit_from_memory(model)
    }
}

/// What OpenVINO's plugin calls itself.
const OPENVINO_NAME: &str = "OpenVINOExecutionProvider";

/// The smallest ONNX model: y = x for one number (IR version 8, opset 17).
const IDENTITY: &[u8] = b"\x08\x08:7\x0a\x10\x0a\x01x\x12\x01y\x22\x08Identity\x12\x01iZ\x0f\x0a\x01x\x12\x0a\x0a\x08\x08\x01\x12\x04\x0a\x02\x08\x01b\x0f\x0a\x01y\x12\x0a\x0a\x08\x08\x01\x12\x04\x0a\x02\x08\x01B\x04\x0a\x00\x10\x11";

/// `text` with its line breaks taken out.
pub(crate) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
