use covista_world::{Se2Pose, VehicleDimensions};
use nalgebra::Vector2;

/// The rectangle a vehicle covers on the ground, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Front left, front right, rear right, rear left.
    pub corners: [Vector2<f64>; 4],
}

impl Footprint {
    /// The footprint of a vehicle whose rear axle is at `rear_axle`, grown by `margin_m` all round.
    pub fn new(rear_axle: Se2Pose, dimensions: VehicleDimensions, margin_m: f64) -> Self {
        let grown = VehicleDimensions {
            length_m: dimensions.length_m + 2.0 * margin_m,
            width_m: dimensions.width_m + 2.0 * margin_m,
            rear_overhang_m: dimensions.rear_overhang_m + margin_m,
            ..dimensions
        };
        Self {
            corners: grown
                .corners_from_axle()
                .map(|corner| rear_axle.transform(corner)),
        }
    }

    /// Whether two footprints share a point: no side of either separates them.
    pub fn overlaps(&self, other: &Self) -> bool {
        !(self.separates(other) || other.separates(self))
    }

    fn separates(&self, other: &Self) -> bool {
        let [a, b, c, _] = self.corners;
        [a - b, b - c].into_iter().any(|axis| {
            let (own_min, own_max) = self.extent(axis);
            let (other_min, other_max) = other.extent(axis);
            own_max < other_min || other_max < own_min
        })
    }

    fn extent(&self, axis: Vector2<f64>) -> (f64, f64) {
        self.corners
            .iter()
            .map(|corner| corner.dot(&axis))
            .fold((f64::MAX, f64::MIN), |(min, max), x| {
                (min.min(x), max.max(x))
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VehicleModel;

    #[test]
    fn rectangles_overlap_when_no_side_separates_them() {
        let size = VehicleModel::Sedan.dimensions();
        let at = |x, y, yaw| Footprint::new(Se2Pose::new(x, y, yaw), size, 0.0);
        let one = at(0.0, 0.0, 0.0);
        assert!(one.overlaps(&at(4.69, 0.0, 0.0)));
        assert!(!one.overlaps(&at(4.71, 0.0, 0.0)));
        assert!(!one.overlaps(&at(0.0, 1.83, 0.0)));
        // The bounding boxes overlap here, the rectangles do not.
        assert!(!one.overlaps(&at(4.0, 2.2, std::f64::consts::FRAC_PI_4)));
        assert!(one.overlaps(&at(4.2, 0.0, std::f64::consts::FRAC_PI_4)));
    }
}
