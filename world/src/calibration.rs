use std::io;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A pinhole camera without distortion (KITTI's rectified camera 2 by default).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraIntrinsics {
    /// Pixels across.
    pub width_px: u32,
    /// Pixels down.
    pub height_px: u32,
    /// Focal length along u in pixels.
    pub fx_px: f64,
    /// Focal length along v in pixels.
    pub fy_px: f64,
    /// Principal point u in pixels.
    pub cx_px: f64,
    /// Principal point v in pixels.
    pub cy_px: f64,
}

impl CameraIntrinsics {
    /// KITTI's camera 2: 1242x375, f = 721.5 px.
    pub const KITTI: Self = Self {
        width_px: 1242,
        height_px: 375,
        fx_px: 721.5377,
        fy_px: 721.5377,
        cx_px: 609.5593,
        cy_px: 172.854,
    };

    /// Pixel (u, v) of a point in the camera frame, or `None` at or behind the camera.
    ///
    /// The pixel may lie outside the image.
    pub fn project(&self, point: &Point3<f64>) -> Option<[f64; 2]> {
        (point.z > 0.05).then(|| {
            [
                self.fx_px * point.x / point.z + self.cx_px,
                self.fy_px * point.y / point.z + self.cy_px,
            ]
        })
    }

    /// Direction, not normalised, of the ray through pixel (u, v) in the camera frame.
    pub fn ray(&self, u_px: f64, v_px: f64) -> Vector3<f64> {
        Vector3::new(
            (u_px - self.cx_px) / self.fx_px,
            (v_px - self.cy_px) / self.fy_px,
            1.0,
        )
    }
}

/// Where the sensors sit on the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// The camera's pinhole.
    pub intrinsics: CameraIntrinsics,
    /// LIDAR frame to vehicle frame.
    pub vehicle_from_lidar: Isometry3<f64>,
    /// Camera frame to vehicle frame.
    pub vehicle_from_camera: Isometry3<f64>,
}

impl Calibration {
    /// KITTI's mounting: the LIDAR 1.73 m up above the body's middle, the camera 0.27 m ahead of
    /// it and 0.08 m below, both level.
    pub fn kitti() -> Self {
        let lidar = Vector3::new(0.9, 0.0, 1.73);
        Self {
            intrinsics: CameraIntrinsics::KITTI,
            vehicle_from_lidar: Isometry3::from_parts(
                Translation3::from(lidar),
                UnitQuaternion::identity(),
            ),
            vehicle_from_camera: Isometry3::from_parts(
                Translation3::from(lidar + Vector3::new(0.27, 0.0, -0.08)),
                level_camera(),
            ),
        }
    }

    /// LIDAR frame to camera frame (KITTI's `Tr_velo_to_cam`).
    pub fn camera_from_lidar(&self) -> Isometry3<f64> {
        self.vehicle_from_camera.inverse() * self.vehicle_from_lidar
    }

    /// Reads a calibration from a TOML file; see [`Calibration::parse`].
    ///
    /// # Errors
    /// When the file cannot be read, is no such table or holds a value no camera can have.
    pub fn load(path: &Path) -> Result<Self, CalibrationError> {
        let text = std::fs::read_to_string(path).map_err(|source| CalibrationError::Read {
            path: path.to_path_buf(),
            source,
        })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// The calibration in a TOML text; `origin` names it in errors.
    ///
    /// `[camera]` holds `width_px`, `height_px`, `fx_px`, `fy_px`, `cx_px`, `cy_px`, `position_m`
    /// (x, y, z in the vehicle frame) and, where the camera is not level and straight ahead,
    /// `yaw_deg` (to the left), `pitch_deg` (up) and `roll_deg` (to the right, as a vehicle that
    /// leans that way). `[lidar]` holds `position_m`.
    ///
    /// # Errors
    /// When the text is no such table or holds a value no camera can have.
    pub fn parse(text: &str, origin: &str) -> Result<Self, CalibrationError> {
        let file: CalibrationFile = toml::from_str(text).map_err(|error| {
            let line = error.span().map_or(1, |span| {
                1 + text[..span.start.min(text.len())].matches('\n').count()
            });
            CalibrationError::Parse {
                origin: origin.to_owned(),
                line,
                message: error.message().replace('\n', " "),
            }
        })?;
        file.camera
            .check()
            .and_then(|()| on_a_vehicle("lidar.position_m", &file.lidar.position_m))
            .map_err(|wrong| wrong.within(origin))?;
        Ok(Self {
            intrinsics: file.camera.intrinsics(),
            vehicle_from_lidar: Translation3::from(file.lidar.position_m).into(),
            vehicle_from_camera: Isometry3::from_parts(
                Translation3::from(file.camera.position_m),
                file.camera.turn() * level_camera(),
            ),
        })
    }
}

/// Axes of a camera that looks straight ahead: its x is the vehicle's right, its y down, its z
/// forward.
fn level_camera() -> UnitQuaternion<f64> {
    let axes = Rotation3::from_matrix_unchecked(Matrix3::new(
        0.0, 0.0, 1.0, //
        -1.0, 0.0, 0.0, //
        0.0, -1.0, 0.0,
    ));
    UnitQuaternion::from_rotation_matrix(&axes)
}

/// Why a calibration cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The file cannot be read.
    #[error("cannot read the calibration {}: {source}; check the path", path.display())]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The text is no TOML, or lacks a field, or has one that is not known.
    #[error("calibration {origin}, line {line}: {message}; correct this line")]
    Parse {
        /// Which file.
        origin: String,
        /// Which line, from 1.
        line: usize,
        /// What is wrong with it.
        message: String,
    },
    /// A value that no sensor can have.
    #[error("calibration {origin}: {field} is {value}; it must be {wanted}")]
    BadValue {
        /// Which file.
        origin: String,
        /// Which field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        wanted: &'static str,
    },
}

/// A value that no sensor can have.
struct Wrong {
    field: &'static str,
    value: f64,
    wanted: &'static str,
}

impl Wrong {
    fn within(self, origin: &str) -> CalibrationError {
        CalibrationError::BadValue {
            origin: origin.to_owned(),
            field: self.field,
            value: self.value,
            wanted: self.wanted,
        }
    }
}

/// Farthest that a sensor may sit from the vehicle's origin along any axis, in metres.
const REACH_M: f64 = 50.0;
/// The largest image side that is accepted.
const LARGEST_PX: u32 = 16_384;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationFile {
    camera: CameraFile,
    lidar: LidarFile,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LidarFile {
    position_m: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    width_px: u32,
    height_px: u32,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    position_m: [f64; 3],
    #[serde(default)]
    yaw_deg: f64,
    #[serde(default)]
    pitch_deg: f64,
    #[serde(default)]
    roll_deg: f64,
}

impl CameraFile {
    fn check(&self) -> Result<(), Wrong> {
        for (field, size) in [
            ("camera.width_px", self.width_px),
            ("camera.height_px", self.height_px),
        ] {
            if !(1..=LARGEST_PX).contains(&size) {
                return Err(Wrong {
                    field,
                    value: f64::from(size),
                    wanted: "from 1 to 16384",
                });
            }
        }
        for (field, value) in [("camera.fx_px", self.fx_px), ("camera.fy_px", self.fy_px)] {
            if !(value.is_finite() && value >= 1.0) {
                return Err(Wrong {
                    field,
                    value,
                    wanted: "a focal length of at least one pixel",
                });
            }
        }
        finite("camera.cx_px", &[self.cx_px])?;
        finite("camera.cy_px", &[self.cy_px])?;
        on_a_vehicle("camera.position_m", &self.position_m)?;
        finite("camera.yaw_deg", &[self.yaw_deg])?;
        finite("camera.pitch_deg", &[self.pitch_deg])?;
        finite("camera.roll_deg", &[self.roll_deg])
    }

    fn intrinsics(&self) -> CameraIntrinsics {
        CameraIntrinsics {
            width_px: self.width_px,
            height_px: self.height_px,
            fx_px: self.fx_px,
            fy_px: self.fy_px,
            cx_px: self.cx_px,
            cy_px: self.cy_px,
        }
    }

    fn turn(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(
            self.roll_deg.to_radians(),
            -self.pitch_deg.to_radians(),
            self.yaw_deg.to_radians(),
        )
    }
}

/// Sensors sit above the ground and within reach of the vehicle that carries them.
fn on_a_vehicle(field: &'static str, position_m: &[f64; 3]) -> Result<(), Wrong> {
    finite(field, position_m)?;
    let far = position_m.iter().find(|value| value.abs() > REACH_M);
    match far.or((position_m[2] <= 0.0).then_some(&position_m[2])) {
        Some(&value) => Err(Wrong {
            field,
            value,
            wanted: "at most 50 m from the rear axle and above the ground",
        }),
        None => Ok(()),
    }
}

fn finite(field: &'static str, values: &[f64]) -> Result<(), Wrong> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(Wrong {
            field,
            value,
            wanted: "a finite number",
        }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KITTI: &str = include_str!("../../assets/calibration/kitti.toml");
    const WINDSCREEN: &str = include_str!("../../assets/calibration/windscreen-1280x720.toml");

    #[test]
    fn a_point_straight_ahead_projects_to_the_principal_point() {
        let calibration = Calibration::kitti();
        let ahead = calibration.vehicle_from_camera * Point3::new(0.0, 0.0, 10.0);
        assert!((ahead.x - 11.17).abs() < 1e-9 && ahead.y.abs() < 1e-9);
        let camera = calibration.camera_from_lidar() * Point3::new(20.0, 5.0, -1.73);
        assert!((camera.x + 5.0).abs() < 1e-9 && (camera.y - 1.65).abs() < 1e-9);
        let [u, v] = CameraIntrinsics::KITTI
            .project(&Point3::new(0.0, 0.0, 3.0))
            .expect("in front");
        assert!((u - 609.5593).abs() < 1e-9 && (v - 172.854).abs() < 1e-9);
    }

    #[test]
    fn the_shipped_files_are_what_they_say() {
        assert_eq!(
            Calibration::parse(KITTI, "kitti").expect("KITTI's"),
            Calibration::kitti()
        );
        let windscreen = Calibration::parse(WINDSCREEN, "windscreen").expect("the windscreen's");
        assert_eq!(windscreen.intrinsics.width_px, 1280);
        let eye = windscreen.vehicle_from_camera.translation;
        assert!((eye.z - 1.3).abs() < 1e-9);
    }

    #[test]
    fn yaw_is_left_pitch_up_and_roll_to_the_right() {
        let turned = |field: &str| {
            let text = KITTI.replace("[lidar]", &format!("{field}_deg = 10.0\n[lidar]"));
            let calibration = Calibration::parse(&text, "turned").expect("a calibration");
            calibration.vehicle_from_camera.rotation
        };
        assert!((turned("yaw") * Vector3::z()).y > 0.17);
        assert!((turned("pitch") * Vector3::z()).z > 0.17);
        assert!((turned("roll") * Vector3::x()).z < -0.17);
    }

    #[test]
    fn what_no_camera_can_have_is_refused_in_one_line() {
        let with = |from: &str, to: &str| {
            assert!(KITTI.contains(from), "{from}");
            let refused = Calibration::parse(&KITTI.replace(from, to), "mine.toml").expect_err(to);
            let message = refused.to_string();
            assert!(!message.contains('\n'), "{message}");
            assert!(message.starts_with("calibration mine.toml"), "{message}");
            message
        };
        assert!(with("fx_px = 721.5377", "fx_px = 0.0").contains("fx_px"));
        assert!(with("fy_px = 721.5377", "fy_px = nan").contains("fy_px"));
        assert!(with("width_px = 1242", "width_px = 0").contains("from 1"));
        assert!(with("cy_px = 172.854", "cy_px = inf").contains("finite"));
        assert!(with("0.9, 0.0, 1.73", "0.9, 0.0, -1.73").contains("above the ground"));
        assert!(with("cy_px", "cz_px").contains("cz_px"));
        assert!(with("cy_px = 172.854", "").contains("cy_px"));
        assert!(with("[lidar]", "[radar]").contains("radar"));
        assert!(with("= 1242", "= ").contains("line"));
        let missing = Calibration::load(Path::new("no/such.toml")).expect_err("no file");
        assert!(missing.to_string().contains("no/such.toml"));
    }
}
