use anyhow::bail;
use covista_sensors::{DatasetSpec, Split, write_dataset};
use indicatif::{ProgressBar, ProgressStyle};

use crate::{
    cli::{DatasetArgs, SplitArg},
    output::{prepare_folder, say},
};

/// `covista dataset`.
pub fn run(args: &DatasetArgs) -> anyhow::Result<()> {
    if args.frames == 0 {
        bail!("--frames 0 makes no dataset; give at least 1");
    }
    prepare_folder(&args.out)?;
    let spec = DatasetSpec {
        out: args.out.clone(),
        frames: args.frames,
        start: 0,
        seed: args.seed,
        split: match args.split {
            SplitArg::Train => Split::Train,
            SplitArg::Val => Split::Val,
            SplitArg::Test => Split::Test,
        },
    };
    let bar = ProgressBar::new(args.frames);
    if let Ok(style) = ProgressStyle::with_template("[{bar:40}] {pos}/{len} frames, {eta} left") {
        bar.set_style(style.progress_chars("=> "));
    }
    write_dataset(&spec, |done, _| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    say(&format!("{} frames in {}", args.frames, args.out.display()))?;
    Ok(())
}
