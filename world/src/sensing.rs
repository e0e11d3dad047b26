use nalgebra::Vector2;

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
}
