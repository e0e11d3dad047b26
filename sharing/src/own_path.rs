use std::collections::VecDeque;

use covista_world::{Se2Pose, VehicleDimensions};

use crate::association::Body;

/// Own poses are remembered this long.
const REMEMBERED_S: f64 = 12.0;
/// How far others may misplace or mismeasure the vehicle along and across, in metres.
const SLACK_M: [f64; 2] = [2.0, 1.0];

#[derive(Debug, Clone, Copy)]
struct OwnPose {
    time_s: f64,
    pose: Se2Pose,
    speed_mps: f64,
}

/// Where the vehicle itself was, to recognise it in what others report.
#[derive(Debug, Clone)]
pub(crate) struct OwnPath {
    dimensions: VehicleDimensions,
    poses: VecDeque<OwnPose>,
}

impl OwnPath {
    pub fn new(dimensions: VehicleDimensions) -> Self {
        Self {
            dimensions,
            poses: VecDeque::new(),
        }
    }

    pub fn push(&mut self, time_s: f64, pose: Se2Pose, speed_mps: f64) {
        self.poses.push_back(OwnPose {
            time_s,
            pose,
            speed_mps,
        });
        while (self.poses.front()).is_some_and(|old| time_s - old.time_s > REMEMBERED_S) {
            self.poses.pop_front();
        }
    }

    /// The own body with the rear axle at `pose`.
    pub fn body(&self, pose: Se2Pose) -> Body {
        Body {
            center: self.dimensions.center_pose(pose),
            length_m: self.dimensions.length_m,
            width_m: self.dimensions.width_m,
        }
    }

    /// Whether `body`, measured by another at `time_s`, is the vehicle itself.
    pub fn shows(&self, time_s: f64, body: &Body) -> bool {
        let age_s = |own: &OwnPose| (own.time_s - time_s).abs();
        let nearest = (self.poses.iter()).min_by(|a, b| age_s(a).total_cmp(&age_s(b)));
        nearest.is_some_and(|own| {
            let travelled_m = own.speed_mps * (time_s - own.time_s);
            let mut place = self.body(own.pose.compose(Se2Pose::new(travelled_m, 0.0, 0.0)));
            place.length_m += SLACK_M[0];
            place.width_m += SLACK_M[1];
            place.coincides(body)
        })
    }
}
