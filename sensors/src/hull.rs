use covista_traffic::{ConvexPart, Material};
use nalgebra::{Isometry3, Point3, Unit, Vector3};

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
    fn is_same(&self, other: &Self) -> bool {
        (self.normal - other.normal).norm_squared() < 1e-8
    }

    /// Normal and offset about `anchor` in single precision.
    pub(crate) fn about(&self, anchor: &Point3<f64>) -> [f32; 4] {
        let n = self.normal;
        [n.x, n.y, n.z, self.offset_m - n.dot(&anchor.coords)].map(|value| value as f32)
    }
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
    // Three points close to one line define no plane.
    if cross.norm() < 1e-4 * ab.norm() * ac.norm() || cross.norm() < 1e-8 {
        return None;
    }
    let normal = Unit::new_normalize(cross).into_inner();
    let offset_m = normal.dot(&a.coords);
    let distance = |point: &Point3<f64>| normal.dot(&point.coords) - offset_m;
    if points.iter().all(|point| distance(point) <= TOLERANCE_M) {
        Some(HalfSpace { normal, offset_m })
    } else if points.iter().all(|point| distance(point) >= -TOLERANCE_M) {
        Some(HalfSpace {
            normal: -normal,
            offset_m: -offset_m,
        })
    } else {
        None
    }
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

    #[test]
    fn a_flat_part_has_no_hull() {
        let square = (0..4).map(|i| Point3::new(f64::from(i & 1), f64::from(i >> 1), 0.0));
        assert!(Hull::new(&part(square.collect())).is_none());
    }
}
