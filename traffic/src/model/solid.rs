use nalgebra::{Point3, Vector3};

use crate::{ConvexPart, Material};

/// A plane that goes through a corner misses it by less than this.
const TOLERANCE_M: f64 = 1e-9;
/// Corners nearer to each other than this are one.
const SAME_CORNER_M: f64 = 1e-7;

/// The half-space `normal . p <= offset_m`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    normal: Vector3<f64>,
    offset_m: f64,
}

impl Plane {
    fn new(normal: Vector3<f64>, through: Vector3<f64>) -> Self {
        let normal = normal.normalize();
        Self {
            normal,
            offset_m: normal.dot(&through),
        }
    }

    /// The half-space right of the line from `a` to `b`, both (x, z), as seen from the right of
    /// the vehicle.
    pub(super) fn side([a, b]: [[f64; 2]; 2]) -> Self {
        Self::new(
            Vector3::new(a[1] - b[1], 0.0, b[0] - a[0]),
            Vector3::new(a[0], 0.0, a[1]),
        )
    }

    fn plan([a, b]: [[f64; 2]; 2]) -> Self {
        Self::new(
            Vector3::new(a[1] - b[1], b[0] - a[0], 0.0),
            Vector3::new(a[0], a[1], 0.0),
        )
    }

    /// The half-space towards the middle of the line from `a` down to `b`, both (y, z).
    pub(super) fn section([a, b]: [[f64; 2]; 2]) -> Self {
        Self::new(
            Vector3::new(0.0, a[1] - b[1], b[0] - a[0]),
            Vector3::new(0.0, a[0], a[1]),
        )
    }

    /// The same on the other side of the vehicle.
    pub(super) fn mirrored(self) -> Self {
        let normal = self.normal.component_mul(&Vector3::new(1.0, -1.0, 1.0));
        Self { normal, ..self }
    }

    fn distance_m(&self, point: &Vector3<f64>) -> f64 {
        self.normal.dot(point) - self.offset_m
    }
}

/// A convex solid: what its half-spaces, often those of a three-view drawing, have in common.
#[derive(Debug, Clone, Default)]
pub(super) struct Solid {
    planes: Vec<Plane>,
}

impl Solid {
    /// Cut along a line of (x, z) from the tail over the top to the nose.
    pub(super) fn side_view(self, outline: &[[f64; 2]]) -> Self {
        self.cut(outline.array_windows().map(|&edge| Plane::side(edge)))
    }

    /// Cut along a line of (x, y) on the left from tail to nose, and along its mirror image.
    pub(super) fn plan_view(self, outline: &[[f64; 2]]) -> Self {
        let planes = outline.array_windows().map(|&edge| Plane::plan(edge));
        self.cut(planes.flat_map(|plane| [plane, plane.mirrored()]))
    }

    /// Cut along a line of (y, z) on the left from the top down, and along its mirror image.
    pub(super) fn section_view(self, outline: &[[f64; 2]]) -> Self {
        let planes = outline.array_windows().map(|&edge| Plane::section(edge));
        self.cut(planes.flat_map(|plane| [plane, plane.mirrored()]))
    }

    pub(super) fn cut(mut self, planes: impl IntoIterator<Item = Plane>) -> Self {
        self.planes.extend(planes);
        self
    }

    pub(super) fn between(self, axis: Vector3<f64>, [low, high]: [f64; 2]) -> Self {
        self.cut([Plane::new(-axis, axis * low), Plane::new(axis, axis * high)])
    }

    pub(super) fn x(self, range: [f64; 2]) -> Self {
        self.between(Vector3::x(), range)
    }

    pub(super) fn y(self, range: [f64; 2]) -> Self {
        self.between(Vector3::y(), range)
    }

    pub(super) fn z(self, range: [f64; 2]) -> Self {
        self.between(Vector3::z(), range)
    }

    /// Only the shell under `plane`.
    pub(super) fn within(self, depth_m: f64, plane: Plane) -> Self {
        self.cut([Plane {
            normal: -plane.normal,
            offset_m: depth_m - plane.offset_m,
        }])
    }

    /// Every surface moved inwards.
    pub(super) fn inset(&self, depth_m: f64) -> Self {
        let planes = self.planes.iter().map(|plane| Plane {
            offset_m: plane.offset_m - depth_m,
            ..*plane
        });
        Self {
            planes: planes.collect(),
        }
    }

    /// The corners: where three planes meet inside all others.
    pub(super) fn part(&self, material: Material) -> ConvexPart {
        let mut corners: Vec<Vector3<f64>> = Vec::new();
        for (i, a) in self.planes.iter().enumerate() {
            for (j, b) in self.planes.iter().enumerate().skip(i + 1) {
                for c in &self.planes[j + 1..] {
                    let Some(corner) = meeting_point(a, b, c) else {
                        continue;
                    };
                    let is_outside = |plane: &Plane| plane.distance_m(&corner) > TOLERANCE_M;
                    let is_known = |known: &Vector3<f64>| (known - corner).norm() < SAME_CORNER_M;
                    if !self.planes.iter().any(is_outside) && !corners.iter().any(is_known) {
                        corners.push(corner);
                    }
                }
            }
        }
        ConvexPart {
            vertices: corners.into_iter().map(Point3::from).collect(),
            material,
        }
    }
}

fn meeting_point(a: &Plane, b: &Plane, c: &Plane) -> Option<Vector3<f64>> {
    let across = b.normal.cross(&c.normal);
    let volume = a.normal.dot(&across);
    let sum = across * a.offset_m
        + c.normal.cross(&a.normal) * b.offset_m
        + a.normal.cross(&b.normal) * c.offset_m;
    (volume.abs() > 1e-6).then(|| sum / volume)
}
