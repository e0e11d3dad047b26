//! Rays from one point that lie close together or in one plane, cast at once: the parts that they
//! can meet are found once for all of them, and a part is clipped by eight rays side by side.

use nalgebra::{Point3, Vector3};

use crate::bvh::{Boxes, Bvh, Child, Lanes};
use crate::part::{Entry, Face, Part};

const LANES: usize = 8;
const NO_FACE: u32 = u32::MAX;
/// The least cosine between a fan's rays and their middle.
const NARROWEST: f32 = 0.2;
/// What rounding may add to the slopes of a ray.
const ROUNDING: f32 = 1e-5;

/// The wedge that holds the rays of a fan, seen from their origin: a frame of the middle ray, the
/// plane's normal and the direction across both.
pub(crate) struct Wedge {
    origin: Point3<f32>,
    ahead: Vector3<f32>,
    aside: Vector3<f32>,
    across: Vector3<f32>,
    /// No ray goes further aside than this per metre ahead.
    spread: f32,
    /// Least and greatest way across per metre ahead.
    slopes: [f32; 2],
    reach_m: f32,
}

/// A part that rays of a fan may meet.
pub(crate) struct Candidate {
    pub(crate) part: u32,
    near_m: f32,
    slopes: [f32; 2],
}

/// Eight rays and what they have met so far.
pub(crate) struct Packet {
    directions: [[f32; LANES]; 3],
    reach_m: [f32; LANES],
    faces: [u32; LANES],
    parts: [u32; LANES],
    slopes: [f32; 2],
    farthest_m: f32,
}

/// Least and greatest of a linear form over four boxes.
fn range(boxes: &Boxes, form: &Vector3<f32>, at_origin: f32) -> (Lanes, Lanes) {
    let (mut least, mut greatest) = ([-at_origin; 4], [-at_origin; 4]);
    for (axis, planes) in boxes.iter().enumerate() {
        let factor = form[axis];
        let low = usize::from(factor < 0.0);
        for lane in 0..4 {
            least[lane] += factor * planes[low][lane];
            greatest[lane] += factor * planes[1 - low][lane];
        }
    }
    (least, greatest)
}

fn bounds(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values.fold([f32::MAX, f32::MIN], |[low, high], value| {
        [low.min(value), high.max(value)]
    })
}

impl Wedge {
    /// The wedge about `directions`, or `None` where they spread too widely for one.
    pub(crate) fn new(
        origin: &Point3<f32>,
        directions: &[Vector3<f32>],
        reach_m: f32,
    ) -> Option<Self> {
        let (first, last) = (directions.first()?, directions.last()?);
        let middle = directions
            .iter()
            .sum::<Vector3<f32>>()
            .try_normalize(1e-3)?;
        let normal = first.cross(last);
        let aside = if normal.norm() > 1e-4 {
            normal.normalize()
        } else {
            let axis = Vector3::ith(middle.iamin(), 1.0);
            middle.cross(&axis).try_normalize(1e-3)?
        };
        let ahead = (middle - aside * aside.dot(&middle)).try_normalize(1e-3)?;
        let across = aside.cross(&ahead);
        let is_narrow = directions.iter().all(|way| way.dot(&ahead) > NARROWEST);
        let slope = |side: Vector3<f32>| {
            bounds(
                directions
                    .iter()
                    .map(move |way| way.dot(&side) / way.dot(&ahead)),
            )
        };
        let [right, left] = slope(aside);
        is_narrow.then(|| Self {
            origin: *origin,
            ahead,
            aside,
            across,
            spread: left.max(-right) + ROUNDING,
            slopes: slope(across),
            reach_m,
        })
    }

    /// The parts in the wedge, from near to far.
    pub(crate) fn candidates(&self, bvh: &Bvh, admits: impl Fn(u32) -> bool) -> Vec<Candidate> {
        let mut candidates = Vec::with_capacity(32);
        let mut open = Vec::with_capacity(32);
        open.extend(bvh.root());
        while let Some(index) = open.pop() {
            let node = bvh.node(index);
            let (near_m, lowest, highest) = self.meet(&node.boxes);
            for (slot, child) in node.children() {
                let slopes = [lowest[slot], highest[slot]];
                if near_m[slot] > self.reach_m || !overlap(&slopes, &self.slopes) {
                    continue;
                }
                match child {
                    Child::Node(index) => open.push(index),
                    Child::Leaf(part) if admits(part) => candidates.push(Candidate {
                        part,
                        near_m: near_m[slot],
                        slopes,
                    }),
                    Child::Leaf(_) => {}
                }
            }
        }
        candidates.sort_unstable_by(|a, b| a.near_m.total_cmp(&b.near_m).then(a.part.cmp(&b.part)));
        candidates
    }

    /// For each of four boxes the distance from which on a ray may meet it, infinite for those
    /// outside, and the least and the greatest slope of such a ray.
    fn meet(&self, boxes: &Boxes) -> (Lanes, Lanes, Lanes) {
        let form = |way: &Vector3<f32>| range(boxes, way, way.dot(&self.origin.coords));
        let (near, far) = form(&self.ahead);
        let (right, left) = form(&self.aside);
        let (low, high) = form(&self.across);
        let (mut near_m, mut lowest, mut highest) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        for lane in 0..4 {
            let width_m = self.spread * far[lane];
            let meets = (far[lane] >= 0.0) & (right[lane] <= width_m) & (left[lane] >= -width_m);
            near_m[lane] = if meets { near[lane] } else { f32::INFINITY };
            let steep = if low[lane] < 0.0 {
                near[lane]
            } else {
                far[lane]
            };
            lowest[lane] = low[lane] / steep - ROUNDING;
            let steep = if high[lane] > 0.0 {
                near[lane]
            } else {
                far[lane]
            };
            highest[lane] = high[lane] / steep + ROUNDING;
            // The box reaches round the origin.
            let surrounds = near[lane] <= 0.0;
            lowest[lane] = if surrounds { f32::MIN } else { lowest[lane] };
            highest[lane] = if surrounds { f32::MAX } else { highest[lane] };
        }
        (near_m, lowest, highest)
    }
}

fn overlap(a: &[f32; 2], b: &[f32; 2]) -> bool {
    a[0] <= b[1] && b[0] <= a[1]
}

impl Packet {
    pub(crate) const LANES: usize = LANES;

    /// Up to eight rays of the fan, each with its reach.
    pub(crate) fn new(wedge: &Wedge, rays: &[(Vector3<f32>, f32)]) -> Self {
        let mut packet = Self {
            directions: [[0.0; LANES]; 3],
            // Nothing lies within the reach of the rays that are not there.
            reach_m: [-1.0; LANES],
            faces: [NO_FACE; LANES],
            parts: [0; LANES],
            slopes: bounds(
                rays.iter()
                    .map(|(way, _)| way.dot(&wedge.across) / way.dot(&wedge.ahead)),
            ),
            farthest_m: 0.0,
        };
        for (lane, (direction, reach_m)) in rays.iter().enumerate() {
            for axis in 0..3 {
                packet.directions[axis][lane] = direction[axis];
            }
            packet.reach_m[lane] = *reach_m;
        }
        packet.see_how_far();
        packet
    }

    /// Whether a ray of the packet may meet the part before what it has met.
    pub(crate) fn may_meet(&self, candidate: &Candidate) -> bool {
        candidate.near_m <= self.farthest_m && overlap(&candidate.slopes, &self.slopes)
    }

    /// Meets a part; the origin is `from` in its frame. As [`Part::entry`], ray by ray.
    pub(crate) fn meet(&mut self, index: u32, part: &Part, faces: &[Face], from: &Vector3<f32>) {
        let (mut enter_m, mut exit_m) = ([0.0; LANES], [f32::INFINITY; LANES]);
        let mut through = [NO_FACE; LANES];
        let [ways_x, ways_y, ways_z] = &self.directions;
        for face in part.first_face..part.end_face {
            let [x, y, z, offset_m] = faces[face as usize];
            let gap_m = offset_m - (x * from.x + y * from.y + z * from.z);
            for lane in 0..LANES {
                let slope = x * ways_x[lane] + y * ways_y[lane] + z * ways_z[lane] + 0.0;
                let crossing_m = gap_m / slope;
                let inwards = slope < 0.0;
                let later = inwards & (crossing_m > enter_m[lane]);
                let sooner = !inwards & (crossing_m < exit_m[lane]);
                enter_m[lane] = if later { crossing_m } else { enter_m[lane] };
                through[lane] = if later { face } else { through[lane] };
                exit_m[lane] = if sooner { crossing_m } else { exit_m[lane] };
            }
        }
        let mut nearer_by_any = false;
        for lane in 0..LANES {
            let reach_m = self.reach_m[lane];
            let nearer = (enter_m[lane] < reach_m)
                | ((enter_m[lane] <= reach_m) & (through[lane] < self.faces[lane]));
            let met = (through[lane] != NO_FACE) & (enter_m[lane] < exit_m[lane]) & nearer;
            self.reach_m[lane] = if met { enter_m[lane] } else { reach_m };
            self.faces[lane] = if met { through[lane] } else { self.faces[lane] };
            self.parts[lane] = if met { index } else { self.parts[lane] };
            nearer_by_any |= met;
        }
        if nearer_by_any {
            self.see_how_far();
        }
    }

    fn see_how_far(&mut self) {
        self.farthest_m = self
            .reach_m
            .iter()
            .fold(0.0, |far, &m| if m > far { m } else { far });
    }

    /// The part that the ray in `lane` met first, and where.
    pub(crate) fn met(&self, lane: usize) -> Option<(u32, Entry)> {
        let entry = Entry {
            distance_m: self.reach_m[lane],
            face: self.faces[lane],
        };
        (entry.face != NO_FACE).then_some((self.parts[lane], entry))
    }
}
