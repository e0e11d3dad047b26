//! Frames to time the networks on: read from a folder, or rendered at the start.

use covista_perception::BenchFrame;
use covista_sensors::kitti::{KittiFrame, read_cloud};
use covista_sensors::{CameraSettings, Lidar, RayScene, Viewpoint, take_picture};
use covista_traffic::{SampledScene, sample_scene};
use covista_world::{Calibration, SensorFrame};
use rayon::prelude::*;

use crate::evaluate::{EvaluateError, file_of, in_picture};
use crate::recorded::{FittedPicture, calibration_of, with_files};

/// Of the scenes that are rendered; no split of a data set has it.
const SEED: u64 = 0xBE7C;

/// `count` frames of random roads and streets as KITTI's rig sees them, always the same.
pub fn rendered_frames(count: u64) -> Vec<BenchFrame> {
    let (lidar, calibration) = (Lidar::hdl64e(), Calibration::kitti());
    let frame = |index: u64| {
        let SampledScene { scene, ego, .. } = sample_scene(SEED, index);
        let rays = RayScene::new(&scene);
        let view = Viewpoint::new(&scene, &rays, ego, &calibration)?;
        let sweep = lidar.sweep(&view, index);
        Some(BenchFrame {
            ahead: in_picture(&sweep, &calibration),
            measured: SensorFrame {
                time_s: scene.time_s,
                image: take_picture(&view, &CameraSettings::default(), index),
                points: sweep,
            },
            calibration,
        })
    };
    (0..count).into_par_iter().filter_map(frame).collect()
}

/// At most `most` of the frames that have a picture and a sweep, spread over all of them; pictures
/// are brought to the size that the lane network takes.
///
/// # Errors
/// No frame has both, or a file is unusable.
pub fn recorded_bench_frames(
    frames: &[KittiFrame],
    size_px: [u32; 2],
    most: usize,
) -> Result<Vec<BenchFrame>, EvaluateError> {
    let (whole, lacking) = with_files(
        frames,
        &[
            ("velodyne", |frame| &frame.cloud),
            ("image_2", |frame| &frame.image),
        ],
    );
    if whole.is_empty() {
        return Err(EvaluateError::none_with_files(&lacking));
    }
    let count = whole.len().min(most);
    let spread = (0..count).map(|at| whole[at * whole.len() / count]);
    spread
        .collect::<Vec<_>>()
        .into_par_iter()
        .map(|frame| read(frame, size_px))
        .collect()
}

fn read(frame: &KittiFrame, size_px: [u32; 2]) -> Result<BenchFrame, EvaluateError> {
    let sweep = read_cloud(file_of(&frame.cloud)?)?;
    let picture = FittedPicture::read(frame, size_px)?;
    let picture = picture.ok_or_else(|| EvaluateError::none_with_files(&[]))?;
    let mut calibration = calibration_of(frame)?;
    calibration.intrinsics.width_px = picture.original.width_px;
    calibration.intrinsics.height_px = picture.original.height_px;
    Ok(BenchFrame {
        ahead: in_picture(&sweep, &calibration),
        measured: SensorFrame {
            time_s: 0.0,
            image: picture.image,
            points: sweep,
        },
        calibration,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_are_rendered_are_always_the_same_and_differ_from_each_other() {
        let frames = rendered_frames(2);
        assert_eq!(frames, rendered_frames(2));
        let [first, second] = &frames[..] else {
            panic!("two frames");
        };
        assert_ne!(first.measured.points, second.measured.points);
        for frame in &frames {
            let SensorFrame { image, points, .. } = &frame.measured;
            assert_eq!([image.width_px, image.height_px], [1242, 375]);
            // KITTI's camera sees about a fifth of the turn.
            let share = frame.ahead.points.len() as f64 / points.points.len() as f64;
            assert!((0.05..0.4).contains(&share), "{share}");
            assert!(frame.ahead.points.iter().all(|point| point[0] > 0.0));
        }
    }
}
