use nalgebra::Vector2;

use crate::{FrenetPoint, FrenetPose, LANE_COUNT, LaneIndex, RoadSegment, Se2Pose, wrap_angle};

mod milestones;
#[cfg(test)]
mod tests;

use milestones::Milestones;

const NODE_SPACING_M: f64 = 0.5;
/// Every so many metres it is noted which segment is there.
const NOTE_SPACING_M: f64 = 16.0;
/// Every so many nodes there is a milestone, for the coarse search.
const MILESTONE_NODES: usize = 8;

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
    forward: Vector2<f64>,
    curvature: f64,
    /// Change of curvature per metre up to the next node.
    sharpness: f64,
}

impl Node {
    fn new(s_m: f64, pose: Se2Pose) -> Self {
        Self {
            s_m,
            pose,
            forward: pose.forward(),
            curvature: 0.0,
            sharpness: 0.0,
        }
    }

    fn turned_at(&self, ds: f64) -> f64 {
        self.curvature * ds + 0.5 * self.sharpness * ds * ds
    }

    fn curvature_at(&self, ds: f64) -> f64 {
        self.curvature + self.sharpness * ds
    }

    /// Direction of the reference line `ds` further on.
    fn forward_at(&self, ds: f64) -> Vector2<f64> {
        rotated(self.forward, unit_vector(self.turned_at(ds)))
    }

    fn position_at(&self, ds: f64) -> Vector2<f64> {
        // Gauss-Legendre quadrature with three points: exact to 1e-13 over half a metre.
        const OUTER: f64 = 0.774_596_669_241_483_4;
        let at = |node: f64| unit_vector(self.turned_at(0.5 * ds * (1.0 + node)));
        let sum = (at(-OUTER) + at(OUTER)) * (5.0 / 18.0) + at(0.0) * (8.0 / 18.0);
        self.pose.position() + rotated(self.forward, sum * ds)
    }

    fn pose_at(&self, ds: f64) -> Se2Pose {
        let position = self.position_at(ds);
        Se2Pose::new(position.x, position.y, self.yaw_at(ds))
    }

    fn yaw_at(&self, ds: f64) -> f64 {
        wrap_angle(self.pose.yaw_rad + self.turned_at(ds))
    }
}

/// Cosine and sine of the small angle by which a road turns within half a metre: exact to 1e-14
/// up to half a radian, without a call of the library.
fn unit_vector(angle_rad: f64) -> Vector2<f64> {
    let x = angle_rad;
    if x == 0.0 {
        return Vector2::new(1.0, 0.0);
    }
    let q = x * x;
    let cos =
        1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))));
    let sin = x
        * (1.0
            - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0)))));
    Vector2::new(cos, sin)
}

/// `vector`, turned by the angle whose cosine and sine are given.
fn rotated(vector: Vector2<f64>, by: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(
        vector.x * by.x - vector.y * by.y,
        vector.x * by.y + vector.y * by.x,
    )
}

/// Nodes at equal distances: those of one segment.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    from_m: f64,
    to_m: f64,
    from_per_m: f64,
    to_per_m: f64,
    /// Change of curvature per metre.
    sharpness: f64,
    /// Angle turned from the start of the road to that of the segment.
    turned_rad: f64,
    first_node: usize,
    nodes_per_m: f64,
}

impl Stretch {
    fn curvature(&self, s_m: f64) -> f64 {
        let share = (s_m - self.from_m) / (self.to_m - self.from_m);
        self.from_per_m + share * (self.to_per_m - self.from_per_m)
    }

    /// Angle turned from the start of the road to `s_m`, in the segment or at its nearer end.
    fn turned_rad(&self, s_m: f64) -> f64 {
        let way_m = s_m.clamp(self.from_m, self.to_m) - self.from_m;
        self.turned_rad + (self.from_per_m + 0.5 * self.sharpness * way_m) * way_m
    }
}

/// The last of `stretches` that does not begin beyond `s_m`, or the first.
fn last_before(stretches: &[Stretch], s_m: f64) -> usize {
    let after = stretches.partition_point(|known| known.from_m <= s_m);
    after.saturating_sub(1)
}

/// A point of the reference line without its angle.
struct Reference {
    position: Vector2<f64>,
    forward: Vector2<f64>,
    curvature_per_m: f64,
}

/// A three-lane road along a reference line, which is the centre line of the middle lane.
///
/// Beyond its ends the road goes on straight.
#[derive(Debug, Clone, PartialEq)]
pub struct Road {
    nodes: Vec<Node>,
    milestones: Milestones,
    stretches: Vec<Stretch>,
    /// The segment at each multiple of [`NOTE_SPACING_M`].
    notes: Vec<u32>,
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
        let mut nodes = vec![Node::new(0.0, start)];
        let mut stretches = Vec::with_capacity(segments.len());
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
            let from_m = nodes.last().map_or(0.0, |node| node.s_m);
            let turned_rad = stretches
                .last()
                .map_or(0.0, |before: &Stretch| before.turned_rad(before.to_m));
            stretches.push(Stretch {
                turned_rad,
                from_m,
                to_m: from_m + length,
                from_per_m: from,
                to_per_m: to,
                sharpness,
                first_node: nodes.len() - 1,
                nodes_per_m: 1.0 / ds,
            });
            for i in 0..count as usize {
                let Some(last) = nodes.last_mut() else { break };
                last.curvature = from + sharpness * ds * i as f64;
                last.sharpness = sharpness;
                let next = Node::new(last.s_m + ds, last.pose_at(ds));
                nodes.push(next);
            }
        }
        let length_m = nodes.last().map_or(0.0, |node| node.s_m);
        let notes = (0..=(length_m / NOTE_SPACING_M) as usize)
            .map(|note| last_before(&stretches, note as f64 * NOTE_SPACING_M) as u32)
            .collect();
        let sharpest_per_m = segments
            .iter()
            .map(|segment| segment.curvatures())
            .fold(0.0, |max: f64, (from, to)| {
                max.max(from.abs()).max(to.abs())
            });
        let last = nodes.last();
        let marked = nodes.iter().step_by(MILESTONE_NODES).chain(last);
        let milestones = Milestones::new(
            marked.map(|node| node.pose.position()).collect(),
            MILESTONE_NODES as f64 * NODE_SPACING_M,
        );
        Ok(Self {
            nodes,
            milestones,
            stretches,
            notes,
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

    /// The last node that does not lie beyond `s_m`, or the first one.
    fn node_before(&self, s_m: f64) -> &Node {
        let last = self.nodes.len() - 1;
        if self.is_beyond_ends(s_m) {
            return &self.nodes[if s_m < 0.0 { 0 } else { last }];
        }
        let stretch = self.stretch_at(s_m);
        let steps = (s_m - stretch.from_m) * stretch.nodes_per_m;
        // Rounding may lead to a neighbour of the right one.
        let mut index = (stretch.first_node + steps as usize).min(last);
        while index > 0 && self.nodes[index].s_m > s_m {
            index -= 1;
        }
        while index < last && self.nodes[index + 1].s_m <= s_m {
            index += 1;
        }
        &self.nodes[index]
    }

    fn is_beyond_ends(&self, s_m: f64) -> bool {
        s_m < 0.0 || s_m >= self.length_m
    }

    /// The reference line at `s_m`: its pose and curvature.
    pub fn reference(&self, s_m: f64) -> (Se2Pose, f64) {
        let node = self.node_before(s_m);
        let ds = s_m - node.s_m;
        if self.is_beyond_ends(s_m) {
            let straight = node.pose.compose(Se2Pose::new(ds, 0.0, 0.0));
            return (straight, 0.0);
        }
        (node.pose_at(ds), node.curvature_at(ds))
    }

    /// Heading and curvature of the reference line at `s_m`.
    fn heading(&self, s_m: f64) -> (f64, f64) {
        let node = self.node_before(s_m);
        if self.is_beyond_ends(s_m) {
            return (wrap_angle(node.pose.yaw_rad), 0.0);
        }
        let ds = s_m - node.s_m;
        (node.yaw_at(ds), node.curvature_at(ds))
    }

    /// As [`Road::reference`], without any angle.
    fn reference_line(&self, s_m: f64) -> Reference {
        let node = self.node_before(s_m);
        let ds = s_m - node.s_m;
        if self.is_beyond_ends(s_m) {
            return Reference {
                position: node.pose.position() + node.forward * ds,
                forward: node.forward,
                curvature_per_m: 0.0,
            };
        }
        Reference {
            position: node.position_at(ds),
            forward: node.forward_at(ds),
            curvature_per_m: node.curvature_at(ds),
        }
    }

    /// Angle in radians by which the reference line turns from `from_m` to `to_m`, positive to the
    /// left; not wrapped.
    pub fn turn_rad(&self, from_m: f64, to_m: f64) -> f64 {
        self.turned_rad(to_m) - self.turned_rad(from_m)
    }

    /// Angle in radians by which the reference line has turned from its start to `s_m`; not
    /// wrapped.
    pub fn turned_rad(&self, s_m: f64) -> f64 {
        self.stretch_at(s_m).turned_rad(s_m)
    }

    /// The segment at `s_m`, or the nearer of the first and the last.
    fn stretch_at(&self, s_m: f64) -> &Stretch {
        &self.stretches[self.stretch_index(s_m)]
    }

    fn stretch_index(&self, s_m: f64) -> usize {
        // A cast of a float saturates.
        let note = ((s_m / NOTE_SPACING_M) as usize).min(self.notes.len() - 1);
        let mut index = self.notes[note] as usize;
        while index + 1 < self.stretches.len() && self.stretches[index + 1].from_m <= s_m {
            index += 1;
        }
        index
    }

    /// Curvature of the reference line at `s_m` in 1/m, positive to the left.
    pub fn curvature(&self, s_m: f64) -> f64 {
        if self.is_beyond_ends(s_m) {
            return 0.0;
        }
        self.stretch_at(s_m).curvature(s_m)
    }

    /// Largest |curvature| of the whole reference line in 1/m.
    pub fn sharpest_per_m(&self) -> f64 {
        self.sharpest_per_m
    }

    /// Largest |curvature| of the reference line between `from_m` and `to_m`.
    pub fn max_abs_curvature(&self, from_m: f64, to_m: f64) -> f64 {
        let (least, most) = self.curvature_range(from_m, to_m);
        most.max(-least)
    }

    /// Smallest and largest curvature of the reference line between `from_m` and `to_m`.
    ///
    /// Within a segment the curvature is linear, so that both are at its ends.
    pub fn curvature_range(&self, from_m: f64, to_m: f64) -> (f64, f64) {
        let beyond = if from_m < 0.0 || to_m >= self.length_m {
            (0.0, 0.0)
        } else {
            (f64::INFINITY, f64::NEG_INFINITY)
        };
        // The segment before may end at `from_m`.
        let first = self.stretch_index(from_m).saturating_sub(1);
        self.stretches[first..]
            .iter()
            .skip_while(|stretch| stretch.to_m < from_m)
            .take_while(|stretch| stretch.from_m <= to_m)
            .fold(beyond, |(least, most), stretch| {
                let from = stretch.curvature(from_m.max(stretch.from_m));
                let to = stretch.curvature(to_m.min(stretch.to_m));
                (least.min(from).min(to), most.max(from).max(to))
            })
    }

    /// World position of a Frenet point.
    pub fn from_frenet(&self, point: FrenetPoint) -> Vector2<f64> {
        let line = self.reference_line(point.s_m);
        line.position + rotated(line.forward, Vector2::new(0.0, point.d_m))
    }

    /// World pose at a Frenet position, with heading `psi_rad` relative to the road.
    pub fn pose_from_frenet(&self, s_m: f64, d_m: f64, psi_rad: f64) -> Se2Pose {
        self.reference(s_m)
            .0
            .compose(Se2Pose::new(0.0, d_m, psi_rad))
    }

    /// Frenet coordinates of a world position: the nearest point of the reference line.
    pub fn to_frenet(&self, position: Vector2<f64>) -> FrenetPoint {
        let milestone = self.milestones.nearest(position) * MILESTONE_NODES;
        let node = &self.nodes[milestone.min(self.nodes.len() - 1)];
        self.to_frenet_near(position, node.s_m)
    }

    /// As [`Road::to_frenet`], from a guess `s_hint_m` some metres from the answer.
    pub fn to_frenet_near(&self, position: Vector2<f64>, s_hint_m: f64) -> FrenetPoint {
        let mut s_m = s_hint_m;
        let mut d_m = 0.0;
        for _ in 0..12 {
            let line = self.reference_line(s_m);
            let arm = position - line.position;
            d_m = line.forward.perp(&arm);
            // Newton on the along-track residual; its slope is 1 - kappa d.
            let step = line.forward.dot(&arm) / (1.0 - line.curvature_per_m * d_m).max(0.2);
            s_m += step.clamp(-8.0, 8.0);
            if step.abs() < 1e-7 {
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
        let (yaw_rad, curvature_per_m) = self.heading(point.s_m);
        FrenetPose {
            s_m: point.s_m,
            d_m: point.d_m,
            psi_rad: wrap_angle(pose.yaw_rad - yaw_rad),
            curvature_per_m,
        }
    }
}
