//! Recorded frames: what a folder in KITTI's layout or a single file holds, for the networks.

use std::path::{Path, PathBuf};

use covista_sensors::kitti::{KittiError, KittiFrame, read_calibration, read_image};
use covista_world::{Calibration, CameraImage};
use image::RgbImage;
use image::imageops::{FilterType, resize};

/// A picture whose sides are to each other as the network's, to this share, is resized to it:
/// KITTI's own differ by some pixels.
const SHAPE_TOLERANCE: f64 = 0.02;

/// Why a recorded frame can't be used.
#[derive(Debug, thiserror::Error)]
pub enum RecordedError {
    /// A file is missing or unusable.
    #[error(transparent)]
    Kitti(#[from] KittiError),
    /// The picture can't be made the lane network's without bending it.
    #[error(
        "{path} is {}x{} pixels and the lane network takes {}x{}, or another size of that shape to 2 %: crop or record it so", found[0], found[1], expected[0], expected[1]
    )]
    PictureShape {
        /// The file.
        path: String,
        /// Its width and height.
        found: [u32; 2],
        /// The network's.
        expected: [u32; 2],
    },
}

/// A picture in the size that the lane network takes.
#[derive(Debug, Clone)]
pub struct FittedPicture {
    /// The picture.
    pub image: CameraImage,
    /// How many times as wide and as high as in the file it is.
    pub scale: [f64; 2],
}

impl FittedPicture {
    /// Reads a picture and resizes it, bilinearly, where it differs from `size_px` by little.
    ///
    /// # Errors
    /// When the file is unusable or the picture has another shape.
    pub fn read(path: &Path, size_px: [u32; 2]) -> Result<Self, RecordedError> {
        let image = read_image(path)?;
        let found = [image.width_px, image.height_px];
        let scale = [0, 1].map(|side| f64::from(size_px[side]) / f64::from(found[side]));
        if (scale[0] / scale[1] - 1.0).abs() > SHAPE_TOLERANCE {
            return Err(RecordedError::PictureShape {
                path: path.display().to_string(),
                found,
                expected: size_px,
            });
        }
        Ok(Self {
            image: resized(image, size_px),
            scale,
        })
    }

    /// The calibration of the resized picture.
    pub fn fit(&self, mut calibration: Calibration) -> Calibration {
        let camera = &mut calibration.intrinsics;
        let [across, down] = self.scale;
        camera.width_px = self.image.width_px;
        camera.height_px = self.image.height_px;
        camera.fx_px *= across;
        camera.cx_px *= across;
        camera.fy_px *= down;
        camera.cy_px *= down;
        calibration
    }
}

fn resized(image: CameraImage, size_px: [u32; 2]) -> CameraImage {
    let [width_px, height_px] = size_px;
    if [image.width_px, image.height_px] == size_px {
        return image;
    }
    let rgb = RgbImage::from_raw(image.width_px, image.height_px, image.rgb)
        .map(|picture| resize(&picture, width_px, height_px, FilterType::Triangle).into_raw())
        .unwrap_or_default();
    CameraImage {
        width_px,
        height_px,
        rgb,
    }
}

/// The calibration of a frame: its file's, or KITTI's where it has none.
///
/// # Errors
/// When the file is unusable.
pub fn calibration_of(frame: &KittiFrame) -> Result<Calibration, KittiError> {
    match &frame.calibration {
        Some(path) => read_calibration(path),
        None => Ok(Calibration::kitti()),
    }
}

/// A file that is needed: its folder, and where a frame holds it.
type Needed = (&'static str, fn(&KittiFrame) -> &Option<PathBuf>);

/// The frames that have all the files named, and for each file how many lack it.
pub(crate) fn with_files<'a>(
    frames: &'a [KittiFrame],
    needed: &[Needed],
) -> (Vec<&'a KittiFrame>, Vec<Lacking>) {
    let has_all = |frame: &&KittiFrame| needed.iter().all(|(_, file)| file(frame).is_some());
    let whole: Vec<&KittiFrame> = frames.iter().filter(has_all).collect();
    let lacking = needed.iter().map(|&(file, of)| Lacking {
        file,
        frames: frames.iter().filter(|frame| of(frame).is_none()).count(),
    });
    (
        whole,
        lacking.filter(|lacking| lacking.frames > 0).collect(),
    )
}

/// Frames that could not be used for want of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Lacking {
    /// The folder of the file.
    pub file: &'static str,
    /// How many frames.
    pub frames: usize,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_kittis_sizes_are_fitted_and_others_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("picture.png");
        let expected = [1242, 375];
        for found in [[1242, 375], [1224, 370], [1238, 374], [1241, 376]] {
            // Red grows by one level every eight columns.
            let pixel = |u: u32, _| image::Rgb([(u / 8) as u8, 7, 9]);
            RgbImage::from_fn(found[0], found[1], pixel)
                .save(&path)
                .expect("written");
            let fitted = FittedPicture::read(&path, expected).expect("a picture");
            assert_eq!([fitted.image.width_px, fitted.image.height_px], expected);
            let red = fitted.image.rgb[3 * (100 * 1242 + 800)];
            let source_u = 800.0 / fitted.scale[0];
            assert!(
                (f64::from(red) - source_u / 8.0).abs() <= 1.1,
                "{found:?}: {red}"
            );
            let scaled = fitted.fit(Calibration::kitti()).intrinsics;
            let own = Calibration::kitti().intrinsics;
            assert!((scaled.cx_px - own.cx_px * fitted.scale[0]).abs() < 1e-9);
        }
        RgbImage::new(640, 480).save(&path).expect("written");
        let said = FittedPicture::read(&path, expected)
            .expect_err("refused")
            .to_string();
        assert!(
            said.contains("640x480") && said.contains("1242x375"),
            "{said}"
        );
    }
}
