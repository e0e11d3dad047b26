use nalgebra::Vector2;

use crate::{Body, ConvexPart};

/// Scenery hides from a driver what lies behind it from this height on.
const EYE_HEIGHT_M: f64 = 1.3;

/// The scenery a human driver cannot look across, as outlines in the plane.
#[derive(Debug, Clone)]
pub(crate) struct Occluders {
    outlines: Vec<Vec<Vector2<f64>>>,
}

impl Occluders {
    pub fn new(scenery: &[Body]) -> Self {
        let tall = |part: &&ConvexPart| part.vertices.iter().any(|v| v.z > EYE_HEIGHT_M);
        let outlines = scenery
            .iter()
            .flat_map(|body| &body.parts)
            .filter(tall)
            .map(|part| part.vertices.iter().map(|v| v.xy().coords).collect())
            .collect();
        Self { outlines }
    }

    /// Whether nothing crosses the line between two points.
    pub fn clear(&self, from: Vector2<f64>, to: Vector2<f64>) -> bool {
        !self
            .outlines
            .iter()
            .any(|outline| crosses(outline, from, to))
    }
}

/// Whether a convex outline crosses a line of sight: it has corners on both sides of the line, and
/// its middle lies between the ends.
fn crosses(outline: &[Vector2<f64>], from: Vector2<f64>, to: Vector2<f64>) -> bool {
    let along = to - from;
    let middle = outline.iter().sum::<Vector2<f64>>() / outline.len() as f64;
    let share = (middle - from).dot(&along) / along.norm_squared();
    let left = |corner: &Vector2<f64>| along.perp(&(corner - from)) > 0.0;
    (0.0..1.0).contains(&share) && outline.iter().any(left) && !outline.iter().all(left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_hides_what_is_behind_it_only() {
        let wall = vec![
            Vector2::new(4.9, -1.0),
            Vector2::new(5.1, -1.0),
            Vector2::new(5.1, 1.0),
            Vector2::new(4.9, 1.0),
        ];
        let occluders = Occluders {
            outlines: vec![wall],
        };
        let clear = |x, y| occluders.clear(Vector2::zeros(), Vector2::new(x, y));
        assert!(!clear(10.0, 0.0));
        assert!(clear(4.0, 0.0));
        assert!(clear(-10.0, 0.0));
        assert!(clear(10.0, 2.1));
        assert!(!clear(10.0, 1.9));
    }
}
