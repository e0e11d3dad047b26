use std::fmt;
use std::str::FromStr;

use covista_traffic::VehicleModel;
use covista_world::{Calibration, CameraIntrinsics, wrap_angle};
use nalgebra::{Point3, Vector3};

use crate::TruthBox;

/// A body is clipped at this depth before it is projected.
const NEAR_M: f64 = 0.1;
/// Shares of the body in sight from which KITTI calls it fully or partly visible.
const FULLY_VISIBLE: f64 = 0.8;
const PARTLY_VISIBLE: f64 = 0.4;

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
    /// 2D box of the body in pixels: left, top, right, bottom; zeros outside the image.
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
        let corners = truth.parts_m.iter().flat_map(|part| {
            let seen: Vec<_> = part.iter().map(|p| camera_from_lidar * p).collect();
            clipped(&seen)
        });
        let (bbox_px, truncated) = image_box(corners, &calibration.intrinsics);
        Self {
            kind: match truth.model {
                VehicleModel::Van | VehicleModel::Transporter => "Van",
                VehicleModel::Truck | VehicleModel::Bus => "Truck",
                VehicleModel::Sedan
                | VehicleModel::Suv
                | VehicleModel::Hatchback
                | VehicleModel::CityCar
                | VehicleModel::TwoSeater
                | VehicleModel::Wagon
                | VehicleModel::Minivan
                | VehicleModel::Pickup => "Car",
            }
            .to_owned(),
            truncated,
            occluded: match truth.camera_visibility {
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

impl KittiLabel {
    /// Centre of the box in the LIDAR frame, in metres, and its heading there.
    pub fn pose_in_lidar(&self, calibration: &Calibration) -> (Vector3<f64>, f64) {
        let lidar_from_camera = calibration.camera_from_lidar().inverse();
        let [height_m, ..] = self.size_hwl_m;
        let (sin, cos) = self.rotation_y_rad.sin_cos();
        let heading = lidar_from_camera * Vector3::new(cos, 0.0, -sin);
        let bottom = lidar_from_camera * Point3::from(self.location_m);
        let center_m = bottom.coords + Vector3::z() * (height_m / 2.0);
        (center_m, heading.y.atan2(heading.x))
    }
}

impl fmt::Display for KittiLabel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} {:.2} {} {:.4}",
            self.kind, self.truncated, self.occluded, self.alpha_rad
        )?;
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
            return Err(format!(
                "a label needs 15 columns and has {}: `{line}`",
                words.len()
            ));
        }
        let mut values = [0.0; 14];
        for (value, word) in values.iter_mut().zip(&words[1..]) {
            *value = word
                .parse()
                .ok()
                .filter(|value: &f64| value.is_finite())
                .ok_or_else(|| format!("`{word}` is no finite number in the label `{line}`"))?;
        }
        let [
            truncated,
            occluded,
            alpha_rad,
            l,
            t,
            r,
            b,
            height,
            width,
            length,
            x,
            y,
            z,
            rotation,
        ] = values;
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

/// The 2D box in pixels (left, top, right, bottom) of a convex body in the LIDAR frame, cut off at
/// the picture's border; `None` when the picture shows nothing of it.
pub fn picture_box_px(corners_m: &[Point3<f64>], calibration: &Calibration) -> Option<[f64; 4]> {
    let camera_from_lidar = calibration.camera_from_lidar();
    let seen: Vec<_> = corners_m.iter().map(|p| camera_from_lidar * p).collect();
    let (inside, _) = image_box(clipped(&seen).into_iter(), &calibration.intrinsics);
    let [left, _, right, _] = inside;
    (left < right).then_some(inside)
}

/// The 2D box of points in the camera frame within the image, and the share of it that the image
/// cuts off.
fn image_box(
    points: impl Iterator<Item = Point3<f64>>,
    camera: &CameraIntrinsics,
) -> ([f64; 4], f64) {
    let pixels: Vec<[f64; 2]> = points.filter_map(|point| camera.project(&point)).collect();
    let bound = |axis: usize| {
        pixels
            .iter()
            .fold((f64::MAX, f64::MIN), |(low, high), pixel| {
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

/// The corners of what lies of a convex part before the near plane.
fn clipped(part: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let (mut front, behind): (Vec<Point3<f64>>, Vec<_>) =
        part.iter().copied().partition(|p| p.z >= NEAR_M);
    for near in behind {
        let far = part.iter().filter(|p| p.z >= NEAR_M);
        front.extend(far.map(|far| near.lerp(far, (NEAR_M - near.z) / (far.z - near.z))));
    }
    front
}

#[cfg(test)]
mod tests {
    use covista_traffic::VehicleId;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    /// A van that fills its box.
    fn truth(center_m: [f64; 3], yaw_rad: f64) -> TruthBox {
        let size_m = Vector3::new(5.4, 2.0, 2.3);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad);
        let corners = (0..8).map(|bits: u8| {
            let sides = [0, 1, 2].map(|axis| if bits >> axis & 1 == 0 { -0.5 } else { 0.5 });
            let corner = size_m.component_mul(&Vector3::from(sides));
            Point3::from(Vector3::from(center_m) + turn * corner)
        });
        TruthBox {
            id: VehicleId(1),
            model: VehicleModel::Van,
            center_m: center_m.into(),
            size_m,
            yaw_rad,
            parts_m: vec![corners.collect()],
            lane: None,
            lidar_points: 100,
            visibility: 1.0,
            camera_visibility: 0.5,
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
        assert!(behind.bbox_px.iter().all(|px| px.abs() < 1e-12));
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
            let lengths = label.location_m.iter().chain(&label.size_hwl_m);
            for (a, b) in lengths.zip(back.location_m.iter().chain(&back.size_hwl_m)) {
                prop_assert!((a - b).abs() <= 5.1e-4);
            }
            prop_assert!((label.rotation_y_rad - back.rotation_y_rad).abs() <= 5.1e-5);
            prop_assert!((label.alpha_rad - back.alpha_rad).abs() <= 5.1e-5);
            let (center_m, yaw_back) = label.pose_in_lidar(&Calibration::kitti());
            prop_assert!((center_m - Vector3::new(x, y, -0.6)).norm() < 1e-9);
            prop_assert!(wrap_angle(yaw_back - yaw).abs() < 1e-9);
            prop_assert!(back.truncated >= 0.0 && back.truncated <= 1.0);
        }
    }
}
