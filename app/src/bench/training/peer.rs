//! The same update in Python, turn by turn with ours.

use std::path::Path;

use anyhow::{bail, ensure};
use covista_drive::{Algorithm, Hyperparameters, TimedLearner, UpdateSizes};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::{
    bench::{
        python::Python,
        turns::{Turns, sorted, speed_ratio},
    },
    cli::UpdatePeerArg,
};

/// What Python runs; it says what passes between us.
const SCRIPT: &str = include_str!("../../../../tests/oracles/update_cost.py");
/// Updates of a turn that count.
const TURN_UPDATES: usize = 20;
/// Updates before them that don't: weights come back to the caches.
const WARM_UP_UPDATES: usize = 3;

/// A row of `--json`: the update of Alg. 2 by another program, and by covista in the turns between.
#[derive(Debug, Serialize)]
pub(super) struct PeerRow {
    run_by: &'static str,
    pub(super) versions: String,
    sizes: UpdateSizes,
    updates: usize,
    pub(super) updates_per_s: f64,
    median_ms: f64,
    pub(super) covista_updates_per_s: f64,
    covista_median_ms: f64,
    /// covista's speed over the other's: median over the rounds of the ratios of both turns.
    pub(super) covista_speed_ratio: f64,
}

/// The other program, open for the update of one agent.
pub(super) struct Peer {
    kind: UpdatePeerArg,
    python: Python,
    versions: String,
    learner: TimedLearner,
}

#[derive(Deserialize)]
struct Opened {
    versions: String,
}

#[derive(Deserialize)]
struct Timed {
    seconds: Vec<f64>,
}

impl UpdatePeerArg {
    fn name(self) -> &'static str {
        match self {
            Self::Pytorch => "pytorch",
        }
    }

    fn packages(self) -> &'static str {
        match self {
            Self::Pytorch => "numpy torch",
        }
    }
}

impl Peer {
    /// Starts it on networks of the same sizes as Alg. 2's among `cavs` CAVs.
    pub(super) fn start(
        kind: UpdatePeerArg,
        (cavs, neighbours): (usize, usize),
        hyperparameters: Hyperparameters,
        folder: &Path,
    ) -> anyhow::Result<Self> {
        let learner = TimedLearner::new(
            Algorithm::SafeActorCritic,
            cavs,
            neighbours,
            hyperparameters,
        )?;
        let mut python = Python::start((kind.name(), kind.packages()), SCRIPT, &[], folder)?;
        let mut request = json!(learner.sizes());
        request["do"] = "open".into();
        let Opened { versions } = python.ask(&request)?;
        Ok(Self {
            kind,
            python,
            versions,
            learner,
        })
    }

    /// Both in turns, until each has made `updates` updates that count.
    pub(super) fn hold(mut self, updates: usize) -> anyhow::Result<PeerRow> {
        let (mut ours, mut theirs) = (Turns::new(), Turns::new());
        for first in (0..updates).step_by(TURN_UPDATES) {
            let turn = TURN_UPDATES.min(updates - first);
            let mut times_s = self.learner.time(WARM_UP_UPDATES + turn)?;
            ours.push(times_s.split_off(WARM_UP_UPDATES));
            theirs.push(self.their_turn(turn)?);
        }
        let medians_s = [&ours, &theirs].map(|turns| sorted(turns).median());
        Ok(PeerRow {
            run_by: self.kind.name(),
            versions: self.versions,
            sizes: self.learner.sizes(),
            updates,
            updates_per_s: 1.0 / medians_s[1],
            median_ms: 1e3 * medians_s[1],
            covista_updates_per_s: 1.0 / medians_s[0],
            covista_median_ms: 1e3 * medians_s[0],
            covista_speed_ratio: speed_ratio(&ours, &theirs),
        })
    }

    fn their_turn(&mut self, updates: usize) -> anyhow::Result<Vec<f64>> {
        let request: Value = json!({"do": "time", "updates": updates, "warm_up": WARM_UP_UPDATES});
        let Timed { seconds } = self.python.ask(&request)?;
        ensure!(
            seconds.len() == updates,
            "{} timed another number of updates",
            self.kind.name()
        );
        if seconds
            .iter()
            .any(|time_s| !(time_s.is_finite() && *time_s > 0.0))
        {
            bail!("{} timed an update that took no time", self.kind.name());
        }
        Ok(seconds)
    }
}
