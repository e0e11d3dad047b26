use nalgebra::{Vector2, Vector3};

use crate::{LaneIndex, ObjectClass};

/// Marks of the three-lane road: left edge, two lane lines, right edge.
pub const MARK_COUNT: usize = 4;

/// An image row at which the lane network looks for marks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RowAnchor(pub u32);

/// The paper's row anchors (Section V): 100 to 370 in steps of 10, in rows of the 375-row image.
pub const ROW_ANCHORS: [RowAnchor; 28] = {
    let mut anchors = [RowAnchor(0); 28];
    let mut i = 0;
    while i < anchors.len() {
        anchors[i] = RowAnchor(100 + 10 * i as u32);
        i += 1;
    }
    anchors
};

/// The lane marks in one camera image.
#[derive(Debug, Clone, PartialEq)]
pub struct LaneMarks {
    /// For each mark of the road, counted from the left edge line, its u in pixels at each of the
    /// [`ROW_ANCHORS`], where it is seen.
    pub pixels: [[Option<f32>; ROW_ANCHORS.len()]; MARK_COUNT],
    /// For each mark the points on the ground at which it is seen, the farthest first.
    pub points: [Vec<MarkPoint>; MARK_COUNT],
    /// For each mark the curve y(x) = c0 + c1 x + c2 x^2 on the ground in the vehicle frame, in
    /// metres, where enough of it is seen.
    pub curves: [Option<MarkCurve>; MARK_COUNT],
}

/// A point of a lane mark on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkPoint {
    /// Where it is in the vehicle frame, in metres.
    pub position_m: Vector2<f64>,
    /// Standard deviation across the road, in metres.
    pub std_m: f64,
}

/// A lane mark on the ground: y(x) = c0 + c1 x + c2 x^2 in the vehicle frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkCurve {
    /// c0 in m, c1, c2 in 1/m.
    pub coefficients: [f64; 3],
    /// Nearest and farthest x at which the mark was seen, in metres.
    pub x_range_m: [f64; 2],
}

impl MarkCurve {
    /// Lateral position of the mark at `x_m`, in metres.
    pub fn y_at(&self, x_m: f64) -> f64 {
        let [c0, c1, c2] = self.coefficients;
        c0 + x_m * (c1 + x_m * c2)
    }
}

/// A 3D box found by the detector, in the LIDAR frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection3d {
    /// Centre of the box in metres.
    pub center_m: Vector3<f64>,
    /// Length, width, height in metres.
    pub size_m: Vector3<f64>,
    /// Heading about z, counter-clockwise from x.
    pub yaw_rad: f64,
    /// Its class.
    pub class: ObjectClass,
    /// Confidence in [0, 1].
    pub score: f64,
}

/// What fusion tells of one vehicle (Section V-B): the vision information of the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Percept {
    /// The box, in the vehicle frame (origin on the ground below the rear axle).
    pub detection: Detection3d,
    /// Its lane, from the camera's lane marks; `None` where it can't be known.
    pub lane: Option<LaneIndex>,
    /// Probability that it is in `lane`, or where that is `None` in the likeliest of the lanes.
    pub lane_probability: f64,
    /// Distance from the sensor in the ground plane, in metres.
    pub distance_m: f64,
    /// KITTI's observation angle alpha in (-pi, pi].
    pub observation_angle_rad: f64,
    /// KITTI's rotation_y in the camera frame, in (-pi, pi].
    pub rotation_y_rad: f64,
}
