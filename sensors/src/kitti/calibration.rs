use std::path::Path;

use covista_world::{Calibration, CameraIntrinsics};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{KittiError, io_error, malformed};

/// How far the rows of a rotation may be from orthonormal.
const ROTATION_TOLERANCE: f64 = 1e-2;

/// Reads a calibration file: camera 2 and where it sits relative to the LIDAR, which is mounted
/// on the vehicle as in [`Calibration::kitti`].
///
/// # Errors
/// When the file can't be read, or `P2`, `R0_rect` or `Tr_velo_to_cam` is missing or malformed.
pub fn read_calibration(path: &Path) -> Result<Calibration, KittiError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    mounted(path, &text, Calibration::kitti().vehicle_from_lidar)
}

/// Reads a calibration file of our own data sets, in which `Tr_imu_to_velo` starts at the rear
/// axle: it says where the LIDAR is mounted, too.
///
/// # Errors
/// As [`read_calibration`].
pub fn read_rig(path: &Path) -> Result<Calibration, KittiError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    let lidar_from_vehicle = placed(&text, "Tr_imu_to_velo").map_err(malformed(path))?;
    mounted(path, &text, lidar_from_vehicle.inverse())
}

fn mounted(
    path: &Path,
    text: &str,
    vehicle_from_lidar: Isometry3<f64>,
) -> Result<Calibration, KittiError> {
    let malformed = malformed(path);
    let p2: [f64; 12] = numbers(text, "P2").map_err(&malformed)?;
    let r0: [f64; 9] = numbers(text, "R0_rect").map_err(&malformed)?;
    let camera_from_lidar = placed(text, "Tr_velo_to_cam").map_err(&malformed)?;
    if p2[0] <= 0.0 || p2[5] <= 0.0 {
        let what = "P2 has a focal length that is not positive";
        return Err(malformed(what.to_owned()));
    }
    let rectified = isometry(
        rotation("R0_rect", Matrix3::from_row_slice(&r0)).map_err(&malformed)?,
        // P2's fourth column is the baseline from camera 0, in pixels.
        Vector3::new(
            (p2[3] - p2[2] * p2[11]) / p2[0],
            (p2[7] - p2[6] * p2[11]) / p2[5],
            p2[11],
        ),
    );
    let camera_from_lidar = rectified * camera_from_lidar;
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

/// The rotation and translation of the line `name: ...`.
fn placed(text: &str, name: &str) -> Result<Isometry3<f64>, String> {
    let rows: [f64; 12] = numbers(text, name)?;
    let axes = Matrix3::from_fn(|row, column| rows[4 * row + column]);
    let translation = Vector3::new(rows[3], rows[7], rows[11]);
    Ok(isometry(rotation(name, axes)?, translation))
}

/// The rotation that a matrix of a file says, to the digits it is written with.
fn rotation(name: &str, matrix: Matrix3<f64>) -> Result<Rotation3<f64>, String> {
    let is_rotation = (matrix * matrix.transpose() - Matrix3::identity()).amax()
        <= ROTATION_TOLERANCE
        && matrix.determinant() > 0.0;
    if is_rotation {
        Ok(Rotation3::from_matrix(&matrix))
    } else {
        Err(format!("the 3x3 part of `{name}` is no rotation"))
    }
}

fn isometry(rotation: Rotation3<f64>, translation: Vector3<f64>) -> Isometry3<f64> {
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
        format!(
            "`{name}` needs {N} finite numbers, {} can be read",
            values.len()
        )
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
    text += &format!(
        "Tr_velo_to_cam: {}\n",
        rows(calibration.camera_from_lidar())
    );
    text += &format!(
        "Tr_imu_to_velo: {}\n",
        rows(calibration.vehicle_from_lidar.inverse())
    );
    text
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

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
        let moved = Calibration {
            vehicle_from_lidar: isometry(
                Rotation3::from_euler_angles(0.0, 0.01, 0.0),
                Vector3::new(0.9, 0.0, 1.8),
            ),
            ..calibration
        };
        std::fs::write(&path, calibration_text(&moved)).expect("written");
        let rig = read_rig(&path).expect("a rig");
        for (read, written) in [
            (rig.vehicle_from_lidar, moved.vehicle_from_lidar),
            (rig.vehicle_from_camera, moved.vehicle_from_camera),
        ] {
            assert!((read * point - written * point).norm() < 1e-9);
        }

        std::fs::write(&path, text.replace("Tr_velo_to_cam", "Tr")).expect("written");
        let message = read_calibration(&path).expect_err("refused").to_string();
        assert!(message.contains("`Tr_velo_to_cam:`"), "{message}");
        for name in ["P2", "R0_rect"] {
            let lines = text.lines().filter(|line| !line.starts_with(name));
            let without: String = lines.map(|line| format!("{line}\n")).collect();
            std::fs::write(&path, without).expect("written");
            let message = read_calibration(&path).expect_err("refused").to_string();
            assert!(message.contains(&format!("no line `{name}:`")), "{message}");
        }
        std::fs::write(&path, text.replace("R0_rect: 1 0 0", "R0_rect: 0 0 0")).expect("written");
        let message = read_calibration(&path).expect_err("refused").to_string();
        assert!(message.contains("`R0_rect` is no rotation"), "{message}");
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
