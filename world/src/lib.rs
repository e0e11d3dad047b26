//! The vocabulary of covista: geometry and frames, the road, the bicycle model and the payloads
//! that travel between the stages.
//!
//! *Architecture invariant:* this crate knows no truth and does no I/O. A stage that depends on
//! nothing else of covista can neither read the simulator's state nor write a file.
//!
//! Frames: the world and the road are z-up; the vehicle frame is x forward, y left, z up with its
//! origin on the ground below the rear axle; the LIDAR frame has the vehicle frame's axes and sits
//! at the sensor; the camera frame is x right, y down, z forward. `a_from_b` maps coordinates in
//! `b` to coordinates in `a`. SI units, radians.

mod behaviour;
mod bicycle;
mod calibration;
mod dimensions;
mod frenet;
mod geometry;
mod lane;
mod percept;
mod road;
mod road_segment;
mod sensing;
mod sharing;
mod validate;

pub use behaviour::{Action, ActionVerdict, BarrierKind, FilterOutcome};
pub use bicycle::{BicycleState, ControlInput, STEP_S, bicycle_step};
pub use calibration::{Calibration, CalibrationError, CameraIntrinsics};
pub use dimensions::{ObjectClass, VehicleDimensions};
pub use frenet::{FrenetPoint, FrenetPose};
pub use geometry::{Se2Pose, wrap_angle};
pub use lane::{LANE_COUNT, LaneIndex};
pub use percept::{
    Detection3d, LaneMarks, MARK_COUNT, MarkCurve, MarkPoint, Percept, ROW_ANCHORS, RowAnchor,
};
pub use road::{Road, RoadError};
pub use road_segment::RoadSegment;
pub use sensing::{CameraImage, FreeSpace, PointCloud, SensorFrame};
pub use sharing::{
    CollectivePerceptionMessage, ObjectState, PerceivedObject, Sighting, StationId, Track,
};
pub use validate::{InvalidPayload, Validate};
