use covista_traffic::Material;
use nalgebra::{Point3, Vector3};

use crate::caster::ObjectRef;

/// A half-space n . p <= offset about the anchor of its part: n and the offset.
pub(crate) type Face = [f32; 4];

/// A convex part in the world frame: a run of the scene's half-spaces.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    /// Where the frame of its half-spaces lies; near the part, so that single precision does.
    pub(crate) anchor: Point3<f32>,
    pub(crate) velocity_mps: Vector3<f32>,
    pub(crate) first_face: u32,
    pub(crate) end_face: u32,
    pub(crate) material: Material,
    pub(crate) object: ObjectRef,
}

/// Where a ray enters a part: how far along it, and through which face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Entry {
    pub(crate) distance_m: f32,
    pub(crate) face: u32,
}

impl Entry {
    /// Whether this comes before the other, with a rule for two at the same distance.
    pub(crate) fn is_before(&self, other: &Self) -> bool {
        self.distance_m < other.distance_m
            || self.distance_m <= other.distance_m && self.face < other.face
    }
}

impl Part {
    /// A point of the world in the frame of the part's half-spaces, `dt_s` after the scene's time.
    pub(crate) fn local(&self, point: &Point3<f32>, dt_s: f32) -> Vector3<f32> {
        point - (self.anchor + self.velocity_mps * dt_s)
    }

    /// Where the ray from `from`, outside and in the part's frame, enters before `reach_m`.
    ///
    /// The ray is clipped by one half-space after the other.
    pub(crate) fn entry(
        &self,
        faces: &[Face],
        from: &Vector3<f32>,
        direction: &Vector3<f32>,
        reach_m: f32,
    ) -> Option<Entry> {
        let (mut enter_m, mut exit_m) = (0.0, f32::INFINITY);
        let mut through = None;
        for face in self.first_face..self.end_face {
            let [x, y, z, offset_m] = faces[face as usize];
            let gap_m = offset_m - (x * from.x + y * from.y + z * from.z);
            // The sum is never -0, so that a ray along a face is kept or lost by the gap's sign.
            let slope = x * direction.x + y * direction.y + z * direction.z + 0.0;
            let crossing_m = gap_m / slope;
            if slope < 0.0 {
                if crossing_m > enter_m {
                    enter_m = crossing_m;
                    through = Some(face);
                }
            } else if crossing_m < exit_m {
                exit_m = crossing_m;
            }
            if enter_m >= exit_m || enter_m > reach_m {
                return None;
            }
        }
        through.map(|face| Entry {
            distance_m: enter_m,
            face,
        })
    }
}
