//! The figures of `covista bench perception`.

use covista_perception::{BenchTimes, ModelCard};
use serde::Serialize;

use super::contest::{Contest, Contestant};
use super::member::Member;
use crate::bench::turns::{Turns, sorted, speed_ratio};

pub(super) const NETWORK: &str = "network";
pub(super) const END_TO_END: &str = "end_to_end";
/// Who ran the network.
pub(super) const COVISTA: &str = "covista";

/// A row of `--json`: one stage of a network on a provider. Percentages are 0 to 100.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Row {
    pub(super) model: String,
    /// `covista`, or what `--against` names.
    pub(super) run_by: &'static str,
    pub(super) provider: &'static str,
    pub(super) precision: &'static str,
    pub(super) threads: usize,
    pub(super) stage: &'static str,
    /// Frames that count.
    pub(super) frames: usize,
    pub(super) img_per_s: f64,
    pub(super) median_ms: f64,
    pub(super) p95_ms: f64,
    pub(super) p99_ms: f64,
    /// Medians of the stages on the way from end to end.
    #[serde(flatten)]
    pub(super) stages: Option<Stages>,
    pub(super) gmac: Option<f64>,
    pub(super) gmac_per_s: Option<f64>,
    pub(super) params: Option<u64>,
    pub(super) nonzero_params: Option<u64>,
    pub(super) file_bytes: Option<usize>,
    pub(super) sha256: Option<String>,
    pub(super) accuracy: Option<f64>,
    pub(super) accuracy_name: Option<&'static str>,
    pub(super) accuracy_frames: Option<i64>,
    pub(super) accuracy_command: Option<String>,
    /// Boxes, or places of marks, a frame.
    pub(super) found_per_frame: Option<f64>,
    /// How many times as fast as the dense network of the family: same provider, same precision.
    pub(super) speedup_over_dense: Option<f64>,
    /// How many times as fast as the same network unquantised on the same provider.
    pub(super) speedup_of_int8: Option<f64>,
    /// How many times as fast as the same file on the provider cpu.
    pub(super) speedup_of_provider: Option<f64>,
    /// How many times as fast as the dense network of the family, unquantised, on the provider cpu.
    pub(super) speedup_in_all: Option<f64>,
    /// covista's speed over this one's: median over the rounds of the ratios of both turns.
    pub(super) covista_speed_ratio: Option<f64>,
}

#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Stages {
    pub(super) prepare_ms: f64,
    pub(super) network_ms: f64,
    pub(super) decode_ms: f64,
}

/// What a card says of its network's quality.
struct Accuracy {
    percent: f64,
    name: &'static str,
    frames: Option<i64>,
    command: Option<String>,
}

impl Accuracy {
    fn of(card: &ModelCard, is_detector: bool) -> Option<Self> {
        let (name, frames) = if is_detector {
            ("ap_3d_car_moderate_r40", "car_frames")
        } else {
            ("accuracy_tusimple", "frames")
        };
        let text = card.metrics.get("command").and_then(|value| value.as_str());
        Some(Self {
            percent: card.metrics.get(name)?.as_float()?,
            name,
            frames: card
                .metrics
                .get(frames)
                .and_then(|value| value.as_integer()),
            command: text.map(str::to_owned),
        })
    }
}

/// All rows of a contest.
pub(super) fn rows(contest: &Contest, threads: usize) -> Vec<Row> {
    let mut rows = Vec::new();
    for contestant in &contest.contestants {
        rows.extend(rows_of(contestant, contest, threads));
    }
    for pair in &contest.pairs {
        let ids = [
            covista_perception::DETECTOR_MODEL,
            covista_perception::LANE_MODEL,
        ];
        let mut row = Row::timed(&pair.turns, threads);
        row.model = ids.join(" + ");
        row.provider = pair.provider.name();
        row.precision = pair.precision.name();
        row.stage = END_TO_END;
        rows.push(row);
    }
    compare(&mut rows);
    rows
}

fn rows_of(of: &Contestant, contest: &Contest, threads: usize) -> Vec<Row> {
    let whole = of.end_to_end();
    let row = |turns: &Turns, stage| Row {
        stage,
        ..Row::of(of, turns, threads)
    };
    let median_ms = |stage| sorted(&of.stage(stage)).median() * 1e3;
    let mut alone = row(&of.alone, NETWORK);
    alone.gmac_per_s = alone.gmac.map(|gmac| gmac * alone.img_per_s);
    let mut end_to_end = row(&whole, END_TO_END);
    end_to_end.stages = Some(Stages {
        prepare_ms: median_ms(|times: &BenchTimes| times.prepare),
        network_ms: median_ms(|times| times.network),
        decode_ms: median_ms(|times| times.decode),
    });
    end_to_end.found_per_frame = Some(of.found as f64 / end_to_end.frames as f64);
    let mut rows = vec![alone, end_to_end];
    for other in &of.others {
        for (stage, ours, theirs) in [
            (NETWORK, &of.alone, &other.alone),
            (END_TO_END, &whole, &other.end_to_end),
        ] {
            let mut row = row(theirs, stage);
            row.run_by = contest.peers[other.peer].kind.name();
            row.covista_speed_ratio = Some(speed_ratio(ours, theirs));
            if stage == END_TO_END {
                row.found_per_frame = Some(other.found as f64 / row.frames as f64);
            }
            rows.push(row);
        }
    }
    rows
}

impl Row {
    /// The speed of frames by turn.
    fn timed(turns: &Turns, threads: usize) -> Self {
        let times = sorted(turns);
        Self {
            model: String::new(),
            run_by: COVISTA,
            provider: "",
            precision: "",
            threads,
            stage: "",
            frames: times.count(),
            img_per_s: 1.0 / times.median(),
            median_ms: times.median() * 1e3,
            p95_ms: times.percentile(95.0) * 1e3,
            p99_ms: times.percentile(99.0) * 1e3,
            stages: None,
            gmac: None,
            gmac_per_s: None,
            params: None,
            nonzero_params: None,
            file_bytes: None,
            sha256: None,
            accuracy: None,
            accuracy_name: None,
            accuracy_frames: None,
            accuracy_command: None,
            found_per_frame: None,
            speedup_over_dense: None,
            speedup_of_int8: None,
            speedup_of_provider: None,
            speedup_in_all: None,
            covista_speed_ratio: None,
        }
    }

    fn of(of: &Contestant, turns: &Turns, threads: usize) -> Self {
        let card = of.network.card();
        let accuracy = Accuracy::of(card, of.network.is_detector());
        let accuracy = accuracy.as_ref();
        Self {
            model: card.id.clone(),
            provider: of.provider.name(),
            precision: of.network.precision().name(),
            gmac: card.cost.map(|cost| cost.multiply_accumulates as f64 / 1e9),
            params: card.cost.map(|cost| cost.parameters),
            nonzero_params: card.cost.map(|cost| cost.nonzero_parameters),
            file_bytes: Some(of.network.file_bytes()),
            sha256: Some(card.sha256.clone()),
            accuracy: accuracy.map(|accuracy| accuracy.percent),
            accuracy_name: accuracy.map(|accuracy| accuracy.name),
            accuracy_frames: accuracy.and_then(|accuracy| accuracy.frames),
            accuracy_command: accuracy.and_then(|accuracy| accuracy.command.clone()),
            ..Self::timed(turns, threads)
        }
    }
}

/// Fills in how the rows of covista compare with each other.
fn compare(rows: &mut [Row]) {
    let all = rows.to_vec();
    for row in rows.iter_mut().filter(|row| row.run_by == COVISTA) {
        let member = Member::of(&row.model);
        // How many times as fast as the row of another member or provider.
        let over = |member: Member<'_>, provider: &str, precision: Option<&str>| {
            let other = all.iter().find(|other| {
                other.run_by == COVISTA
                    && other.stage == row.stage
                    && Member::of(&other.model) == member
                    && other.provider == provider
                    && precision.is_none_or(|precision| precision == other.precision)
            })?;
            (other.model != row.model || other.provider != row.provider)
                .then(|| other.median_ms / row.median_ms)
        };
        let dense = Member { cut: "", ..member };
        let unquantised = Member {
            is_int8: false,
            ..member
        };
        let speedups = [
            over(dense, row.provider, Some(row.precision)),
            over(unquantised, row.provider, None),
            over(member, "cpu", None),
            over(
                Member {
                    is_int8: false,
                    ..dense
                },
                "cpu",
                None,
            ),
        ];
        [
            row.speedup_over_dense,
            row.speedup_of_int8,
            row.speedup_of_provider,
            row.speedup_in_all,
        ] = speedups;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three frames of `ms` in two turns.
    fn row(model: &str, provider: &'static str, precision: &'static str, ms: f64) -> Row {
        Row {
            model: model.into(),
            provider,
            precision,
            stage: END_TO_END,
            ..Row::timed(&vec![vec![ms / 1e3, ms / 1e3], vec![ms / 1e3]], 2)
        }
    }

    #[test]
    fn pruning_int8_and_provider_are_told_apart() {
        let mut rows = [
            row("net", "cpu", "fp32", 80.0),
            row("net-p8", "cpu", "fp32", 16.0),
            row("net-p8-int8", "cpu", "int8", 8.0),
            row("net-int8", "cpu", "int8", 40.0),
            row("net", "openvino", "bf16", 20.0),
            row("net-p8", "openvino", "bf16", 5.0),
            row("net-p8-int8", "openvino", "int8", 4.0),
        ];
        compare(&mut rows);
        let speedups = rows.each_ref().map(|row| {
            [
                row.speedup_over_dense,
                row.speedup_of_int8,
                row.speedup_of_provider,
                row.speedup_in_all,
            ]
        });
        let expected = [
            [None, None, None, None],
            [Some(5.0), None, None, Some(5.0)],
            [Some(5.0), Some(2.0), None, Some(10.0)],
            [None, Some(2.0), None, Some(2.0)],
            [None, None, Some(4.0), Some(4.0)],
            [Some(4.0), None, Some(3.2), Some(16.0)],
            // There is no dense network in int8 on that provider.
            [None, Some(1.25), Some(2.0), Some(20.0)],
        ];
        for (found, expected) in speedups.iter().flatten().zip(expected.iter().flatten()) {
            match (found, expected) {
                (Some(found), Some(expected)) => assert!((found - expected).abs() < 1e-9),
                _ => assert_eq!(found, expected),
            }
        }
        assert_eq!(rows[0].frames, 3);
        assert!((rows[0].img_per_s - 12.5).abs() < 1e-9);
    }
}
