use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::{LANE_COUNT, LaneIndex, Se2Pose, wrap_angle};

const NODE_SPACING_M: f64 = 0.5;
/// Two-point steps of the coarse search, in nodes.
const COARSE_STRIDE: usize = 8;

/// A piece of the reference line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum RoadSegment {
    /// Curvature zero.
    Straight {
        /// Length along the reference line.
        length_m: f64,
    },
    /// Curvature that goes linearly from the one end's to the other's.
    Clothoid {
        /// Length along the reference line.
        length_m: f64,
        /// Curvature at the start in 1/m, positive to the left.
        from_per_m: f64,
        /// Curvature at the end in 1/m, positive to the left.
        to_per_m: f64,
    },
    /// Constant curvature.
    Arc {
        /// Length along the reference line.
        length_m: f64,
        /// Curvature in 1/m, positive to the left.
        curvature_per_m: f64,
    },
}

impl RoadSegment {
    /// Length along the reference line in metres.
    pub fn length_m(&self) -> f64 {
        match *self {
            Self::Straight { length_m }
            | Self::Clothoid { length_m, .. }
            | Self::Arc { length_m, .. } => length_m,
        }
    }

    fn curvatures(&self) -> (f64, f64) {
        match *self {
            Self::Straight { .. } => (0.0, 0.0),
            Self::Clothoid {
                from_per_m,
                to_per_m,
                ..
            } => (from_per_m, to_per_m),
            Self::Arc {
                curvature_per_m, ..
            } => (curvature_per_m, curvature_per_m),
        }
    }
}

/// A position along (`s_m`) and to the left (`d_m`) of the reference line.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FrenetPoint {
    /// Arc length along the reference line in metres.
    pub s_m: f64,
    /// Signed distance from the reference line in metres, positive to the left.
    pub d_m: f64,
}

/// A Frenet position with the heading relative to the road.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct FrenetPose {
    /// Arc length along the reference line in metres.
    pub s_m: f64,
    /// Signed distance from the reference line in metres, positive to the left.
    pub d_m: f64,
    /// Heading minus the road's heading, in (-pi, pi].
    pub psi_rad: f64,
    /// Curvature of the reference line at `s_m` in 1/m.
    pub curvature_per_m: f64,
}

/// Why a road cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RoadError {
    /// There is no segment.
    #[error("a road needs at least one segment")]
    Empty,
    /// A length or curvature is not finite, or a length is not positive.
    #[error("segment {0} of the road has a length or curvature that is no usable number")]
    BadSegment(usize),
    /// A lane centre would come to lie at or beyond the centre of the turn.
    #[error(
        "segment {index} of the road turns with radius {radius_m:.1} m, tighter than the road is wide"
    )]
    TooTight {
        /// Which segment, from 0.
        index: usize,
        /// Its smallest radius.
        radius_m: f64,
    },
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    s_m: f64,
    pose: Se2Pose,
    curvature: f64,
    /// Change of curvature per metre up to the next node.
    sharpness: f64,
}

impl Node {
    fn heading_at(&self, ds: f64) -> f64 {
        self.pose.yaw_rad + self.curvature * ds + 0.5 * self.sharpness * ds * ds
    }

    fn position_at(&self, ds: f64) -> Vector2<f64> {
        // Gauss-Legendre quadrature with three points: exact to 1e-13 over half a metre.
        let (offset, outer, inner) = ((0.6_f64).sqrt(), 5.0 / 18.0, 8.0 / 18.0);
        [(-offset, outer), (0.0, inner), (offset, outer)]
            .iter()
            .fold(self.pose.position(), |sum, &(node, weight)| {
                let (sin, cos) = self.heading_at(0.5 * ds * (1.0 + node)).sin_cos();
                sum + weight * ds * Vector2::new(cos, sin)
            })
    }

    fn pose_at(&self, ds: f64) -> Se2Pose {
        let position = self.position_at(ds);
        Se2Pose::new(position.x, position.y, wrap_angle(self.heading_at(ds)))
    }
}

/// A three-lane road along a reference line, which is the centre line of the middle lane.
///
/// Beyond its ends the road goes on straight.
#[derive(Debug, Clone, PartialEq)]
pub struct Road {
    nodes: Vec<Node>,
    length_m: f64,
    lane_width_m: f64,
    sharpest_per_m: f64,
}

impl Road {
    /// Lays `segments` end to end from `start`.
    ///
    /// # Errors
    /// When there is no segment, a number is unusable or a turn is tighter than the road is wide.
    pub fn new(
        start: Se2Pose,
        segments: &[RoadSegment],
        lane_width_m: f64,
    ) -> Result<Self, RoadError> {
        if segments.is_empty() {
            return Err(RoadError::Empty);
        }
        let mut nodes = vec![Node {
            s_m: 0.0,
            pose: start,
            curvature: 0.0,
            sharpness: 0.0,
        }];
        let half_width = lane_width_m * f64::from(LANE_COUNT) / 2.0;
        for (index, segment) in segments.iter().enumerate() {
            let length = segment.length_m();
            let (from, to) = segment.curvatures();
            let usable = [length, from, to, lane_width_m]
                .iter()
                .all(|x| x.is_finite());
            if !usable || length <= 0.0 || length > 1e6 || lane_width_m <= 0.0 {
                return Err(RoadError::BadSegment(index));
            }
            let sharpest = from.abs().max(to.abs());
            if sharpest * (half_width + 1.0) >= 1.0 {
                return Err(RoadError::TooTight {
                    index,
                    radius_m: 1.0 / sharpest,
                });
            }
            let count = (length / NODE_SPACING_M).ceil();
            let (ds, sharpness) = (length / count, (to - from) / length);
            for i in 0..count as usize {
                let Some(last) = nodes.last_mut() else { break };
                last.curvature = from + sharpness * ds * i as f64;
                last.sharpness = sharpness;
                let next = Node {
                    s_m: last.s_m + ds,
                    pose: last.pose_at(ds),
                    curvature: 0.0,
                    sharpness: 0.0,
                };
                nodes.push(next);
            }
        }
        let length_m = nodes.last().map_or(0.0, |node| node.s_m);
        let sharpest_per_m = segments
            .iter()
            .map(|segment| segment.curvatures())
            .fold(0.0, |max: f64, (from, to)| {
                max.max(from.abs()).max(to.abs())
            });
        Ok(Self {
            nodes,
            length_m,
            lane_width_m,
            sharpest_per_m,
        })
    }

    /// Length of the reference line in metres.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Width of a lane in metres.
    pub fn lane_width_m(&self) -> f64 {
        self.lane_width_m
    }

    /// Offset d of the centre of `lane` in metres.
    pub fn lane_center_m(&self, lane: LaneIndex) -> f64 {
        (f64::from(LANE_COUNT - 1) / 2.0 - f64::from(lane.get())) * self.lane_width_m
    }

    /// Offsets d (right edge, left edge) of `lane` in metres.
    pub fn lane_bounds_m(&self, lane: LaneIndex) -> (f64, f64) {
        let center = self.lane_center_m(lane);
        (
            center - self.lane_width_m / 2.0,
            center + self.lane_width_m / 2.0,
        )
    }

    /// Offset d of lane mark `mark`, counted from the left edge line (0) to the right one (3).
    pub fn mark_offset_m(&self, mark: usize) -> f64 {
        (f64::from(LANE_COUNT) / 2.0 - mark as f64) * self.lane_width_m
    }

    /// The lane that holds the offset `d_m`, or `None` off the road.
    pub fn lane_at(&self, d_m: f64) -> Option<LaneIndex> {
        let from_left = f64::from(LANE_COUNT) / 2.0 - d_m / self.lane_width_m;
        // A cast of a float saturates, so a far offset is refused by `LaneIndex::new`.
        (from_left >= 0.0)
            .then(|| LaneIndex::new(from_left as u8))
            .flatten()
    }

    fn node_before(&self, s_m: f64) -> &Node {
        let index = self.nodes.partition_point(|node| node.s_m <= s_m);
        &self.nodes[index.saturating_sub(1)]
    }

    /// The reference line at `s_m`: its pose and curvature.
    pub fn reference(&self, s_m: f64) -> (Se2Pose, f64) {
        let node = self.node_before(s_m);
        let ds = s_m - node.s_m;
        if s_m < 0.0 || s_m >= self.length_m {
            let straight = node.pose.compose(Se2Pose::new(ds, 0.0, 0.0));
            return (straight, 0.0);
        }
        (node.pose_at(ds), node.curvature + node.sharpness * ds)
    }

    /// Curvature of the reference line at `s_m` in 1/m, positive to the left.
    pub fn curvature(&self, s_m: f64) -> f64 {
        self.reference(s_m).1
    }

    /// Largest |curvature| of the whole reference line in 1/m.
    pub fn sharpest_per_m(&self) -> f64 {
        self.sharpest_per_m
    }

    /// Largest |curvature| of the reference line between `from_m` and `to_m`.
    pub fn max_abs_curvature(&self, from_m: f64, to_m: f64) -> f64 {
        let ends = self.curvature(from_m).abs().max(self.curvature(to_m).abs());
        let first = self.nodes.partition_point(|node| node.s_m < from_m);
        self.nodes[first.min(self.nodes.len())..]
            .iter()
            .take_while(|node| node.s_m <= to_m)
            .fold(ends, |max, node| max.max(node.curvature.abs()))
    }

    /// World position of a Frenet point.
    pub fn from_frenet(&self, point: FrenetPoint) -> Vector2<f64> {
        let (pose, _) = self.reference(point.s_m);
        pose.transform(Vector2::new(0.0, point.d_m))
    }

    /// World pose at a Frenet position, with heading `psi_rad` relative to the road.
    pub fn pose_from_frenet(&self, s_m: f64, d_m: f64, psi_rad: f64) -> Se2Pose {
        self.reference(s_m)
            .0
            .compose(Se2Pose::new(0.0, d_m, psi_rad))
    }

    /// Frenet coordinates of a world position: the nearest point of the reference line.
    pub fn to_frenet(&self, position: Vector2<f64>) -> FrenetPoint {
        let squared = |node: &Node| (node.pose.position() - position).norm_squared();
        let nearest = self
            .nodes
            .iter()
            .step_by(COARSE_STRIDE)
            .chain(self.nodes.last())
            .min_by(|a, b| squared(a).total_cmp(&squared(b)));
        self.to_frenet_near(position, nearest.map_or(0.0, |node| node.s_m))
    }

    /// As [`Road::to_frenet`], from a guess `s_hint_m` some metres from the answer.
    pub fn to_frenet_near(&self, position: Vector2<f64>, s_hint_m: f64) -> FrenetPoint {
        let mut s_m = s_hint_m;
        let mut d_m = 0.0;
        for _ in 0..12 {
            let (pose, curvature) = self.reference(s_m);
            let local = pose.inverse_transform(position);
            d_m = local.y;
            // Newton on the along-track residual; its slope is 1 - kappa d.
            let step = local.x / (1.0 - curvature * local.y).max(0.2);
            s_m += step.clamp(-8.0, 8.0);
            if step.abs() < 1e-10 {
                break;
            }
        }
        FrenetPoint { s_m, d_m }
    }

    /// Frenet position and relative heading of a world pose.
    pub fn to_frenet_pose(&self, pose: Se2Pose) -> FrenetPose {
        self.frenet_pose_at(pose, self.to_frenet(pose.position()))
    }

    /// As [`Road::to_frenet_pose`], from a guess `s_hint_m` some metres from the answer.
    pub fn to_frenet_pose_near(&self, pose: Se2Pose, s_hint_m: f64) -> FrenetPose {
        self.frenet_pose_at(pose, self.to_frenet_near(pose.position(), s_hint_m))
    }

    fn frenet_pose_at(&self, pose: Se2Pose, point: FrenetPoint) -> FrenetPose {
        let (reference, curvature_per_m) = self.reference(point.s_m);
        FrenetPose {
            s_m: point.s_m,
            d_m: point.d_m,
            psi_rad: wrap_angle(pose.yaw_rad - reference.yaw_rad),
            curvature_per_m,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn corner() -> Road {
        let segments = [
            RoadSegment::Straight { length_m: 120.0 },
            RoadSegment::Clothoid {
                length_m: 40.0,
                from_per_m: 0.0,
                to_per_m: 1.0 / 60.0,
            },
            RoadSegment::Arc {
                length_m: 70.0,
                curvature_per_m: 1.0 / 60.0,
            },
            RoadSegment::Clothoid {
                length_m: 40.0,
                from_per_m: 1.0 / 60.0,
                to_per_m: 0.0,
            },
            RoadSegment::Straight { length_m: 100.0 },
        ];
        Road::new(Se2Pose::new(5.0, -3.0, 0.3), &segments, 3.5).expect("a road")
    }

    #[test]
    fn an_arc_is_a_circle() {
        let arc = RoadSegment::Arc {
            length_m: 100.0,
            curvature_per_m: 0.01,
        };
        let road = Road::new(Se2Pose::default(), &[arc], 3.5).expect("a road");
        let (pose, curvature) = road.reference(99.0);
        assert!((pose.x_m - 100.0 * (0.99_f64).sin()).abs() < 1e-10);
        assert!((pose.y_m - 100.0 * (1.0 - (0.99_f64).cos())).abs() < 1e-10);
        assert!((pose.yaw_rad - 0.99).abs() < 1e-12);
        assert!((curvature - 0.01).abs() < 1e-15);
    }

    #[test]
    fn a_clothoid_turns_by_half_its_length_times_its_curvature() {
        let road = corner();
        assert!((road.reference(160.0).0.yaw_rad - 0.3 - 0.5 * 40.0 / 60.0).abs() < 1e-10);
        assert!((road.max_abs_curvature(0.0, 140.0) - 0.5 / 60.0).abs() < 1e-12);
        assert!((road.max_abs_curvature(0.0, 400.0) - 1.0 / 60.0).abs() < 1e-12);
    }

    #[test]
    fn lanes_are_counted_from_the_left() {
        let road = corner();
        assert_eq!(road.lane_at(3.5), Some(LaneIndex::LEFTMOST));
        assert_eq!(road.lane_at(-3.5), Some(LaneIndex::RIGHTMOST));
        assert_eq!(road.lane_at(0.0), LaneIndex::new(1));
        assert_eq!(road.lane_at(5.3), None);
        assert_eq!(road.lane_at(-5.3), None);
        assert!((road.mark_offset_m(0) - 5.25).abs() < 1e-12);
        assert!((road.lane_center_m(LaneIndex::LEFTMOST) - 3.5).abs() < 1e-12);
    }

    #[test]
    fn unusable_roads_are_refused() {
        let tight = RoadSegment::Arc {
            length_m: 10.0,
            curvature_per_m: 0.2,
        };
        let nan = RoadSegment::Straight { length_m: f64::NAN };
        let start = Se2Pose::default();
        assert_eq!(Road::new(start, &[], 3.5), Err(RoadError::Empty));
        assert_eq!(Road::new(start, &[nan], 3.5), Err(RoadError::BadSegment(0)));
        assert!(matches!(
            Road::new(start, &[tight], 3.5),
            Err(RoadError::TooTight { index: 0, .. })
        ));
    }

    proptest! {
        #[test]
        fn frenet_there_and_back(s_m in -30.0..420.0_f64, d_m in -12.0..12.0_f64) {
            let road = corner();
            let point = road.from_frenet(FrenetPoint { s_m, d_m });
            let back = road.to_frenet(point);
            prop_assert!((back.s_m - s_m).abs() < 1e-7, "{back:?}");
            prop_assert!((back.d_m - d_m).abs() < 1e-7, "{back:?}");
        }
    }
}
