use nalgebra::{Point3, Unit, Vector3};

/// A flat face of a convex hull.
pub struct Face {
    /// Outward unit normal.
    pub normal: Unit<Vector3<f64>>,
    /// Corners, counter-clockwise seen from outside.
    pub corners: Vec<Point3<f64>>,
}

/// The faces of the convex hull of `points`, by trying every triple of them.
///
/// Meant for the few corners of a wall or a house. Points in one plane have no face.
pub fn convex_hull_faces(points: &[Point3<f64>]) -> Vec<Face> {
    let size = points
        .iter()
        .map(|point| (point - points[0]).norm())
        .fold(0.0, f64::max);
    let tolerance = 1e-6 * size;
    let mut faces: Vec<Face> = Vec::new();
    for (i, a) in points.iter().enumerate() {
        for (j, b) in points.iter().enumerate().skip(i + 1) {
            for c in &points[j + 1..] {
                let Some(normal) = Unit::try_new(
                    (b - a).cross(&(c - a)),
                    tolerance * size + f64::MIN_POSITIVE,
                ) else {
                    continue;
                };
                let heights = points.iter().map(|point| normal.dot(&(point - a)));
                let (low, high) = heights.fold((0.0_f64, 0.0_f64), |(low, high), height| {
                    (low.min(height), high.max(height))
                });
                let outward = match (low < -tolerance, high > tolerance) {
                    (true, false) => normal,
                    (false, true) => -normal,
                    _ => continue,
                };
                let known = faces.iter().any(|face| {
                    face.normal.dot(&outward) > 1.0 - 1e-9
                        && face.normal.dot(&(a - face.corners[0])).abs() <= tolerance
                });
                if !known {
                    faces.push(face_of(points, *a, outward, tolerance));
                }
            }
        }
    }
    faces
}

fn face_of(
    points: &[Point3<f64>],
    on_plane: Point3<f64>,
    normal: Unit<Vector3<f64>>,
    tolerance: f64,
) -> Face {
    let mut corners: Vec<_> = points
        .iter()
        .copied()
        .filter(|point| normal.dot(&(point - on_plane)).abs() <= tolerance)
        .collect();
    let middle = corners
        .iter()
        .fold(Vector3::zeros(), |sum, corner| sum + corner.coords)
        / corners.len() as f64;
    let x = corners
        .iter()
        .map(|corner| corner.coords - middle)
        .max_by(|a, b| a.norm().total_cmp(&b.norm()))
        .map_or(normal.into_inner(), |arm| arm.normalize());
    let y = normal.cross(&x);
    let angle = |corner: &Point3<f64>| {
        let arm = corner.coords - middle;
        arm.dot(&y).atan2(arm.dot(&x))
    };
    corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    Face { normal, corners }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cuboid_has_six_faces_that_look_outward() {
        let corners: Vec<_> = (0..8)
            .map(|i| {
                Point3::new(
                    f64::from(i & 1) * 30.0,
                    f64::from(i >> 1 & 1) * 0.2,
                    f64::from(i >> 2) * 2.5,
                )
            })
            .collect();
        let faces = convex_hull_faces(&corners);
        assert_eq!(faces.len(), 6);
        let center = Point3::new(15.0, 0.1, 1.25);
        let mut area = 0.0;
        for face in &faces {
            assert_eq!(face.corners.len(), 4);
            assert!(face.normal.dot(&(face.corners[0] - center)) > 0.0);
            let (u, v) = (
                face.corners[1] - face.corners[0],
                face.corners[2] - face.corners[1],
            );
            assert!(u.cross(&v).dot(&face.normal) > 0.0, "counter-clockwise");
            area += u.norm() * v.norm();
        }
        assert!((area - 2.0 * (30.0 * 0.2 + 30.0 * 2.5 + 0.2 * 2.5)).abs() < 1e-9);
    }

    #[test]
    fn a_flat_or_empty_set_has_no_face() {
        assert!(convex_hull_faces(&[]).is_empty());
        let flat =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
        assert!(convex_hull_faces(&flat).is_empty());
    }
}
