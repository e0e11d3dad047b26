//! Data sets: random scenes, measured by LIDAR and camera at the same time stamp, with KITTI's and
//! TuSimple's labels.

mod description;
mod error;
mod folder;
mod frame;
mod manifest;
mod scene_file;
mod spec;
mod truth_files;

use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

pub use error::DatasetError;
pub use manifest::Manifest;
pub use scene_file::{RecordedVehicle, SceneFile, read_scene};
pub use spec::{DatasetSpec, Format, Split, TruthFile, lidar_of};

use folder::Folder;
use frame::FrameMaker;

/// As many as KITTI's file names of six digits can number.
const MOST_FRAMES: u64 = 1_000_000;
/// Frames for each thread between two listings of what is finished, at the least.
const LEAST_FRAMES_PER_THREAD: usize = 8;

/// Writes the frames that are not there yet, in parallel, and tells `progress` (frames done, frames
/// in all) after each; it stops when `progress` says so.
///
/// A frame's files are named by its number: `velodyne/000007.bin`, `image_2/000007.png`,
/// `calib/000007.txt`, `label_2/000007.txt`, `lanes/000007.json`, and `scenes/000007.json` with
/// what it was drawn from, written last. `ImageSets/train.txt`, `label_data.json` and
/// `manifest.json` list all finished frames; they are renewed from time to time and whenever this
/// function returns, so that the folder is a valid data set at any time.
///
/// # Errors
/// When there are too many frames, a file can't be written, the folder holds something else or is in
/// use, or it is stopped.
/// What is finished stays, and the next call goes on from there.
pub fn write_dataset(
    spec: &DatasetSpec,
    progress: impl Fn(usize, usize) -> ControlFlow<()> + Sync,
) -> Result<Manifest, DatasetError> {
    let frames = spec.start..spec.start.saturating_add(spec.frames);
    if frames.end > MOST_FRAMES {
        return Err(DatasetError::TooMany {
            start: spec.start,
            frames: spec.frames,
        });
    }
    let folder = Folder::claim(spec)?;
    let maker = FrameMaker::new(spec);
    let total = spec.frames as usize;
    let missing: Vec<u64> = frames.filter(|&frame| !folder.has(frame)).collect();
    let done = AtomicUsize::new(total - missing.len());
    let make = |&frame: &u64| {
        folder.write_frame(&maker.measure(frame)?)?;
        let now_done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if progress(now_done, total).is_break() && now_done < total {
            return Err(DatasetError::Stopped {
                path: spec.out.display().to_string(),
                done: now_done,
                frames: total,
            });
        }
        Ok(())
    };
    let mut manifest = folder.list_finished();
    let mut rest = missing.as_slice();
    while let (Ok(_), false) = (&manifest, rest.is_empty()) {
        let (now, later) = rest.split_at(frames_until_listing(done.load(Ordering::Relaxed), rest));
        let made = now.par_iter().try_for_each(make);
        let listed = folder.list_finished();
        manifest = made.and(listed);
        rest = later;
    }
    let stopped_at = done.load(Ordering::Relaxed);
    manifest = manifest.map_err(|error| match error {
        // Other threads have finished theirs in the meantime.
        DatasetError::Stopped { path, frames, .. } => DatasetError::Stopped {
            path,
            done: stopped_at,
            frames,
        },
        other => other,
    });
    if spec.has_mcap() && matches!(manifest, Ok(_) | Err(DatasetError::Stopped { .. })) {
        folder.write_mcap()?;
    }
    manifest
}

/// A flag that Ctrl-C, or a request to end, sets from now on instead of ending the process.
///
/// # Errors
/// When the system refuses.
pub fn stop_flag() -> std::io::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&flag))?;
    }
    Ok(flag)
}

/// Listing takes as long as there are frames: its share stays the same when the steps grow, too.
fn frames_until_listing(done: usize, rest: &[u64]) -> usize {
    let least = LEAST_FRAMES_PER_THREAD * rayon::current_num_threads();
    least.max(done / 4).min(rest.len())
}

#[cfg(test)]
mod tests;
