//! Writes a data set of random scenes: LIDAR and camera with KITTI's and TuSimple's labels.

use std::process::ExitCode;
use std::time::Instant;

use covista_sensors::{DatasetSpec, Split, write_dataset};

const USAGE: &str =
    "usage: covista-dataset --out DIR --frames N [--start N] [--seed N] [--split train|val|test]";

fn main() -> ExitCode {
    let spec = match parse(std::env::args().skip(1)) {
        Ok(spec) => spec,
        Err(message) => {
            eprintln!("{message}\n{USAGE}");
            return ExitCode::from(2);
        }
    };
    let began = Instant::now();
    let report = |done: usize, total: usize| {
        if done.is_multiple_of(50) || done == total {
            let seconds = began.elapsed().as_secs_f64();
            eprintln!(
                "{done}/{total} frames, {:.2} a second",
                done as f64 / seconds
            );
        }
    };
    match write_dataset(&spec, report) {
        Ok(_) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn parse(mut arguments: impl Iterator<Item = String>) -> Result<DatasetSpec, String> {
    let mut spec = DatasetSpec {
        out: Default::default(),
        frames: 0,
        start: 0,
        seed: 1,
        split: Split::Train,
    };
    while let Some(name) = arguments.next() {
        let value = arguments
            .next()
            .ok_or_else(|| format!("{name} needs a value"))?;
        let number = || {
            value
                .parse::<u64>()
                .map_err(|_| format!("{name} needs a whole number, not `{value}`"))
        };
        match name.as_str() {
            "--out" => spec.out = value.into(),
            "--frames" => spec.frames = number()?,
            "--start" => spec.start = number()?,
            "--seed" => spec.seed = number()?,
            "--split" => spec.split = value.parse()?,
            _ => return Err(format!("there is no option {name}")),
        }
    }
    if spec.out.as_os_str().is_empty() || spec.frames == 0 {
        return Err("--out and --frames are needed".to_owned());
    }
    Ok(spec)
}
