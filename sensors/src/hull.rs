use covista_traffic::{ConvexPart, Material};
use nalgebra::{Isometry3, Point3, Unit, Vector2, Vector3};

/// Points within this distance of a plane lie in it.
const TOLERANCE_M: f64 = 1e-6;

/// The half-space `normal . p <= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct HalfSpace {
    normal: Vector3<f64>,
    offset_m: f64,
}

/// A convex part as the intersection of half-spaces.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hull {
    pub(crate) faces: Vec<HalfSpace>,
    pub(crate) vertices: Vec<Point3<f64>>,
    pub(crate) material: Material,
}

impl Hull {
    /// The hull of `part`, or `None` where its vertices enclose no volume.
    pub(crate) fn new(part: &ConvexPart) -> Option<Self> {
        let vertices = &part.vertices;
        let mut faces: Vec<HalfSpace> = Vec::new();
        // The first faces that each vertex lies in, a bit for each.
        let mut faces_at = vec![0_u64; vertices.len()];
        for (i, a) in vertices.iter().enumerate() {
            for (j, b) in vertices.iter().enumerate().skip(i + 1) {
                let shared = faces_at[i] & faces_at[j];
                if shared.count_ones() == 2 {
                    continue;
                }
                for k in wings(i, j, vertices).into_iter().flatten() {
                    if faces_at[i] & faces_at[j] & faces_at[k] == 0
                        && let Some(face) = supporting_plane(a, b, &vertices[k], vertices)
                        && !faces.iter().any(|known| known.is_same(&face))
                    {
                        let bit = 1_u64.checked_shl(faces.len() as u32).unwrap_or(0);
                        for (vertex, at) in vertices.iter().zip(&mut faces_at) {
                            *at |= if face.holds(vertex) { bit } else { 0 };
                        }
                        faces.push(face);
                    }
                }
            }
        }
        (faces.len() >= 4).then(|| Self {
            faces,
            vertices: vertices.clone(),
            material: part.material,
        })
    }

    /// The hull, stretched along the axes of its frame.
    pub(crate) fn scaled(&self, scale: &Vector3<f64>) -> Self {
        let faces = self.faces.iter().map(|face| {
            let stretched = face.normal.component_div(scale);
            let norm = stretched.norm();
            HalfSpace {
                normal: stretched / norm,
                offset_m: face.offset_m / norm,
            }
        });
        let vertices = self.vertices.iter();
        Self {
            faces: faces.collect(),
            vertices: vertices
                .map(|vertex| Point3::from(vertex.coords.component_mul(scale)))
                .collect(),
            material: self.material,
        }
    }

    /// The hull in the frame that `pose` leads to.
    pub(crate) fn transformed(&self, pose: &Isometry3<f64>) -> Self {
        let faces = self.faces.iter().map(|face| {
            let normal = pose * face.normal;
            HalfSpace {
                normal,
                offset_m: face.offset_m + normal.dot(&pose.translation.vector),
            }
        });
        Self {
            faces: faces.collect(),
            vertices: self.vertices.iter().map(|vertex| pose * vertex).collect(),
            material: self.material,
        }
    }
}

impl HalfSpace {
    /// Whether the point lies in the plane.
    fn holds(&self, point: &Point3<f64>) -> bool {
        (self.normal.dot(&point.coords) - self.offset_m).abs() <= TOLERANCE_M
    }

    fn is_same(&self, other: &Self) -> bool {
        (self.normal - other.normal).norm_squared() < 1e-8
    }

    /// Normal and offset about `anchor` in single precision.
    pub(crate) fn about(&self, anchor: &Point3<f64>) -> [f32; 4] {
        let n = self.normal;
        [n.x, n.y, n.z, self.offset_m - n.dot(&anchor.coords)].map(|value| value as f32)
    }
}

/// The outermost of `points` to either side, seen along the line from the first to the second:
/// with it they span the faces that meet there. `None` where points lie all round the line.
fn wings(first: usize, second: usize, points: &[Point3<f64>]) -> Option<[usize; 2]> {
    let (a, b) = (&points[first], &points[second]);
    let line = b - a;
    let right = line.cross(&Vector3::ith(line.iamin(), 1.0));
    let up = line.cross(&right);
    // Now as long as the other.
    let right = right * line.norm();
    let on_line = 1e-16 * up.norm_squared();
    let mut wings: Option<[(Vector2<f64>, usize); 2]> = None;
    for (index, point) in points.iter().enumerate() {
        let arm = point - a;
        let seen = Vector2::new(right.dot(&arm), up.dot(&arm));
        if seen.norm_squared() <= on_line {
            continue;
        }
        let [leftmost, rightmost] = wings.get_or_insert([(seen, index); 2]);
        match (leftmost.0.perp(&seen) > 0.0, rightmost.0.perp(&seen) < 0.0) {
            (true, true) => return None,
            (true, false) => *leftmost = (seen, index),
            (false, true) => *rightmost = (seen, index),
            (false, false) => {}
        }
    }
    wings.map(|[left, right]| [left.1, right.1])
}

/// The plane through three points when all `points` lie on one side of it.
fn supporting_plane(
    a: &Point3<f64>,
    b: &Point3<f64>,
    c: &Point3<f64>,
    points: &[Point3<f64>],
) -> Option<HalfSpace> {
    let (ab, ac) = (b - a, c - a);
    let cross = ab.cross(&ac);
    let squared = cross.norm_squared();
    // Three points close to one line define no plane.
    if squared < 1e-8 * ab.norm_squared() * ac.norm_squared() || squared < 1e-16 {
        return None;
    }
    let tolerance = squared * TOLERANCE_M * TOLERANCE_M;
    let (mut above, mut below) = (false, false);
    for point in points {
        let height = cross.dot(&(point - a));
        if height * height > tolerance {
            above |= height > 0.0;
            below |= height < 0.0;
            if above && below {
                return None;
            }
        }
    }
    let outwards = if above { -cross } else { cross };
    let normal = Unit::new_normalize(outwards).into_inner();
    Some(HalfSpace {
        normal,
        offset_m: normal.dot(&a.coords),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(vertices: Vec<Point3<f64>>) -> ConvexPart {
        ConvexPart {
            vertices,
            material: Material::Concrete,
        }
    }

    #[test]
    fn a_box_has_six_faces_and_a_prism_as_many_as_its_corners_plus_two() {
        let corners = (0..8).map(|i| {
            Point3::new(
                f64::from(i & 1) * 4.0,
                f64::from(i >> 1 & 1),
                f64::from(i >> 2) * 2.5,
            )
        });
        let block = Hull::new(&part(corners.collect())).expect("a hull");
        assert_eq!(block.faces.len(), 6);
        let prism = (0..24).map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i / 2) / 12.0;
            Point3::new(angle.cos(), angle.sin(), f64::from(i % 2))
        });
        let prism = Hull::new(&part(prism.collect())).expect("a hull");
        assert_eq!(prism.faces.len(), 14);
    }

    /// Every plane through three vertices with all others on one side.
    fn all_supporting_planes(vertices: &[Point3<f64>]) -> Vec<HalfSpace> {
        let mut faces: Vec<HalfSpace> = Vec::new();
        for (i, a) in vertices.iter().enumerate() {
            for (j, b) in vertices.iter().enumerate().skip(i + 1) {
                for c in &vertices[j + 1..] {
                    if let Some(face) = supporting_plane(a, b, c, vertices)
                        && !faces.iter().any(|known| known.is_same(&face))
                    {
                        faces.push(face);
                    }
                }
            }
        }
        faces
    }

    #[test]
    fn no_face_is_missing_from_any_body() {
        let scenes = (0..6).map(|index| covista_traffic::sample_scene(4, index).scene);
        let scenery: Vec<_> = scenes.map(|scene| scene.scenery).collect();
        let models = covista_traffic::VehicleModel::ALL.map(|model| model.body().clone());
        let bodies = scenery.iter().flat_map(|bodies| bodies.iter());
        let mut parts = 0;
        for part in bodies.chain(&models).flat_map(|body| &body.parts) {
            let expected = all_supporting_planes(&part.vertices);
            let hull = Hull::new(part).expect("a hull");
            assert_eq!(hull.faces.len(), expected.len());
            for face in &expected {
                assert!(hull.faces.iter().any(|known| known.is_same(face)));
            }
            parts += 1;
        }
        assert!(parts > 500, "{parts}");
    }

    #[test]
    fn a_flat_part_has_no_hull() {
        let square = (0..4).map(|i| Point3::new(f64::from(i & 1), f64::from(i >> 1), 0.0));
        assert!(Hull::new(&part(square.collect())).is_none());
    }
}
