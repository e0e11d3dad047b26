//! Files in the layout of the KITTI object benchmark.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use covista_traffic::VehicleModel;
use covista_world::{Calibration, CameraIntrinsics, PointCloud, wrap_angle};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::TruthBox;

/// Edges of a box are clipped at this depth before they are projected.
const NEAR_M: f64 = 0.1;
/// Shares of the body in sight from which KITTI calls it fully or partly visible.
const FULLY_VISIBLE: f64 = 0.8;
const PARTLY_VISIBLE: f64 = 0.4;
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
    /// A point has a number that is not finite.
    #[error(
        "{path}: point {index} has a coordinate or reflectance that is not finite; remove such points first"
    )]
    NotFinite {
        /// The file.
        path: String,
        /// Which point, from 0.
        index: usize,
    },
    /// A text file lacks an entry or has an unusable one.
    #[error("{path}: {what}")]
    Malformed {
        /// The file.
        path: String,
        /// What is wrong and what is expected.
        what: String,
    },
}

fn io_error(path: &Path) -> impl Fn(std::io::Error) -> KittiError {
    let path = path.display().to_string();
    move |source| KittiError::Io {
        path: path.clone(),
        source,
    }
}

/// Reads a velodyne `.bin`: x, y, z in metres in the LIDAR frame and the reflectance of each point.
///
/// # Errors
/// When the file can't be read, is truncated or has a number that is not finite.
pub fn read_cloud(path: &Path) -> Result<PointCloud, KittiError> {
    let bytes = std::fs::read(path).map_err(io_error(path))?;
    if !bytes.len().is_multiple_of(POINT_BYTES) {
        return Err(KittiError::Truncated {
            path: path.display().to_string(),
            bytes: bytes.len(),
        });
    }
    let (values, _) = bytes.as_chunks::<4>();
    let (points, _) = values.as_chunks::<4>();
    let points: Vec<[f32; 4]> = points
        .iter()
        .map(|point| point.map(f32::from_le_bytes))
        .collect();
    let bad = |point: &[f32; 4]| point.iter().any(|value| !value.is_finite());
    match points.iter().position(bad) {
        Some(index) => Err(KittiError::NotFinite {
            path: path.display().to_string(),
            index,
        }),
        None => Ok(PointCloud { points }),
    }
}

/// The bytes of a velodyne `.bin`.
pub fn cloud_bytes(cloud: &PointCloud) -> Vec<u8> {
    let values = cloud.points.iter().flatten();
    values.flat_map(|value| value.to_le_bytes()).collect()
}

/// Reads a calibration file: camera 2 and where it sits relative to the LIDAR, which is mounted
/// on the vehicle as in [`Calibration::kitti`].
///
/// # Errors
/// When the file can't be read, or `P2`, `R0_rect` or `Tr_velo_to_cam` is missing or malformed.
pub fn read_calibration(path: &Path) -> Result<Calibration, KittiError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    let malformed = |what: String| KittiError::Malformed {
        path: path.display().to_string(),
        what,
    };
    let p2: [f64; 12] = numbers(&text, "P2").map_err(malformed)?;
    let r0: [f64; 9] = numbers(&text, "R0_rect").map_err(malformed)?;
    let tr: [f64; 12] = numbers(&text, "Tr_velo_to_cam").map_err(malformed)?;
    if p2[0] <= 0.0 || p2[5] <= 0.0 {
        let what = "P2 has a focal length that is not positive";
        return Err(malformed(what.to_owned()));
    }
    let rectified = isometry(
        Matrix3::from_row_slice(&r0),
        // P2's fourth column is the baseline from camera 0, in pixels.
        Vector3::new(
            (p2[3] - p2[2] * p2[11]) / p2[0],
            (p2[7] - p2[6] * p2[11]) / p2[5],
            p2[11],
        ),
    );
    let rotation = Matrix3::new(
        tr[0], tr[1], tr[2], tr[4], tr[5], tr[6], tr[8], tr[9], tr[10],
    );
    let camera_from_lidar = rectified * isometry(rotation, Vector3::new(tr[3], tr[7], tr[11]));
    let vehicle_from_lidar = Calibration::kitti().vehicle_from_lidar;
    Ok(Calibration {
        intrinsics: CameraIntrinsics {
            fx_px: p2[0],
            fy_px: p2[5],
            cx_px: p2[2],
            cy_px: p2[6],
            ..CameraIntrinsics::KITTI
        },
        vehicle_from_lidar,
        vehicle_from_camera: vehicle_from_lidar * camera_from_lidar.inverse(),
    })
}

fn isometry(rotation: Matrix3<f64>, translation: Vector3<f64>) -> Isometry3<f64> {
    let rotation = Rotation3::from_matrix(&rotation);
    Isometry3::from_parts(
        Translation3::from(translation),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

/// The numbers of the line `name: ...`.
fn numbers<const N: usize>(text: &str, name: &str) -> Result<[f64; N], String> {
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))
        .ok_or_else(|| format!("there is no line `{name}:`"))?;
    let values: Vec<f64> = line
        .split_whitespace()
        .map_while(|word| word.parse().ok().filter(|value: &f64| value.is_finite()))
        .collect();
    <[f64; N]>::try_from(values).map_err(|values| {
        format!("`{name}` needs {N} finite numbers, {} can be read", values.len())
    })
}

/// The text of a calibration file.
pub fn calibration_text(calibration: &Calibration) -> String {
    let camera = calibration.intrinsics;
    let projection = format!(
        "{:e} 0 {:e} 0 0 {:e} {:e} 0 0 0 1 0",
        camera.fx_px, camera.cx_px, camera.fy_px, camera.cy_px
    );
    let rows = |isometry: Isometry3<f64>| {
        let matrix = isometry.to_homogeneous();
        let cells = (0..12).map(|cell| format!("{:e}", matrix[(cell / 4, cell % 4)]));
        cells.collect::<Vec<_>>().join(" ")
    };
    let mut text: String = (0..4).map(|i| format!("P{i}: {projection}\n")).collect();
    text += "R0_rect: 1 0 0 0 1 0 0 0 1\n";
    text += &format!("Tr_velo_to_cam: {}\n", rows(calibration.camera_from_lidar()));
    text += &format!(
        "Tr_imu_to_velo: {}\n",
        rows(calibration.vehicle_from_lidar.inverse())
    );
    text
}

/// One line of a label file.
#[derive(Debug, Clone, PartialEq)]
pub struct KittiLabel {
    /// `Car`, `Van`, `Truck`, ...
    pub kind: String,
    /// Share of the 2D box outside the image, in [0, 1].
    pub truncated: f64,
    /// 0 fully visible, 1 partly, 2 largely occluded, 3 unknown.
    pub occluded: u8,
    /// Observation angle in (-pi, pi].
    pub alpha_rad: f64,
    /// 2D box in pixels: left, top, right, bottom; zeros outside the image.
    pub bbox_px: [f64; 4],
    /// Height, width, length in metres.
    pub size_hwl_m: [f64; 3],
    /// Centre of the bottom in the camera frame, in metres.
    pub location_m: [f64; 3],
    /// Rotation about the camera's y axis in (-pi, pi].
    pub rotation_y_rad: f64,
}

impl KittiLabel {
    /// The label of a vehicle.
    pub fn new(truth: &TruthBox, calibration: &Calibration) -> Self {
        let camera_from_lidar = calibration.camera_from_lidar();
        let bottom = truth.center_m - Vector3::z() * (truth.size_m.z / 2.0);
        let location = camera_from_lidar * Point3::from(bottom);
        let heading =
            camera_from_lidar * Vector3::new(truth.yaw_rad.cos(), truth.yaw_rad.sin(), 0.0);
        let rotation_y_rad = (-heading.z).atan2(heading.x);
        let corners = truth
            .corners_m()
            .map(|corner| camera_from_lidar * corner);
        let (bbox_px, truncated) = image_box(&corners, &calibration.intrinsics);
        Self {
            kind: match truth.model {
                VehicleModel::Sedan | VehicleModel::Suv => "Car",
                VehicleModel::Van => "Van",
                VehicleModel::Truck => "Truck",
            }
            .to_owned(),
            truncated,
            occluded: match truth.visibility {
                share if share >= FULLY_VISIBLE => 0,
                share if share >= PARTLY_VISIBLE => 1,
                _ => 2,
            },
            alpha_rad: wrap_angle(rotation_y_rad - location.x.atan2(location.z)),
            bbox_px,
            size_hwl_m: [truth.size_m.z, truth.size_m.y, truth.size_m.x],
            location_m: location.coords.into(),
            rotation_y_rad,
        }
    }
}

impl fmt::Display for KittiLabel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:.2} {} {:.4}", self.kind, self.truncated, self.occluded, self.alpha_rad)?;
        for value in self.bbox_px {
            write!(f, " {value:.2}")?;
        }
        for value in self.size_hwl_m.iter().chain(&self.location_m) {
            write!(f, " {value:.3}")?;
        }
        write!(f, " {:.4}", self.rotation_y_rad)
    }
}

impl FromStr for KittiLabel {
    type Err = String;

    /// Reads the 15 columns; a score after them is ignored.
    fn from_str(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words.len() < 15 {
            return Err(format!("a label needs 15 columns and has {}: `{line}`", words.len()));
        }
        let mut values = [0.0; 14];
        for (value, word) in values.iter_mut().zip(&words[1..]) {
            *value = word
                .parse()
                .ok()
                .filter(|value: &f64| value.is_finite())
                .ok_or_else(|| format!("`{word}` is no finite number in the label `{line}`"))?;
        }
        let [truncated, occluded, alpha_rad, l, t, r, b, height, width, length, x, y, z, rotation] =
            values;
        Ok(Self {
            kind: words[0].to_owned(),
            truncated,
            // A cast of a float saturates.
            occluded: occluded as u8,
            alpha_rad,
            bbox_px: [l, t, r, b],
            size_hwl_m: [height, width, length],
            location_m: [x, y, z],
            rotation_y_rad: rotation,
        })
    }
}

/// The 2D box of a 3D one (corners in the camera frame) within the image, and the share of it that
/// the image cuts off.
fn image_box(corners: &[Point3<f64>; 8], camera: &CameraIntrinsics) -> ([f64; 4], f64) {
    let edges = (0..4).flat_map(|i| [(i, (i + 1) % 4), (i + 4, (i + 1) % 4 + 4), (i, i + 4)]);
    let pixels: Vec<[f64; 2]> = edges
        .filter_map(|(a, b)| clipped(corners[a], corners[b]))
        .flatten()
        .filter_map(|point| camera.project(&point))
        .collect();
    let bound = |axis: usize| {
        pixels.iter().fold((f64::MAX, f64::MIN), |(low, high), pixel| {
            (low.min(pixel[axis]), high.max(pixel[axis]))
        })
    };
    let ((left, right), (top, bottom)) = (bound(0), bound(1));
    let (max_u, max_v) = (
        f64::from(camera.width_px) - 1.0,
        f64::from(camera.height_px) - 1.0,
    );
    let inside = [
        left.max(0.0),
        top.max(0.0),
        right.min(max_u),
        bottom.min(max_v),
    ];
    let [l, t, r, b] = inside;
    if l >= r || t >= b {
        return ([0.0; 4], 1.0);
    }
    let kept = (r - l) * (b - t) / ((right - left) * (bottom - top));
    (inside, (1.0 - kept).clamp(0.0, 1.0))
}

/// The part of an edge before the near plane.
fn clipped(a: Point3<f64>, b: Point3<f64>) -> Option<[Point3<f64>; 2]> {
    let (near, far) = if a.z < b.z { (a, b) } else { (b, a) };
    if far.z < NEAR_M {
        return None;
    }
    if near.z >= NEAR_M {
        return Some([near, far]);
    }
    let share = (NEAR_M - near.z) / (far.z - near.z);
    Some([near + (far - near) * share, far])
}

#[cfg(test)]
mod tests {
    use covista_traffic::VehicleId;
    use proptest::prelude::*;

    use super::*;

    fn truth(center_m: [f64; 3], yaw_rad: f64) -> TruthBox {
        TruthBox {
            id: VehicleId(1),
            model: VehicleModel::Van,
            center_m: center_m.into(),
            size_m: Vector3::new(5.4, 2.0, 2.3),
            yaw_rad,
            lidar_points: 100,
            visibility: 0.5,
        }
    }

    #[test]
    fn a_vehicle_straight_ahead_is_seen_from_behind() {
        let calibration = Calibration::kitti();
        let label = KittiLabel::new(&truth([20.27, 0.0, 1.15 - 1.73], 0.0), &calibration);
        assert!((label.rotation_y_rad + std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        assert!((label.alpha_rad - label.rotation_y_rad).abs() < 1e-9);
        assert!((label.location_m[2] - 20.0).abs() < 1e-9);
        assert!((label.location_m[1] - 1.65).abs() < 1e-9);
        // The rear face, 2 m wide and 17.3 m away, bounds the 2D box.
        let [left, _, right, bottom] = label.bbox_px;
        assert!((right - left - 721.5377 * 2.0 / 17.3).abs() < 1e-6);
        assert!((bottom - (172.854 + 721.5377 * 1.65 / 17.3)).abs() < 1e-6);
        assert_eq!((label.occluded, label.kind.as_str()), (1, "Van"));
        assert_eq!(label.to_string().split(' ').count(), 15);
    }

    #[test]
    fn boxes_behind_have_no_pixels_and_boxes_at_the_border_are_truncated() {
        let calibration = Calibration::kitti();
        let behind = KittiLabel::new(&truth([-15.0, 0.0, -0.6], 0.0), &calibration);
        assert_eq!(behind.bbox_px, [0.0; 4]);
        let beside = KittiLabel::new(&truth([3.0, 3.0, -0.6], 0.0), &calibration);
        assert!(beside.truncated > 0.3, "{beside}");
        assert!(beside.bbox_px.iter().all(|px| (0.0..1242.0).contains(px)));
    }

    proptest! {
        #[test]
        fn labels_survive_their_text(
            x in -70.0..70.0_f64, y in -30.0..30.0_f64, yaw in -3.1..3.1_f64,
        ) {
            let label = KittiLabel::new(&truth([x, y, -0.6], yaw), &Calibration::kitti());
            let back: KittiLabel = label.to_string().parse().expect("a label");
            for (a, b) in label.location_m.iter().zip(back.location_m) {
                prop_assert!((a - b).abs() <= 5.1e-4);
            }
            prop_assert!((label.rotation_y_rad - back.rotation_y_rad).abs() <= 5.1e-5);
            prop_assert!((label.alpha_rad - back.alpha_rad).abs() <= 5.1e-5);
            prop_assert_eq!(label.size_hwl_m, back.size_hwl_m);
            prop_assert!(back.truncated >= 0.0 && back.truncated <= 1.0);
        }
    }

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
        assert!(message.contains("point 1"), "{message}");
    }

    #[test]
    fn a_calibration_survives_its_text_and_a_missing_line_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("calib.txt");
        let calibration = Calibration::kitti();
        let text = calibration_text(&calibration);
        std::fs::write(&path, &text).expect("written");
        let back = read_calibration(&path).expect("a calibration");
        assert_eq!(back.intrinsics, calibration.intrinsics);
        let point = Point3::new(20.0, -3.0, 1.0);
        let gap = back.camera_from_lidar() * point - calibration.camera_from_lidar() * point;
        assert!(gap.norm() < 1e-9);

        std::fs::write(&path, text.replace("Tr_velo_to_cam", "Tr")).expect("written");
        let message = read_calibration(&path).expect_err("refused").to_string();
        assert!(message.contains("`Tr_velo_to_cam:`"), "{message}");
        std::fs::write(&path, text.replace("R0_rect: 1", "R0_rect: nan")).expect("written");
        let message = read_calibration(&path).expect_err("refused").to_string();
        assert!(message.contains("9 finite numbers"), "{message}");
    }

    #[test]
    fn the_baseline_of_camera_2_shifts_the_camera() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("calib.txt");
        let text = calibration_text(&Calibration::kitti()).replace(
            "P2: 7.215377e2 0 6.095593e2 0",
            "P2: 7.215377e2 0 6.095593e2 44.85728",
        );
        std::fs::write(&path, text).expect("written");
        let calibration = read_calibration(&path).expect("a calibration");
        let seen = calibration.camera_from_lidar() * Point3::new(10.27, 0.0, -0.08);
        assert!((seen.x - 44.85728 / 721.5377).abs() < 1e-9, "{seen}");
    }
}
