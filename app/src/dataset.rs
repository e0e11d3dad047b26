use std::{ops::ControlFlow, sync::atomic::Ordering};

use anyhow::{Context, bail};
use covista_sensors::{DatasetSpec, lidar_of, stop_flag, write_dataset};
use covista_world::Calibration;
use indicatif::{ProgressBar, ProgressStyle};

use crate::{
    cli::DatasetArgs,
    output::{prepare_folder, say},
};

/// `covista dataset`.
pub fn run(args: &DatasetArgs) -> anyhow::Result<()> {
    if args.frames == 0 {
        bail!("--frames 0 makes no dataset; give at least 1");
    }
    let lidar = lidar_of(&args.lidar)?;
    let calibration = args.calibration.as_deref().map(Calibration::load);
    let spec = DatasetSpec {
        start: args.start,
        seed: args.seed,
        split: args.split,
        formats: args.format.iter().copied().collect(),
        truth: args.truth.iter().copied().collect(),
        lidar,
        calibration: calibration.transpose()?,
        ..DatasetSpec::new(args.out.clone(), args.frames)
    };
    prepare_folder(&args.out)?;
    let stop = stop_flag().context("cannot listen for Ctrl-C")?;
    let bar = frame_bar();
    let written = write_dataset(&spec, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
        match stop.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    });
    bar.finish_and_clear();
    let found = written?.frames;
    let out = args.out.display();
    if found > args.frames {
        let asked = args.frames;
        say(&format!(
            "{found} frames in {out}: the {asked} asked for and others made before, all listed"
        ))
    } else {
        say(&format!("{found} frames in {out}"))
    }
}

/// Progress by frames, on stderr.
pub fn frame_bar() -> ProgressBar {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} frames, {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}
