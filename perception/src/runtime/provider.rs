//! What computes a network: the execution providers of ONNX Runtime that covista knows.

use std::fmt;
use std::str::FromStr;

/// An execution provider of ONNX Runtime.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Provider {
    /// ONNX Runtime's own, in the model's precision; it is always there.
    Cpu,
    /// Intel's OpenVINO, a plugin; it computes float32 models in bfloat16 where the processor can.
    OpenVino,
    /// NVIDIA's GPUs; it needs a build of ONNX Runtime with CUDA.
    Cuda,
}

impl Provider {
    /// All of them, the fastest first.
    pub const ALL: [Self; 3] = [Self::Cuda, Self::OpenVino, Self::Cpu];

    /// Its name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::OpenVino => "openvino",
            Self::Cuda => "cuda",
        }
    }
}

impl fmt::Display for Provider {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// No provider has this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no provider: name cpu, openvino, cuda or auto")]
pub struct UnknownProvider(String);

impl FromStr for Provider {
    type Err = UnknownProvider;

    fn from_str(name: &str) -> Result<Self, UnknownProvider> {
        let mut all = Self::ALL.into_iter();
        all.find(|provider| provider.name() == name)
            .ok_or_else(|| UnknownProvider(name.to_owned()))
    }
}

/// What a user asks for; [`crate::OnnxRuntime::provide`] makes a [`Provider`] of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProviderChoice {
    /// This one and no other.
    Only(Provider),
    /// The fastest that is on this machine; nothing is fetched for it.
    Auto,
}

impl FromStr for ProviderChoice {
    type Err = UnknownProvider;

    fn from_str(name: &str) -> Result<Self, UnknownProvider> {
        match name {
            "auto" => Ok(Self::Auto),
            _ => name.parse().map(Self::Only),
        }
    }
}

impl fmt::Display for ProviderChoice {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Only(provider) => provider.fmt(formatter),
            Self::Auto => formatter.write_str("auto"),
        }
    }
}

/// What a network runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SessionSettings {
    /// What computes it.
    pub provider: Provider,
    /// How many threads compute it, at least one.
    pub threads: usize,
}

impl SessionSettings {
    /// On the CPU provider, which gives the same on every machine with `threads` threads.
    pub const fn cpu(threads: usize) -> Self {
        Self {
            provider: Provider::Cpu,
            threads,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for provider in Provider::ALL {
            assert_eq!(provider.to_string().parse(), Ok(provider));
            let choice = ProviderChoice::Only(provider);
            assert_eq!(choice.to_string().parse(), Ok(choice));
        }
        assert_eq!("auto".parse(), Ok(ProviderChoice::Auto));
        assert_eq!(ProviderChoice::Auto.to_string(), "auto");
        let error = "tpu".parse::<ProviderChoice>().unwrap_err();
        assert_eq!(
            error.to_string(),
            "`tpu` is no provider: name cpu, openvino, cuda or auto"
        );
    }
}
