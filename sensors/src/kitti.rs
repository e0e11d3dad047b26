//! Files in the layout of the KITTI object benchmark.

mod calibration;
mod folder;
mod label;

use std::path::Path;

use covista_world::{CameraImage, PointCloud};
use image::ImageReader;

pub use calibration::{calibration_text, read_calibration, read_rig};
pub use folder::{KittiFrame, kitti_frames};
pub use label::{KittiLabel, picture_box_px};

const POINT_BYTES: usize = 16;

/// Why a KITTI file can't be read or written.
#[derive(Debug, thiserror::Error)]
pub enum KittiError {
    /// The file system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Its reason.
        source: std::io::Error,
    },
    /// A point cloud is not a whole number of points.
    #[error(
        "{path} has {bytes} bytes, which is no multiple of the 16 bytes of a point: the file is truncated or no KITTI point cloud; copy or download it again"
    )]
    Truncated {
        /// The file.
        path: String,
        /// Its length.
        bytes: usize,
    },
    /// Some points have a number that is not finite.
    #[error(
        "{path}: {count} of {points} points have a coordinate or reflectance that is not finite, the first is point {first}; remove such points first"
    )]
    NotFinite {
        /// The file.
        path: String,
        /// How many such points.
        count: usize,
        /// Points in all.
        points: usize,
        /// The first such point, from 0.
        first: usize,
    },
    /// A file is empty, lacks an entry or has an unusable one.
    #[error("{path}: {what}")]
    Malformed {
        /// The file.
        path: String,
        /// What is wrong and what is expected.
        what: String,
    },
    /// A folder has no frame.
    #[error(
        "{0} holds no frame (velodyne/000000.bin, image_2/000000.png); name a folder in KITTI's layout, or write one with `covista dataset --out {0} --frames 100`"
    )]
    NoFrames(String),
}

pub(crate) fn io_error(path: &Path) -> impl Fn(std::io::Error) -> KittiError {
    let path = path.display().to_string();
    move |source| KittiError::Io {
        path: path.clone(),
        source,
    }
}

pub(crate) fn malformed<E: std::fmt::Display>(path: &Path) -> impl Fn(E) -> KittiError {
    let path = path.display().to_string();
    move |what| KittiError::Malformed {
        path: path.clone(),
        what: what.to_string(),
    }
}

/// Reads a velodyne `.bin`: x, y, z in metres in the LIDAR frame and the reflectance of each point.
///
/// # Errors
/// When the file can't be read, is empty or truncated or has a number that is not finite.
pub fn read_cloud(path: &Path) -> Result<PointCloud, KittiError> {
    let bytes = std::fs::read(path).map_err(io_error(path))?;
    if !bytes.len().is_multiple_of(POINT_BYTES) {
        return Err(KittiError::Truncated {
            path: path.display().to_string(),
            bytes: bytes.len(),
        });
    }
    if bytes.is_empty() {
        return Err(malformed(path)("the file is empty: a sweep has points"));
    }
    let (values, _) = bytes.as_chunks::<4>();
    let (points, _) = values.as_chunks::<4>();
    let points: Vec<[f32; 4]> = points
        .iter()
        .map(|point| point.map(f32::from_le_bytes))
        .collect();
    let is_bad = |point: &[f32; 4]| point.iter().any(|value| !value.is_finite());
    match points.iter().position(is_bad) {
        Some(first) => Err(KittiError::NotFinite {
            path: path.display().to_string(),
            count: points.iter().filter(|point| is_bad(point)).count(),
            points: points.len(),
            first,
        }),
        None => Ok(PointCloud { points }),
    }
}

/// The bytes of a velodyne `.bin`.
pub fn cloud_bytes(cloud: &PointCloud) -> Vec<u8> {
    let values = cloud.points.iter().flatten();
    values.flat_map(|value| value.to_le_bytes()).collect()
}

/// Reads the labels of a frame, `DontCare` regions included.
///
/// # Errors
/// When the file can't be read or a line is no label.
pub fn read_labels(path: &Path) -> Result<Vec<KittiLabel>, KittiError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    let lines = text.lines().enumerate();
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(index, line)| {
            line.parse()
                .map_err(|what: String| malformed(path)(format!("line {}: {what}", index + 1)))
        })
        .collect()
}

/// Reads a picture in PNG or JPEG.
///
/// # Errors
/// When the file can't be read or is no picture.
pub fn read_image(path: &Path) -> Result<CameraImage, KittiError> {
    let reader = ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(io_error(path))?;
    let image = reader.decode().map_err(malformed(path))?.into_rgb8();
    Ok(CameraImage {
        width_px: image.width(),
        height_px: image.height(),
        rgb: image.into_raw(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clouds_survive_their_bytes_and_broken_ones_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("000000.bin");
        let cloud = PointCloud {
            points: vec![[1.5, -2.25, 0.125, 0.5], [10.0, 0.0, -1.7, 0.0]],
        };
        let bytes = cloud_bytes(&cloud);
        std::fs::write(&path, &bytes).expect("written");
        assert_eq!(read_cloud(&path).expect("a cloud"), cloud);

        std::fs::write(&path, &bytes[..23]).expect("written");
        let message = read_cloud(&path).expect_err("truncated").to_string();
        assert!(message.contains("000000.bin has 23 bytes"), "{message}");

        let nan = PointCloud {
            points: vec![[0.0; 4], [0.0, f32::NAN, 0.0, 0.0]],
        };
        std::fs::write(&path, cloud_bytes(&nan)).expect("written");
        let message = read_cloud(&path).expect_err("refused").to_string();
        assert!(message.contains("1 of 2 points"), "{message}");
        assert!(message.contains("the first is point 1"), "{message}");
    }

    #[test]
    fn empty_sweeps_short_labels_and_torn_pictures_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("file");
        let message = |error: KittiError| error.to_string();
        std::fs::write(&path, b"").expect("written");
        let said = message(read_cloud(&path).expect_err("refused"));
        assert!(said.contains("the file is empty"), "{said}");
        assert_eq!(read_labels(&path).expect("no label"), []);
        assert!(read_image(&path).is_err());

        let label =
            "Car 0.00 0 1.74 741.18 168.83 792.25 208.43 1.70 1.63 4.08 7.24 1.55 33.20 1.95";
        std::fs::write(&path, format!("{label} 0.97\n{label}\nCar 0 0 1.74 7\n")).expect("written");
        let said = message(read_labels(&path).expect_err("refused"));
        assert!(
            said.contains("file: line 3: a label needs 15 columns and has 5"),
            "{said}"
        );

        std::fs::write(&path, b"\x89PNG\r\n\x1a\n").expect("written");
        assert!(message(read_image(&path).expect_err("refused")).contains("file: "));
    }
}
