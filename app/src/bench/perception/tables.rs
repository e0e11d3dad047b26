//! The tables of `covista bench perception`.

use super::rows::{COVISTA, END_TO_END, NETWORK, Row, Stages};
use crate::table::{aligned, optional};

/// Speeds, one line a network and provider.
pub(super) fn speed_table(rows: &[Row]) -> String {
    let header = [
        "end to end",
        "provider",
        "precision",
        "images/s",
        "median, ms",
        "p95",
        "p99",
        "prepare",
        "network",
        "decode",
        "pruned, x",
        "int8, x",
        "provider, x",
        "in all, x",
        "found",
    ];
    let ours = rows
        .iter()
        .filter(|row| row.run_by == COVISTA && row.stage == END_TO_END);
    let cells = ours.map(|row| {
        let stage = |of: fn(&Stages) -> f64| optional(row.stages.as_ref().map(of), 2);
        [
            vec![row.model.clone(), row.provider.into(), row.precision.into()],
            speeds(row),
            vec![
                stage(|stages| stages.prepare_ms),
                stage(|stages| stages.network_ms),
                stage(|stages| stages.decode_ms),
                optional(row.speedup_over_dense, 2),
                optional(row.speedup_of_int8, 2),
                optional(row.speedup_of_provider, 2),
                optional(row.speedup_in_all, 2),
                optional(row.found_per_frame, 1),
            ],
        ]
        .concat()
    });
    table(&header, cells)
}

/// The networks alone, and what they cost.
pub(super) fn network_table(rows: &[Row]) -> String {
    let header = [
        "network alone",
        "provider",
        "precision",
        "images/s",
        "median, ms",
        "p95",
        "p99",
        "GMAC/s",
        "pruned, x",
        "int8, x",
        "provider, x",
        "in all, x",
    ];
    let ours = rows
        .iter()
        .filter(|row| row.run_by == COVISTA && row.stage == NETWORK);
    let cells = ours.map(|row| {
        [
            vec![row.model.clone(), row.provider.into(), row.precision.into()],
            speeds(row),
            vec![
                optional(row.gmac_per_s, 1),
                optional(row.speedup_over_dense, 2),
                optional(row.speedup_of_int8, 2),
                optional(row.speedup_of_provider, 2),
                optional(row.speedup_in_all, 2),
            ],
        ]
        .concat()
    });
    table(&header, cells)
}

/// The files and their accuracy, one line a network.
pub(super) fn file_table(rows: &[Row]) -> String {
    let header = [
        "file",
        "GMAC",
        "parameters",
        "not 0",
        "MB",
        "SHA-256",
        "accuracy, %",
        "frames",
        "measure",
    ];
    let is_first = |(index, row): &(usize, &Row)| {
        row.sha256.is_some() && rows[..*index].iter().all(|other| other.model != row.model)
    };
    let files = rows.iter().enumerate().filter(is_first);
    let count = |value: Option<u64>| value.map_or("-".to_owned(), |value| value.to_string());
    let cells = files.map(|(_, row)| {
        vec![
            row.model.clone(),
            optional(row.gmac, 2),
            count(row.params),
            count(row.nonzero_params),
            optional(row.file_bytes.map(|bytes| bytes as f64 / 1e6), 2),
            row.sha256
                .as_deref()
                .map_or("-", |hash| hash.get(..8).unwrap_or(hash))
                .to_owned(),
            optional(row.accuracy, 2),
            row.accuracy_frames
                .map_or("-".to_owned(), |frames| frames.to_string()),
            row.accuracy_name.unwrap_or("-").to_owned(),
        ]
    });
    table(&header, cells)
}

/// The other programs' speeds, and covista's over them.
pub(super) fn peer_table(rows: &[Row]) -> String {
    let header = [
        "against",
        "by",
        "stage",
        "images/s",
        "median, ms",
        "p95",
        "p99",
        "covista's speed, x",
        "found",
    ];
    let theirs = rows.iter().filter(|row| row.run_by != COVISTA);
    let cells = theirs.map(|row| {
        [
            vec![
                row.model.clone(),
                row.run_by.into(),
                row.stage.replace('_', " "),
            ],
            speeds(row),
            vec![
                optional(row.covista_speed_ratio, 3),
                optional(row.found_per_frame, 1),
            ],
        ]
        .concat()
    });
    table(&header, cells)
}

fn speeds(row: &Row) -> Vec<String> {
    vec![
        format!("{:.1}", row.img_per_s),
        format!("{:.2}", row.median_ms),
        format!("{:.2}", row.p95_ms),
        format!("{:.2}", row.p99_ms),
    ]
}

fn table(header: &[&str], cells: impl Iterator<Item = Vec<String>>) -> String {
    let header = header.iter().copied().map(String::from).collect();
    aligned(&std::iter::once(header).chain(cells).collect::<Vec<_>>())
}
