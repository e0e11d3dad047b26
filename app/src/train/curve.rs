use std::path::Path;

use anyhow::Context;
use covista_drive::{EpisodeReport, RingEnvironment, RingSafety, RoundReport};
use covista_viewer::record_learning_curve;

use crate::output::write_whole;

const FILE: &str = "curve.csv";
const COLUMNS: [&str; 13] = [
    "reward",
    "mean_velocity_mps",
    "comfort",
    "unsafe_actions",
    "violations",
    "violations_unattributed",
    "emergency_stops",
    "lane_changes",
    "collisions",
    "updates",
    "critic_loss",
    "value",
    "neighbours_left_out_share",
];

/// A learning curve: one row a round.
#[derive(Debug, Default)]
pub(super) struct Curve {
    rows: Vec<(u64, Vec<f64>)>,
}

/// What a round of episodes came to.
pub(super) struct CurveRow {
    round: u64,
    /// Of an episode, mean over the CAVs.
    pub reward: f64,
    /// Of all vehicles.
    pub mean_velocity_mps: f64,
    pub comfort: f64,
    pub unsafe_actions: u64,
    pub emergency_stops: u64,
    pub lane_changes: u64,
    /// Not a number where nobody looked on.
    violations: f64,
    violations_unattributed: f64,
    collisions: u64,
    updates: u64,
    critic_loss: f64,
    value: f64,
    /// Share of situations in which K neighbours were too few.
    neighbours_left_out_share: f64,
}

impl CurveRow {
    /// From the report of a round and the loops that it was driven on.
    pub fn new(round: u64, report: &RoundReport, loops: &[RingEnvironment]) -> Self {
        let count = loops.len().max(1) as f64;
        let mean = |of: &dyn Fn(&RingEnvironment) -> f64| loops.iter().map(of).sum::<f64>() / count;
        let episodes = &report.episodes;
        let sum = |of: fn(&EpisodeReport) -> u64| episodes.iter().map(of).sum();
        let watched = |of: fn(&RingSafety) -> usize| {
            let of = |ring: &RingEnvironment| ring.safety().map(|safety| of(&safety) as f64);
            loops
                .iter()
                .map(of)
                .sum::<Option<f64>>()
                .unwrap_or(f64::NAN)
        };
        let (capped, situations) = loops.iter().fold((0, 0), |(capped, situations), ring| {
            let cap = ring.encoder().cap;
            (capped + cap.capped, situations + cap.situations)
        });
        let collided = loops.iter().map(|ring| ring.ring().report().collisions);
        Self {
            round,
            reward: episodes.iter().map(|episode| episode.reward).sum::<f64>() / count,
            mean_velocity_mps: mean(&|ring| ring.ring().report().mean_velocity_mps),
            comfort: mean(&|ring| ring.tally().mean_comfort()),
            unsafe_actions: sum(|episode| episode.unsafe_actions),
            emergency_stops: sum(|episode| episode.emergency_stops),
            lane_changes: loops.iter().map(|ring| ring.tally().lane_changes).sum(),
            violations: watched(|safety| safety.violations),
            violations_unattributed: watched(|safety| safety.violations_unattributed),
            collisions: collided.sum(),
            neighbours_left_out_share: capped as f64 / situations.max(1) as f64,
            updates: report.updates.updates,
            critic_loss: report.updates.critic_loss,
            value: report.updates.value,
        }
    }

    /// In the order of [`COLUMNS`].
    fn values(&self) -> Vec<f64> {
        vec![
            self.reward,
            self.mean_velocity_mps,
            self.comfort,
            self.unsafe_actions as f64,
            self.violations,
            self.violations_unattributed,
            self.emergency_stops as f64,
            self.lane_changes as f64,
            self.collisions as f64,
            self.updates as f64,
            self.critic_loss,
            self.value,
            self.neighbours_left_out_share,
        ]
    }
}

impl Curve {
    pub fn push(&mut self, row: CurveRow) {
        self.rows.push((row.round, row.values()));
    }

    /// The first `rounds` rounds of the curve in `folder`.
    pub fn load(folder: &Path, rounds: u64) -> anyhow::Result<Self> {
        let file = folder.join(FILE);
        let place = file.display();
        let text = std::fs::read_to_string(&file)
            .with_context(|| format!("cannot read {place}; leave out --resume to begin anew"))?;
        let rows = text.lines().skip(1).take(rounds as usize).map(|line| {
            let (round, values) = line.split_once(',')?;
            let number = |cell: &str| match cell {
                "" => Some(f64::NAN),
                cell => cell.parse().ok(),
            };
            let values: Option<Vec<f64>> = values.split(',').map(number).collect();
            let is_whole = |values: &Vec<f64>| values.len() == COLUMNS.len();
            Some((round.parse().ok()?, values.filter(is_whole)?))
        });
        let rows: Option<Vec<_>> = rows.collect();
        let is_whole = |rows: &Vec<_>| rows.len() as u64 == rounds;
        let rows = rows.filter(is_whole).with_context(|| {
            format!("{place} is not the curve of {rounds} rounds; leave out --resume to begin anew")
        })?;
        Ok(Self { rows })
    }

    /// Writes the curve into `folder`, as a table and as time series for rerun.
    pub fn save(&self, folder: &Path) -> anyhow::Result<()> {
        let mut text = format!("round,{}\n", COLUMNS.join(","));
        for (round, values) in &self.rows {
            let cell = |value: &f64| match value {
                value if value.is_nan() => String::new(),
                value => value.to_string(),
            };
            let values: Vec<String> = values.iter().map(cell).collect();
            text.push_str(&format!("{round},{}\n", values.join(",")));
        }
        write_whole(&folder.join(FILE), text.as_bytes())?;
        record_learning_curve(&folder.join("learning.rrd"), &COLUMNS, &self.rows)?;
        Ok(())
    }
}
