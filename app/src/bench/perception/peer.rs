//! The same networks in Python.

use std::{fs, path::Path};

use anyhow::{Context, bail};
use covista_perception::{BenchFrame, BenchInput, BenchNetwork};
use covista_world::PointCloud;
use serde::Deserialize;
use serde_json::json;

use crate::{bench::python::Python, cli::PeerArg};

/// What Python runs; it says what passes between us.
const SCRIPT: &str = include_str!("../../../../models/training/peer.py");

/// What is timed in the other program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PeerStage {
    Network,
    EndToEnd,
}

/// Another program that runs networks.
pub(super) struct Peer {
    pub(super) kind: PeerArg,
    /// The versions of what it runs.
    pub(super) versions: String,
    python: Python,
    networks: usize,
}

#[derive(Deserialize)]
struct Answer {
    #[serde(default)]
    seconds: Vec<f64>,
    #[serde(default)]
    found: usize,
    #[serde(default)]
    versions: String,
}

impl PeerArg {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::OnnxruntimePython => "onnxruntime-python",
            Self::Pytorch => "pytorch",
        }
    }

    fn packages(self) -> &'static str {
        match self {
            Self::OnnxruntimePython => "numpy onnxruntime",
            Self::Pytorch => "numpy onnx torch",
        }
    }
}

impl Peer {
    /// Starts it, with its script and what it says in `folder`.
    pub(super) fn start(kind: PeerArg, folder: &Path) -> anyhow::Result<Self> {
        let name = kind.name();
        let mut python = Python::start((name, kind.packages()), SCRIPT, &[name], folder)?;
        let Answer { versions, .. } = python.ask(&json!({"do": "hello"}))?;
        Ok(Self {
            kind,
            versions,
            python,
            networks: 0,
        })
    }

    /// Opens a network whose inputs were written by [`write_inputs`]; returns its number.
    pub(super) fn open(
        &mut self,
        network: &BenchNetwork,
        card: &Path,
        folder: &Path,
        threads: usize,
    ) -> anyhow::Result<usize> {
        let asked = json!({"do": "open", "card": card, "folder": folder, "threads": threads});
        let opened = self.python.ask::<Answer>(&asked);
        opened.with_context(|| format!("{} can't run {}", self.kind.name(), network.card().id))?;
        self.networks += 1;
        Ok(self.networks - 1)
    }

    /// Wall times in seconds of these frames but for the first `warm_up`, and what was found in
    /// those.
    pub(super) fn time(
        &mut self,
        network: usize,
        stage: PeerStage,
        frames: &[usize],
        warm_up: usize,
    ) -> anyhow::Result<(Vec<f64>, usize)> {
        let stage = match stage {
            PeerStage::Network => "network",
            PeerStage::EndToEnd => "end_to_end",
        };
        let answer: Answer = self.python.ask(&json!({
            "do": "time", "network": network, "stage": stage, "frames": frames, "warm_up": warm_up,
        }))?;
        if answer.seconds.len() + warm_up != frames.len() {
            bail!("{} timed another number of frames", self.kind.name());
        }
        Ok((answer.seconds, answer.found))
    }
}

/// Writes the frames as the peers read them.
pub(super) fn write_frames(frames: &[BenchFrame], folder: &Path) -> anyhow::Result<()> {
    let points = |cloud: &PointCloud| bytes(cloud.points.as_flattened());
    for (index, frame) in frames.iter().enumerate() {
        let measured = &frame.measured;
        write(folder, &format!("{index}.sweep"), &points(&measured.points))?;
        write(folder, &format!("{index}.ahead"), &points(&frame.ahead))?;
        write(folder, &format!("{index}.rgb"), &measured.image.rgb)?;
    }
    Ok(())
}

/// Writes what a network is fed with for each frame as the peers read it.
pub(super) fn write_inputs(
    network: &mut BenchNetwork,
    frames: &[BenchFrame],
    folder: &Path,
) -> anyhow::Result<()> {
    for (index, frame) in frames.iter().enumerate() {
        let prefix = format!("{}-{index}", network.card().id);
        match network.input(frame)? {
            BenchInput::Canvas { cells, values } => {
                let cells: Vec<u8> = cells.iter().flat_map(|cell| cell.to_le_bytes()).collect();
                write(folder, &format!("{prefix}.cells"), &cells)?;
                write(folder, &format!("{prefix}.values"), &bytes(&values))?;
            }
            BenchInput::Image(image) => write(folder, &format!("{prefix}.image"), &bytes(&image))?,
        }
    }
    Ok(())
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect()
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
    let path = folder.join(name);
    fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
}
