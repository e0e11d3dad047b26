use crate::{CameraImage, CollectivePerceptionMessage, PointCloud};

/// Why a payload is refused at a stage's boundary.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what}")]
pub struct InvalidPayload {
    what: String,
}

impl InvalidPayload {
    fn new(what: impl Into<String>) -> Self {
        Self { what: what.into() }
    }
}

/// A check at the boundary of a stage: finite numbers, matching sizes, values in range.
pub trait Validate {
    /// # Errors
    /// Says what is wrong with the payload.
    fn validate(&self) -> Result<(), InvalidPayload>;
}

impl Validate for PointCloud {
    fn validate(&self) -> Result<(), InvalidPayload> {
        match self
            .points
            .iter()
            .position(|point| point.iter().any(|value| !value.is_finite()))
        {
            Some(index) => Err(InvalidPayload::new(format!(
                "point {index} of the point cloud has a coordinate or reflectance that is not finite"
            ))),
            None => Ok(()),
        }
    }
}

impl Validate for CameraImage {
    fn validate(&self) -> Result<(), InvalidPayload> {
        let expected = 3 * self.width_px as usize * self.height_px as usize;
        if self.rgb.len() != expected || expected == 0 {
            return Err(InvalidPayload::new(format!(
                "an image of {}x{} pixels needs {expected} bytes and has {}",
                self.width_px,
                self.height_px,
                self.rgb.len()
            )));
        }
        Ok(())
    }
}

impl Validate for CollectivePerceptionMessage {
    fn validate(&self) -> Result<(), InvalidPayload> {
        let own = [
            self.time_s,
            self.pose.x_m,
            self.pose.y_m,
            self.pose.yaw_rad,
            self.speed_mps,
            self.accel_mps2,
            self.announced_s,
        ];
        let objects = self.objects.iter().flat_map(|object| {
            let state = &object.state;
            [
                state.center.x_m,
                state.center.y_m,
                state.center.yaw_rad,
                state.velocity_mps.x,
                state.velocity_mps.y,
                state.length_m,
                state.width_m,
                object.position_std_m,
                object.velocity_std_mps,
                object.measured_s,
            ]
        });
        if own.into_iter().chain(objects).all(f64::is_finite) {
            Ok(())
        } else {
            Err(InvalidPayload::new(format!(
                "the message of station {} has a number that is not finite",
                self.station.0
            )))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nan_in_a_point_cloud_is_named() {
        let cloud = PointCloud {
            points: vec![[0.0; 4], [0.0, f32::NAN, 0.0, 0.0]],
        };
        let message = cloud.validate().expect_err("refused").to_string();
        assert!(
            message.starts_with("point 1 of the point cloud"),
            "{message}"
        );
    }

    #[test]
    fn an_image_of_the_wrong_size_is_refused() {
        let image = CameraImage {
            width_px: 4,
            height_px: 2,
            rgb: vec![0; 23],
        };
        assert!(image.validate().is_err());
    }
}
