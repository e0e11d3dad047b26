use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};
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
        // Camera x is the vehicle's right, camera y its down, camera z its forward.
        let axes = Rotation3::from_matrix_unchecked(Matrix3::new(
            0.0, 0.0, 1.0, //
            -1.0, 0.0, 0.0, //
            0.0, -1.0, 0.0,
        ));
        Self {
            intrinsics: CameraIntrinsics::KITTI,
            vehicle_from_lidar: Isometry3::from_parts(
                Translation3::from(lidar),
                UnitQuaternion::identity(),
            ),
            vehicle_from_camera: Isometry3::from_parts(
                Translation3::from(lidar + Vector3::new(0.27, 0.0, -0.08)),
                UnitQuaternion::from_rotation_matrix(&axes),
            ),
        }
    }

    /// LIDAR frame to camera frame (KITTI's `Tr_velo_to_cam`).
    pub fn camera_from_lidar(&self) -> Isometry3<f64> {
        self.vehicle_from_camera.inverse() * self.vehicle_from_lidar
    }
}

/// An RGB image, eight bits a channel, rows from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraImage {
    /// Pixels across.
    pub width_px: u32,
    /// Pixels down.
    pub height_px: u32,
    /// `3 * width * height` bytes: r, g, b of each pixel, row by row.
    pub rgb: Vec<u8>,
}

/// One LIDAR sweep in the LIDAR frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointCloud {
    /// x, y, z in metres and the reflectance in [0, 1] of each return (KITTI's velodyne layout).
    pub points: Vec<[f32; 4]>,
}

/// How far the LIDAR confirms the way to be free, by azimuth.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeSpace {
    /// Where the rays start: the LIDAR, in the vehicle frame, in metres.
    pub origin_m: Vector2<f64>,
    /// Free range in metres in each of equal bins over the full circle; bin 0 starts at the
    /// vehicle's forward axis, and they run counter-clockwise.
    pub ranges_m: Vec<f32>,
}

impl FreeSpace {
    /// The free range from [`Self::origin_m`] along an azimuth, in metres: the least of its bin
    /// and the two beside it, so that a narrow obstacle doesn't slip through. 0 where nothing is
    /// known.
    pub fn free_range_m(&self, azimuth_rad: f64) -> f64 {
        let bins = self.ranges_m.len();
        if bins == 0 || !azimuth_rad.is_finite() {
            return 0.0;
        }
        let turns = azimuth_rad.rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
        let bin = ((turns * bins as f64) as usize).min(bins - 1);
        [bin + bins - 1, bin, bin + 1]
            .into_iter()
            .map(|neighbour| f64::from(self.ranges_m[neighbour % bins]))
            .fold(f64::INFINITY, f64::min)
    }
}

/// What one vehicle's sensors measure at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorFrame {
    /// Time stamp of both measurements in seconds.
    pub time_s: f64,
    /// The camera's image.
    pub image: CameraImage,
    /// The LIDAR's sweep.
    pub points: PointCloud,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_range_is_the_least_of_three_bins_round_the_circle() {
        let mut ranges_m = vec![100.0; 720];
        ranges_m[719] = 30.0;
        let free = FreeSpace {
            origin_m: Vector2::zeros(),
            ranges_m,
        };
        let at = |degrees: f64| free.free_range_m(degrees.to_radians());
        assert!((at(0.2) - 30.0).abs() < 1e-9 && (at(-0.7) - 30.0).abs() < 1e-9);
        assert!((at(0.7) - 100.0).abs() < 1e-9 && (at(-1.2) - 100.0).abs() < 1e-9);
        assert!(free.free_range_m(f64::NAN).abs() < 1e-9);
    }

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
}
