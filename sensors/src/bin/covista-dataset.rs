//! Writes a data set of random scenes: LIDAR and camera with KITTI's and TuSimple's labels.

use std::ops::ControlFlow;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::Instant;

use covista_sensors::{DatasetSpec, lidar_of, stop_flag, write_dataset};
use covista_world::Calibration;

const USAGE: &str = "usage: covista-dataset --out DIR --frames N [--start N] [--seed N] \
                     [--split train|val|test] [--format kitti,tusimple,mcap] \
                     [--truth points,depth,instance] \
                     [--lidar NAME|FILE.toml] [--calibration FILE.toml]";

fn main() -> ExitCode {
    let spec = match parse(std::env::args().skip(1)) {
        Ok(spec) => spec,
        Err(message) => {
            eprintln!("{message}");
            return ExitCode::from(2);
        }
    };
    match write(&spec) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

fn write(spec: &DatasetSpec) -> Result<(), Box<dyn std::error::Error>> {
    let stop = stop_flag()?;
    let began = Instant::now();
    let manifest = write_dataset(spec, |done, total| {
        if done.is_multiple_of(50) || done == total {
            let seconds = began.elapsed().as_secs_f64();
            eprintln!("{done}/{total} frames after {seconds:.0} s");
        }
        match stop.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    eprintln!("{} frames in {}", manifest.frames, spec.out.display());
    Ok(())
}

fn parse(mut arguments: impl Iterator<Item = String>) -> Result<DatasetSpec, String> {
    let mut spec = DatasetSpec::new(Default::default(), 0);
    while let Some(name) = arguments.next() {
        let value = arguments
            .next()
            .ok_or_else(|| format!("{name} needs a value\n{USAGE}"))?;
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
            "--format" => {
                spec.formats = value.split(',').map(str::parse).collect::<Result<_, _>>()?;
            }
            "--truth" => {
                spec.truth = value.split(',').map(str::parse).collect::<Result<_, _>>()?;
            }
            "--calibration" => {
                let loaded = Calibration::load(value.as_ref());
                spec.calibration = Some(loaded.map_err(|error| error.to_string())?);
            }
            "--lidar" => spec.lidar = lidar_of(&value).map_err(|error| error.to_string())?,
            _ => return Err(format!("there is no option {name}\n{USAGE}")),
        }
    }
    if spec.out.as_os_str().is_empty() || spec.frames == 0 {
        return Err(format!("--out and --frames are needed\n{USAGE}"));
    }
    Ok(spec)
}
