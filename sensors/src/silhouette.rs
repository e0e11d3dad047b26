use covista_world::CameraIntrinsics;
use nalgebra::{Point3, Vector2};

const NEAR_M: f64 = 0.3;

/// The image of a convex solid or of a convex patch of the ground: its span in every row.
pub(crate) struct Silhouette {
    corners: Vec<Vector2<f64>>,
    top: f64,
    bottom: f64,
    /// From the nearest to the farthest corner along the optical axis.
    pub(crate) depths_m: [f64; 2],
}

impl Silhouette {
    /// The hull of vertices in the camera frame, clipped at the near plane.
    ///
    /// `None` where it lies behind the camera or beside the image.
    pub(crate) fn new(intrinsics: &CameraIntrinsics, vertices: &[Point3<f64>]) -> Option<Self> {
        let (front, behind): (Vec<_>, Vec<_>) =
            vertices.iter().copied().partition(|p| p.z >= NEAR_M);
        let crossings = front.iter().flat_map(|a| {
            behind
                .iter()
                .map(move |b| a + (b - a) * ((a.z - NEAR_M) / (a.z - b.z)))
        });
        let points: Vec<_> = front
            .iter()
            .copied()
            .chain(crossings)
            .filter_map(|p| intrinsics.project(&p))
            .map(Vector2::from)
            .filter(|p| p.x.is_finite() && p.y.is_finite())
            .collect();
        let bound = |of: fn(&Vector2<f64>) -> f64| {
            points
                .iter()
                .map(of)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                    (low.min(x), high.max(x))
                })
        };
        let (left, right) = bound(|p| p.x);
        let (top, bottom) = bound(|p| p.y);
        let seen = right > -1.0
            && left < f64::from(intrinsics.width_px)
            && bottom > -1.0
            && top < f64::from(intrinsics.height_px);
        let nearest_m = front.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let farthest_m = front.iter().map(|p| p.z).fold(0.0, f64::max);
        seen.then(|| Self {
            corners: convex_hull(points),
            top,
            bottom,
            depths_m: [if behind.is_empty() { nearest_m } else { 0.0 }, farthest_m],
        })
    }

    /// Whether any row from `top` to `bottom` may lie inside.
    pub(crate) fn reaches(&self, top: f64, bottom: f64) -> bool {
        self.top <= bottom && self.bottom >= top
    }

    /// Where the row at `v` lies inside: (from, to) in u.
    pub(crate) fn span(&self, v: f64) -> Option<(f64, f64)> {
        if v < self.top || v > self.bottom {
            return None;
        }
        let mut span: Option<(f64, f64)> = None;
        for (i, a) in self.corners.iter().enumerate() {
            let b = self.corners[(i + 1) % self.corners.len()];
            if (a.y - v) * (b.y - v) <= 0.0 {
                let rise = b.y - a.y;
                let share = if rise.abs() > 0.0 {
                    (v - a.y) / rise
                } else {
                    0.0
                };
                let u = a.x + share * (b.x - a.x);
                let (from, to) = span.unwrap_or((u, u));
                span = Some((from.min(u), to.max(u)));
            }
        }
        span
    }

    /// The span over all rows from `v - margin` to `v + margin`, widened by `margin`.
    pub(crate) fn span_within(&self, v: f64, margin: f64) -> Option<(f64, f64)> {
        let mut bounds: Option<(f64, f64)> = None;
        let inner = self
            .corners
            .iter()
            .filter(|p| (p.y - v).abs() <= margin)
            .map(|p| (p.x, p.x));
        let rows = [v - margin, v, v + margin];
        for (from, to) in rows.iter().filter_map(|&row| self.span(row)).chain(inner) {
            let (low, high) = bounds.unwrap_or((from, to));
            bounds = Some((low.min(from), high.max(to)));
        }
        bounds.map(|(from, to)| (from - margin, to + margin))
    }
}

/// Andrew's monotone chain.
fn convex_hull(mut points: Vec<Vector2<f64>>) -> Vec<Vector2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let mut hull: Vec<Vector2<f64>> = Vec::with_capacity(points.len() + 1);
    for pass in 0..2 {
        let start = hull.len();
        for &point in &points {
            while hull.len() >= start + 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (b - a).perp(&(point - a)) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    if hull.is_empty() { points } else { hull }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_ahead_spans_its_closed_form_width() {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| Point3::new(x, y, 10.0));
        let camera = CameraIntrinsics::KITTI;
        let hull = Silhouette::new(&camera, &corners).unwrap();
        let (from, to) = hull.span(camera.cy_px).unwrap();
        assert!((from - (camera.cx_px - camera.fx_px / 10.0)).abs() < 1e-9);
        assert!((to - (camera.cx_px + camera.fx_px / 10.0)).abs() < 1e-9);
        assert!(hull.span(camera.cy_px + 80.0).is_none());
    }

    #[test]
    fn a_wall_beside_the_camera_is_clipped_and_kept() {
        let camera = CameraIntrinsics::KITTI;
        let wall: Vec<_> = [-20.0, 50.0]
            .iter()
            .flat_map(|&z| [-1.0, 1.6].map(|y| Point3::new(-3.0, y, z)))
            .collect();
        let (from, to) = Silhouette::new(&camera, &wall)
            .unwrap()
            .span(200.0)
            .unwrap();
        assert!(from < 0.0 && to > 400.0 && to < camera.cx_px);
        let behind: Vec<_> = wall
            .iter()
            .map(|p| Point3::new(p.x, p.y, -p.z.abs()))
            .collect();
        assert!(Silhouette::new(&camera, &behind).is_none());
    }
}
