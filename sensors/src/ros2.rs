//! ROS 2 messages in CDR, as an MCAP file holds them: each with the schema of its type.

use covista_world::{Calibration, CameraImage};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::kitti::KittiLabel;

pub(crate) const VEHICLE_FRAME: &str = "vehicle";
pub(crate) const LIDAR_FRAME: &str = "lidar";
pub(crate) const CAMERA_FRAME: &str = "camera";

/// A message type: its name and its definition with those of all types in it.
pub(crate) struct Schema {
    pub(crate) name: &'static str,
    pub(crate) definition: &'static str,
}

macro_rules! schema {
    ($package:literal, $name:literal) => {
        Schema {
            name: concat!($package, "/msg/", $name),
            definition: include_str!(concat!("../assets/ros2/", $name, ".msg")),
        }
    };
}

pub(crate) const POINT_CLOUD: Schema = schema!("sensor_msgs", "PointCloud2");
pub(crate) const COMPRESSED_IMAGE: Schema = schema!("sensor_msgs", "CompressedImage");
pub(crate) const CAMERA_INFO: Schema = schema!("sensor_msgs", "CameraInfo");
pub(crate) const TRANSFORMS: Schema = schema!("tf2_msgs", "TFMessage");
pub(crate) const MARKERS: Schema = schema!("visualization_msgs", "MarkerArray");

/// Little-endian CDR; numbers are aligned to their size after the four bytes of the header.
struct Cdr {
    bytes: Vec<u8>,
}

impl Cdr {
    const HEADER: [u8; 4] = [0, 1, 0, 0];

    fn new() -> Self {
        Self {
            bytes: Self::HEADER.to_vec(),
        }
    }

    fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let length = (self.bytes.len() - Self::HEADER.len()).next_multiple_of(N);
        self.bytes.resize(Self::HEADER.len() + length, 0);
        self.bytes.extend(bytes);
    }

    fn u8(&mut self, value: u8) {
        self.put([value]);
    }

    fn bool(&mut self, value: bool) {
        self.put([u8::from(value)]);
    }

    fn u32(&mut self, value: u32) {
        self.put(value.to_le_bytes());
    }

    fn f32s(&mut self, values: &[f32]) {
        values
            .iter()
            .for_each(|value| self.put(value.to_le_bytes()));
    }

    fn f64s(&mut self, values: &[f64]) {
        values
            .iter()
            .for_each(|value| self.put(value.to_le_bytes()));
    }

    fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.u8(0);
    }

    fn byte_sequence(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.bytes.extend(bytes);
    }

    fn header(&mut self, time_ns: u64, frame_id: &str) {
        self.u32((time_ns / 1_000_000_000) as u32);
        self.u32((time_ns % 1_000_000_000) as u32);
        self.string(frame_id);
    }

    fn quaternion(&mut self, rotation: &UnitQuaternion<f64>) {
        self.f64s(rotation.coords.as_slice());
    }
}

/// `sensor_msgs/PointCloud2` of a velodyne file's bytes.
pub(crate) fn point_cloud(time_ns: u64, points: &[u8]) -> Vec<u8> {
    const POINT_BYTES: u32 = 16;
    const FLOAT32: u8 = 7;
    let mut to = Cdr::new();
    to.header(time_ns, LIDAR_FRAME);
    to.u32(1);
    to.u32(points.len() as u32 / POINT_BYTES);
    to.u32(4);
    for (index, name) in ["x", "y", "z", "intensity"].into_iter().enumerate() {
        to.string(name);
        to.u32(4 * index as u32);
        to.u8(FLOAT32);
        to.u32(1);
    }
    to.bool(false);
    to.u32(POINT_BYTES);
    to.u32(points.len() as u32);
    to.byte_sequence(points);
    to.bool(true);
    to.bytes
}

/// `sensor_msgs/CompressedImage` of a picture file's bytes.
pub(crate) fn compressed_image(time_ns: u64, format: &str, file: &[u8]) -> Vec<u8> {
    let mut to = Cdr::new();
    to.header(time_ns, CAMERA_FRAME);
    to.string(format);
    to.byte_sequence(file);
    to.bytes
}

/// `sensor_msgs/CameraInfo` of a rectified camera.
pub(crate) fn camera_info(time_ns: u64, calibration: &Calibration, image: &CameraImage) -> Vec<u8> {
    let camera = calibration.intrinsics;
    let (fx, fy, cx, cy) = (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px);
    let mut to = Cdr::new();
    to.header(time_ns, CAMERA_FRAME);
    to.u32(image.height_px);
    to.u32(image.width_px);
    to.string("plumb_bob");
    to.u32(5);
    to.f64s(&[0.0; 5]);
    to.f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    to.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    to.f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    to.u32(0);
    to.u32(0);
    [0; 4].into_iter().for_each(|zero| to.u32(zero));
    to.bool(false);
    to.bytes
}

/// `tf2_msgs/TFMessage` of where the sensors sit.
pub(crate) fn mounting(time_ns: u64, calibration: &Calibration) -> Vec<u8> {
    let sensors = [
        (LIDAR_FRAME, calibration.vehicle_from_lidar),
        (CAMERA_FRAME, calibration.vehicle_from_camera),
    ];
    let mut to = Cdr::new();
    to.u32(sensors.len() as u32);
    for (
        frame_id,
        Isometry3 {
            rotation,
            translation,
        },
    ) in sensors
    {
        to.header(time_ns, VEHICLE_FRAME);
        to.string(frame_id);
        to.f64s(translation.vector.as_slice());
        to.quaternion(&rotation);
    }
    to.bytes
}

/// `visualization_msgs/MarkerArray` of the labelled boxes, which replace those of the frame before.
pub(crate) fn markers(time_ns: u64, labels: &[KittiLabel], calibration: &Calibration) -> Vec<u8> {
    const CUBE: u32 = 1;
    const ADD: u32 = 0;
    const DELETE_ALL: u32 = 3;
    let mut to = Cdr::new();
    to.u32(labels.len() as u32 + 1);
    let nothing = (Vector3::zeros(), Vector3::zeros(), 0.0);
    marker(&mut to, time_ns, ("", 0, CUBE, DELETE_ALL), nothing);
    for (id, label) in labels.iter().enumerate() {
        let header = (label.kind.as_str(), id as u32, CUBE, ADD);
        let (center_m, yaw_rad) = label.pose_in_lidar(calibration);
        let [height, width, length] = label.size_hwl_m;
        let cube = (center_m, Vector3::new(length, width, height), yaw_rad);
        marker(&mut to, time_ns, header, cube);
    }
    to.bytes
}

/// (namespace, id, type, action) and (centre, size, yaw).
fn marker(
    to: &mut Cdr,
    time_ns: u64,
    (namespace, id, kind, action): (&str, u32, u32, u32),
    (center_m, size_m, yaw_rad): (Vector3<f64>, Vector3<f64>, f64),
) {
    const COLOR: [f32; 4] = [0.1, 0.9, 0.3, 0.5];
    to.header(time_ns, LIDAR_FRAME);
    to.string(namespace);
    [id, kind, action]
        .into_iter()
        .for_each(|value| to.u32(value));
    to.f64s(center_m.as_slice());
    to.quaternion(&UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad));
    to.f64s(size_m.as_slice());
    to.f32s(&COLOR);
    // No lifetime, not locked, no points, no colours, no texture ...
    to.u32(0);
    to.u32(0);
    to.bool(false);
    to.u32(0);
    to.u32(0);
    to.string("");
    to.header(0, "");
    to.string("");
    to.byte_sequence(&[]);
    to.u32(0);
    // ... and no text but the kind, no mesh.
    to.string(namespace);
    to.string("");
    to.string("");
    to.byte_sequence(&[]);
    to.bool(false);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_after_the_header() {
        let mut to = Cdr::new();
        to.u8(7);
        to.f64s(&[1.5]);
        to.string("ab");
        to.u32(9);
        let expected = [
            &[0, 1, 0, 0][..],
            &[7, 0, 0, 0, 0, 0, 0, 0],
            &1.5_f64.to_le_bytes(),
            &[3, 0, 0, 0, b'a', b'b', 0, 0],
            &[9, 0, 0, 0],
        ];
        assert_eq!(to.bytes, expected.concat());
    }
}
