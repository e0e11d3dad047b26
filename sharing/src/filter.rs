use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};

/// A Kalman filter of the constant-velocity model in the plane.
///
/// State x = [p_x, p_y, v_x, v_y] in the world frame; dx = F x dt + white-noise acceleration of
/// spectral density q, so that two steps of prediction equal one over the whole time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct KalmanFilter {
    pub time_s: f64,
    pub mean: Vector4<f64>,
    pub covariance: Matrix4<f64>,
}

impl KalmanFilter {
    pub fn new(
        time_s: f64,
        position: Vector2<f64>,
        position_std_m: f64,
        velocity: Vector2<f64>,
        velocity_covariance: Matrix2<f64>,
    ) -> Self {
        let mut covariance = Matrix4::zeros();
        covariance
            .fixed_view_mut::<2, 2>(0, 0)
            .copy_from(&(Matrix2::identity() * position_std_m.powi(2)));
        covariance
            .fixed_view_mut::<2, 2>(2, 2)
            .copy_from(&velocity_covariance);
        Self {
            time_s,
            mean: Vector4::new(position.x, position.y, velocity.x, velocity.y),
            covariance,
        }
    }

    /// The state at `time_s`, before or after the filter's time.
    pub fn predicted(&self, time_s: f64, q: f64) -> Self {
        let dt = time_s - self.time_s;
        let mut f = Matrix4::identity();
        f[(0, 2)] = dt;
        f[(1, 3)] = dt;
        let mut covariance = f * self.covariance * f.transpose();
        let (noise_dt, both) = (dt.abs(), q * dt * dt.abs() / 2.0);
        for axis in 0..2 {
            covariance[(axis, axis)] += q * noise_dt.powi(3) / 3.0;
            covariance[(axis, axis + 2)] += both;
            covariance[(axis + 2, axis)] += both;
            covariance[(axis + 2, axis + 2)] += q * noise_dt;
        }
        Self {
            time_s,
            mean: f * self.mean,
            covariance,
        }
    }

    /// The state given a measurement of the position at the filter's time.
    pub fn with_position(&self, position: Vector2<f64>, std_m: f64) -> Self {
        let mut h = Matrix2x4::zeros();
        h[(0, 0)] = 1.0;
        h[(1, 1)] = 1.0;
        self.corrected(h, position, std_m)
    }

    /// The state given that the velocity is zero up to `std_mps`.
    pub fn at_standstill(&self, std_mps: f64) -> Self {
        let mut h = Matrix2x4::zeros();
        h[(0, 2)] = 1.0;
        h[(1, 3)] = 1.0;
        self.corrected(h, Vector2::zeros(), std_mps)
    }

    fn corrected(&self, h: Matrix2x4<f64>, z: Vector2<f64>, std: f64) -> Self {
        let noise = Matrix2::identity() * std.powi(2);
        let Some(inverse) = (h * self.covariance * h.transpose() + noise).try_inverse() else {
            return *self;
        };
        let gain = self.covariance * h.transpose() * inverse;
        // Joseph's form keeps the covariance symmetric and positive.
        let keep = Matrix4::identity() - gain * h;
        Self {
            time_s: self.time_s,
            mean: self.mean + gain * (z - h * self.mean),
            covariance: keep * self.covariance * keep.transpose() + gain * noise * gain.transpose(),
        }
    }

    pub fn position(&self) -> Vector2<f64> {
        self.mean.fixed_rows::<2>(0).into_owned()
    }

    pub fn velocity(&self) -> Vector2<f64> {
        self.mean.fixed_rows::<2>(2).into_owned()
    }

    pub fn position_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }

    pub fn velocity_covariance(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(2, 2).into_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unknown(position: Vector2<f64>) -> KalmanFilter {
        KalmanFilter::new(
            0.0,
            position,
            0.3,
            Vector2::zeros(),
            Matrix2::identity() * 1e8,
        )
    }

    #[test]
    fn two_positions_give_their_difference_quotient() {
        let filter = unknown(Vector2::new(1.0, 2.0))
            .predicted(0.5, 0.0)
            .with_position(Vector2::new(8.0, 1.0), 0.3);
        assert!((filter.velocity() - Vector2::new(14.0, -2.0)).norm() < 1e-5);
        // var v = 2 sigma^2 / dt^2.
        assert!((filter.velocity_covariance()[(0, 0)] - 2.0 * 0.09 / 0.25).abs() < 1e-5);
    }

    #[test]
    fn without_process_noise_it_is_the_least_squares_line() {
        let (n, dt) = (12, 0.4);
        let noise = |i: i32| 0.2 * f64::from((i * 7) % 5 - 2);
        let mut filter = unknown(Vector2::new(noise(0), 0.0));
        for i in 1..n {
            let t = dt * f64::from(i);
            filter = filter
                .predicted(t, 0.0)
                .with_position(Vector2::new(14.0 * t + noise(i), 0.0), 0.3);
        }
        let mean_t = dt * f64::from(n - 1) / 2.0;
        let (mut sxy, mut sxx) = (0.0, 0.0);
        for i in 0..n {
            let t = dt * f64::from(i) - mean_t;
            sxy += t * noise(i);
            sxx += t * t;
        }
        assert!((filter.velocity().x - 14.0 - sxy / sxx).abs() < 1e-5);
    }

    #[test]
    fn two_predictions_equal_one() {
        let start = unknown(Vector2::new(0.0, 0.0)).with_position(Vector2::new(0.2, 0.1), 0.3);
        let once = start.predicted(0.7, 3.0);
        let twice = start.predicted(0.2, 3.0).predicted(0.7, 3.0);
        assert!((once.covariance - twice.covariance).norm() < 1e-6 * once.covariance.norm());
        assert!((once.mean - twice.mean).norm() < 1e-12);
    }
}
