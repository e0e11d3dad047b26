//! The same networks in Python: a process that stays, told over its standard input, one JSON
//! object a line.

use std::{
    fs,
    io::{BufRead, BufReader, Write},
    path::Path,
    process::{Child, ChildStdin, ChildStdout, Command, Stdio},
};

use anyhow::{Context, bail};
use covista_perception::{BenchFrame, BenchInput, BenchNetwork};
use covista_world::PointCloud;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::cli::PeerArg;

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
    child: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
    log: std::path::PathBuf,
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
    error: Option<String>,
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
    /// Starts `python3`, with its script and what it says in `folder`.
    pub(super) fn start(kind: PeerArg, folder: &Path) -> anyhow::Result<Self> {
        let (script, log) = (folder.join("peer.py"), folder.join(kind.name()));
        let place = || format!("cannot write to {}", folder.display());
        fs::write(&script, SCRIPT).with_context(place)?;
        let stderr = fs::File::create(&log).with_context(place)?;
        let mut child = Command::new("python3")
            .arg(script)
            .arg(kind.name())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(stderr)
            .spawn()
            .context("python3 can't be run: install Python 3.11 or leave out --against")?;
        let (Some(requests), Some(answers)) = (child.stdin.take(), child.stdout.take()) else {
            bail!("python3 can't be talked to");
        };
        let mut peer = Self {
            kind,
            versions: String::new(),
            child,
            requests,
            answers: BufReader::new(answers),
            log,
            networks: 0,
        };
        peer.versions = peer.ask(&json!({"do": "hello"}))?.versions;
        Ok(peer)
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
        self.ask(&asked)
            .with_context(|| format!("{} can't run {}", self.kind.name(), network.card().id))?;
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
        let answer = self.ask(&json!({
            "do": "time", "network": network, "stage": stage, "frames": frames, "warm_up": warm_up,
        }))?;
        if answer.seconds.len() + warm_up != frames.len() {
            bail!("{} timed another number of frames", self.kind.name());
        }
        Ok((answer.seconds, answer.found))
    }

    fn ask(&mut self, request: &Value) -> anyhow::Result<Answer> {
        let mut line = String::new();
        // A process that has ended takes no request; why it did is in its log.
        let sent = writeln!(self.requests, "{request}").and_then(|()| self.requests.flush());
        let read = sent.and_then(|()| self.answers.read_line(&mut line));
        let answer = serde_json::from_str(&line).unwrap_or_else(|_| Answer {
            seconds: Vec::new(),
            found: 0,
            versions: String::new(),
            error: Some(self.last_words(read.err())),
        });
        match answer.error {
            None => Ok(answer),
            Some(error) => bail!(
                "--against {}: {error}: install what it needs (python3 -m pip install {}) or \
                 leave it out",
                self.kind.name(),
                self.kind.packages()
            ),
        }
    }

    /// Why it ended: the last line of its log.
    fn last_words(&mut self, error: Option<std::io::Error>) -> String {
        // Its log is whole once it has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let log = fs::read(&self.log).unwrap_or_default();
        let log = String::from_utf8_lossy(&log);
        match (log.lines().rfind(|line| !line.trim().is_empty()), error) {
            (Some(line), _) => line.trim().to_owned(),
            (None, Some(error)) => error.to_string(),
            (None, None) => "it ended without a word".to_owned(),
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
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
