//! Recorded frames: what a folder in KITTI's layout or a single file holds, for the networks.

use std::path::{Path, PathBuf};

use covista_perception::lanes::view::LaneView;
use covista_sensors::kitti::{KittiError, KittiFrame, read_calibration, read_image};
use covista_world::{Calibration, CalibrationError, CameraImage};
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
    /// A calibration in TOML is unusable.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// The picture can't be made the lane network's without bending it.
    #[error(
        "{path} is {}x{} pixels and the lane network takes {}x{}, or another size of that shape to 2 %: crop or record it so, or name its camera with --calibration FILE.toml", found[0], found[1], expected[0], expected[1]
    )]
    PictureShape {
        /// The file.
        path: String,
        /// Its width and height.
        found: [u32; 2],
        /// The network's.
        expected: [u32; 2],
    },
    /// The picture is not from the camera that its calibration describes.
    #[error(
        "{path} is {}x{} pixels and its calibration {calibration} is for {}x{}: name that of its camera at this size", found[0], found[1], expected[0], expected[1]
    )]
    PictureSize {
        /// The file.
        path: String,
        /// Its width and height.
        found: [u32; 2],
        /// The calibration's file.
        calibration: String,
        /// Its width and height.
        expected: [u32; 2],
    },
    /// The camera sees no horizon.
    #[error("the camera of {0} looks straight up or down: no lane marks can be found there")]
    NoHorizon(String),
}

/// A picture as the lane network takes it.
#[derive(Debug, Clone)]
pub struct FittedPicture {
    /// The picture in the file.
    pub original: CameraImage,
    /// The one for the network.
    pub image: CameraImage,
    fit: Fit,
}

/// How a picture was made the network's.
#[derive(Debug, Clone)]
enum Fit {
    /// Resized: this many times as wide and as high as in the file.
    Resized([f64; 2]),
    /// Seen through the camera that its calibration in TOML describes.
    Cut(LaneView),
}

impl FittedPicture {
    /// Reads the picture of a frame, if it has one. With a calibration in TOML it may be of any
    /// camera and is brought into the network's view ([`LaneView`]); else it is resized,
    /// bilinearly, where it differs from `size_px` by little.
    ///
    /// # Errors
    /// When a file is unusable, or the picture has another shape or not its calibration's size.
    pub fn read(frame: &KittiFrame, size_px: [u32; 2]) -> Result<Option<Self>, RecordedError> {
        let Some(path) = &frame.image else {
            return Ok(None);
        };
        let original = read_image(path)?;
        let found = [original.width_px, original.height_px];
        let path = path.display().to_string();
        let (image, fit) = if let Some(camera) = toml_of(frame) {
            let calibration = Calibration::load(camera)?;
            let expected = [
                calibration.intrinsics.width_px,
                calibration.intrinsics.height_px,
            ];
            let camera = camera.display().to_string();
            if found != expected {
                return Err(RecordedError::PictureSize {
                    path,
                    found,
                    calibration: camera,
                    expected,
                });
            }
            let view =
                LaneView::new(&calibration, size_px).ok_or(RecordedError::NoHorizon(camera))?;
            (view.cut(&original), Fit::Cut(view))
        } else {
            let scale = [0, 1].map(|side| f64::from(size_px[side]) / f64::from(found[side]));
            if (scale[0] / scale[1] - 1.0).abs() > SHAPE_TOLERANCE {
                return Err(RecordedError::PictureShape {
                    path,
                    found,
                    expected: size_px,
                });
            }
            (resized(&original, size_px), Fit::Resized(scale))
        };
        Ok(Some(Self {
            original,
            image,
            fit,
        }))
    }

    /// The pixel (u, v) of the file that a pixel of the network's picture shows.
    pub fn in_file(&self, [u_px, v_px]: [f64; 2]) -> Option<[f64; 2]> {
        match &self.fit {
            Fit::Resized([across, down]) => Some([u_px / across, v_px / down]),
            Fit::Cut(view) => view.in_photograph([u_px, v_px]),
        }
    }

    /// The pixel (u, v) of the network's picture that shows a pixel of the file.
    pub fn in_network(&self, [u_px, v_px]: [f64; 2]) -> Option<[f64; 2]> {
        match &self.fit {
            Fit::Resized([across, down]) => Some([u_px * across, v_px * down]),
            Fit::Cut(view) => view.in_view([u_px, v_px]),
        }
    }
}

fn resized(image: &CameraImage, size_px: [u32; 2]) -> CameraImage {
    let [width_px, height_px] = size_px;
    if [image.width_px, image.height_px] == size_px {
        return image.clone();
    }
    let rgb = RgbImage::from_raw(image.width_px, image.height_px, image.rgb.clone())
        .map(|picture| resize(&picture, width_px, height_px, FilterType::Triangle).into_raw())
        .unwrap_or_default();
    CameraImage {
        width_px,
        height_px,
        rgb,
    }
}

/// The calibration of a frame: that of its file, TOML or KITTI's text, or KITTI's own where it has
/// none.
///
/// # Errors
/// When the file is unusable.
pub fn calibration_of(frame: &KittiFrame) -> Result<Calibration, RecordedError> {
    match (toml_of(frame), &frame.calibration) {
        (Some(path), _) => Ok(Calibration::load(path)?),
        (None, Some(path)) => Ok(read_calibration(path)?),
        (None, None) => Ok(Calibration::kitti()),
    }
}

/// The file that describes the frame's camera, where it is TOML and not KITTI's text.
fn toml_of(frame: &KittiFrame) -> Option<&Path> {
    let path = frame.calibration.as_deref()?;
    (path.extension()? == "toml").then_some(path)
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

    const SIZE_PX: [u32; 2] = [1242, 375];

    /// A frame of a picture whose red grows by one level every eight columns.
    fn frame(folder: &Path, size: [u32; 2]) -> KittiFrame {
        let path = folder.join("picture.png");
        RgbImage::from_fn(size[0], size[1], |u, _| image::Rgb([(u / 8) as u8, 7, 9]))
            .save(&path)
            .expect("written");
        KittiFrame {
            image: Some(path),
            ..KittiFrame::default()
        }
    }

    fn with_calibration(folder: &Path, size: [u32; 2], name: &str, text: &str) -> KittiFrame {
        let path = folder.join(name);
        std::fs::write(&path, text).expect("written");
        KittiFrame {
            calibration: Some(path),
            ..frame(folder, size)
        }
    }

    fn refusal(frame: &KittiFrame) -> String {
        let refused = FittedPicture::read(frame, SIZE_PX).expect_err("refused");
        let said = refused.to_string();
        assert!(!said.contains('\n'), "{said}");
        said
    }

    #[test]
    fn pictures_of_kittis_sizes_are_fitted_and_others_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        for found in [[1242, 375], [1224, 370], [1238, 374], [1241, 376]] {
            let frame = frame(folder.path(), found);
            let fitted = FittedPicture::read(&frame, SIZE_PX).expect("usable");
            let fitted = fitted.expect("a picture");
            assert_eq!([fitted.image.width_px, fitted.image.height_px], SIZE_PX);
            assert_eq!(fitted.original.width_px, found[0]);
            let red = fitted.image.rgb[3 * (100 * 1242 + 800)];
            let [source_u, _] = fitted.in_file([800.0, 100.0]).expect("a pixel");
            assert!(
                (f64::from(red) - source_u / 8.0).abs() <= 1.1,
                "{found:?}: {red}"
            );
            let [u, v] = fitted.in_network([source_u, 0.0]).expect("a pixel");
            assert!((u - 800.0).abs() < 1e-9 && v.abs() < 1e-9);
        }
        let said = refusal(&frame(folder.path(), [640, 480]));
        assert!(
            said.contains("640x480") && said.contains("1242x375"),
            "{said}"
        );
    }

    #[test]
    fn a_picture_of_any_camera_is_brought_into_the_networks_view() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path();
        let windscreen = include_str!("../../assets/calibration/windscreen-1280x720.toml");
        let frame = with_calibration(folder, [1280, 720], "camera.toml", windscreen);
        let fitted = FittedPicture::read(&frame, SIZE_PX).expect("usable");
        let fitted = fitted.expect("a picture");
        let [u, v] = fitted.in_file([800.0, 200.0]).expect("a pixel");
        assert!(
            (u - 824.49).abs() < 0.01 && (v - 448.6).abs() < 0.1,
            "{u} {v}"
        );
        let red = fitted.image.rgb[3 * (200 * 1242 + 800)];
        assert!((f64::from(red) - u / 8.0).abs() <= 1.1, "{red}");
        assert_eq!(
            calibration_of(&frame).expect("TOML").intrinsics.width_px,
            1280
        );

        let said = refusal(&with_calibration(
            folder,
            [960, 540],
            "camera.toml",
            windscreen,
        ));
        for part in ["picture.png", "960x540", "camera.toml", "1280x720"] {
            assert!(said.contains(part), "{said}");
        }
        let upwards = windscreen.replace("pitch_deg = 3.0", "pitch_deg = 90.0");
        let said = refusal(&with_calibration(
            folder,
            [1280, 720],
            "camera.toml",
            &upwards,
        ));
        assert!(said.contains("straight up"), "{said}");
        let torn = windscreen.replace("fx_px", "f_px");
        let said = refusal(&with_calibration(folder, [1280, 720], "camera.toml", &torn));
        assert!(said.contains("f_px"), "{said}");
    }
}
