//! Rays from one point that lie close together or in one plane, cast at once: the parts that they
//! can meet are found once for all of them, and a part is clipped by eight rays side by side.

use nalgebra::{Point3, Vector3};

use crate::bvh::{Boxes, Bvh, Child, Lanes};
use crate::caster::ObjectRef;
use crate::part::{Entry, Face, Part};

const LANES: usize = 8;
const NO_FACE: u32 = u32::MAX;
/// The least cosine between a fan's rays and their middle.
const NARROWEST: f32 = 0.2;
/// What rounding may add to the slopes of a ray.
const ROUNDING: f32 = 1e-5;

/// Rays from one point, and what they met first.
pub(crate) struct Fan {
    wedge: Wedge,
    packets: Vec<Packet>,
}

/// The wedge that holds the rays of a fan, seen from their origin: a frame of the middle ray, the
/// plane's normal and the direction across both.
struct Wedge {
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
struct Candidate {
    part: u32,
    near_m: f32,
    slopes: [f32; 2],
}

/// Eight rays and what they have met so far.
struct Packet {
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

/// Least and greatest of the values.
fn bounds(values: &[f32]) -> [f32; 2] {
    values
        .iter()
        .fold([f32::MAX, f32::MIN], |[low, high], &value| {
            [
                if value < low { value } else { low },
                if value > high { value } else { high },
            ]
        })
}

impl Fan {
    /// The fan of rays from `origin`, each with its reach, or `None` where they spread too widely.
    pub(crate) fn new(origin: &Point3<f32>, rays: &[(Vector3<f32>, f32)]) -> Option<Self> {
        let (first, last) = (rays.first()?.0, rays.last()?.0);
        let middle = (first + last).try_normalize(NARROWEST)?;
        let normal = first.cross(&last);
        let aside = if normal.norm() > 1e-4 {
            normal.normalize()
        } else {
            let axis = Vector3::ith(middle.iamin(), 1.0);
            middle.cross(&axis).try_normalize(NARROWEST)?
        };
        let ahead = (middle - aside * aside.dot(&middle)).try_normalize(NARROWEST)?;
        let mut wedge = Wedge {
            origin: *origin,
            ahead,
            aside,
            across: aside.cross(&ahead),
            spread: ROUNDING,
            slopes: [f32::MAX, f32::MIN],
            reach_m: 0.0,
        };
        let mut packets: Vec<_> = rays.chunks(LANES).map(Packet::new).collect();
        for packet in &mut packets {
            wedge.take_in(packet)?;
        }
        Some(Self { wedge, packets })
    }

    /// The first part that each ray meets, and where; `faces` are those of all parts.
    pub(crate) fn cast(
        &mut self,
        bvh: &Bvh,
        parts: &[Part],
        faces: &[Face],
        skip: Option<ObjectRef>,
        dt_s: f32,
    ) {
        let admits = |part: u32| Some(parts[part as usize].object) != skip;
        for candidate in self.wedge.candidates(bvh, admits) {
            let part = &parts[candidate.part as usize];
            let from = part.local(&self.wedge.origin, dt_s);
            for packet in &mut self.packets {
                if packet.may_meet(&candidate) {
                    packet.meet(candidate.part, part, faces, &from);
                }
            }
        }
    }

    /// The part that a ray met first, and where.
    pub(crate) fn met(&self, ray: usize) -> Option<(u32, Entry)> {
        self.packets[ray / LANES].met(ray % LANES)
    }
}

impl Wedge {
    /// Widens to hold the rays of a packet; `None` where one does not go ahead.
    fn take_in(&mut self, packet: &mut Packet) -> Option<()> {
        let ahead = packet.along(&self.ahead);
        let is_narrow = bounds(&ahead)[0] > NARROWEST;
        let slope = |way| {
            let mut slope = packet.along(way);
            for lane in 0..LANES {
                slope[lane] /= ahead[lane];
            }
            bounds(&slope)
        };
        let ([right, left], slopes) = (slope(&self.aside), slope(&self.across));
        packet.slopes = slopes;
        self.spread = self.spread.max(left + ROUNDING).max(ROUNDING - right);
        self.slopes = [self.slopes[0].min(slopes[0]), self.slopes[1].max(slopes[1])];
        self.reach_m = self.reach_m.max(packet.farthest_m);
        is_narrow.then_some(())
    }

    /// The parts in the wedge, from near to far.
    fn candidates(&self, bvh: &Bvh, admits: impl Fn(u32) -> bool) -> Vec<Candidate> {
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
    /// Up to eight rays.
    fn new(rays: &[(Vector3<f32>, f32)]) -> Self {
        let mut packet = Self {
            directions: [[0.0; LANES]; 3],
            reach_m: [0.0; LANES],
            faces: [NO_FACE; LANES],
            parts: [0; LANES],
            slopes: [0.0; 2],
            farthest_m: 0.0,
        };
        for lane in 0..LANES {
            // Lanes without a ray of their own go with the last one and reach nothing.
            let (direction, reach_m) = rays[lane.min(rays.len() - 1)];
            for axis in 0..3 {
                packet.directions[axis][lane] = direction[axis];
            }
            packet.reach_m[lane] = if lane < rays.len() { reach_m } else { -1.0 };
        }
        packet.see_how_far();
        packet
    }

    fn along(&self, way: &Vector3<f32>) -> [f32; LANES] {
        let [x, y, z] = &self.directions;
        std::array::from_fn(|lane| way.x * x[lane] + way.y * y[lane] + way.z * z[lane])
    }

    /// Whether a ray of the packet may meet the part before what it has met.
    fn may_meet(&self, candidate: &Candidate) -> bool {
        candidate.near_m <= self.farthest_m && overlap(&candidate.slopes, &self.slopes)
    }

    /// Meets a part; the origin is `from` in its frame. As [`Part::entry`], ray by ray.
    fn meet(&mut self, index: u32, part: &Part, faces: &[Face], from: &Vector3<f32>) {
        let (mut enter_m, mut exit_m) = ([0.0; LANES], [f32::INFINITY; LANES]);
        // The number of a face within its part, a float for the vector units; -1 is none.
        let mut through = [-1.0_f32; LANES];
        let [ways_x, ways_y, ways_z] = &self.directions;
        for face in part.first_face..part.end_face {
            let [x, y, z, offset_m] = faces[face as usize];
            let number = (face - part.first_face) as f32;
            let gap_m = offset_m - (x * from.x + y * from.y + z * from.z);
            for lane in 0..LANES {
                let slope = x * ways_x[lane] + y * ways_y[lane] + z * ways_z[lane] + 0.0;
                let crossing_m = gap_m / slope;
                let entry_m = if slope < 0.0 { crossing_m } else { 0.0 };
                let leave_m = if slope < 0.0 {
                    f32::INFINITY
                } else {
                    crossing_m
                };
                through[lane] = if entry_m > enter_m[lane] {
                    number
                } else {
                    through[lane]
                };
                enter_m[lane] = if entry_m > enter_m[lane] {
                    entry_m
                } else {
                    enter_m[lane]
                };
                exit_m[lane] = if leave_m < exit_m[lane] {
                    leave_m
                } else {
                    exit_m[lane]
                };
            }
        }
        let mut any = false;
        for lane in 0..LANES {
            any |= (enter_m[lane] < exit_m[lane]) & (enter_m[lane] <= self.reach_m[lane]);
        }
        if any {
            let faces = through.map(|number| {
                if number < 0.0 {
                    NO_FACE
                } else {
                    part.first_face + number as u32
                }
            });
            self.take(index, &enter_m, &exit_m, &faces);
        }
    }

    /// Takes over what comes before the known.
    fn take(
        &mut self,
        part: u32,
        enter_m: &[f32; LANES],
        exit_m: &[f32; LANES],
        through: &[u32; LANES],
    ) {
        for lane in 0..LANES {
            let entry = Entry {
                distance_m: enter_m[lane],
                face: through[lane],
            };
            let known = Entry {
                distance_m: self.reach_m[lane],
                face: self.faces[lane],
            };
            let enters = entry.face != NO_FACE && entry.distance_m < exit_m[lane];
            if enters && entry.is_before(&known) {
                self.reach_m[lane] = entry.distance_m;
                self.faces[lane] = entry.face;
                self.parts[lane] = part;
            }
        }
        self.see_how_far();
    }

    fn see_how_far(&mut self) {
        self.farthest_m = self
            .reach_m
            .iter()
            .fold(0.0, |far, &m| if m > far { m } else { far });
    }

    /// The part that the ray in `lane` met first, and where.
    fn met(&self, lane: usize) -> Option<(u32, Entry)> {
        let entry = Entry {
            distance_m: self.reach_m[lane],
            face: self.faces[lane],
        };
        (entry.face != NO_FACE).then_some((self.parts[lane], entry))
    }
}
