use nalgebra::Vector2;

use super::GroundPatch;
use crate::appearance::Light;
use crate::noise::uniform;
use crate::tile::Tile;

/// Share of the scenes in which trees outside of the picture shade the road.
const SHADED_SCENES: f32 = 0.22;

/// The shade of trees that the picture need not show: blotches with flecks of sun in them.
pub(super) struct Canopy {
    density: f32,
    seed: u32,
}

impl Canopy {
    pub(super) fn new(seed: u32) -> Option<Self> {
        let draw = |index: i32| uniform(seed ^ 0xCA40, index, 1);
        (draw(0) < SHADED_SCENES).then(|| Self {
            density: 1.6 * draw(1) - 0.9,
            seed,
        })
    }

    /// Share of the sunlight that comes through.
    pub(super) fn sunlit(&self, patch: &GroundPatch, light: &Light, footprint_m: f32) -> f32 {
        // Shadows are drawn out away from the sun.
        let sun = light.sun_direction;
        let away = Vector2::new(sun.x, sun.y).cap_magnitude(0.9);
        let [x, y] = patch.plane();
        let drawn_out = 0.75 * (away.x * x + away.y * y);
        let (x, y) = (x - away.x * drawn_out, y - away.y * drawn_out);
        let tile = Tile::shared();
        let crowns = tile.at(self.seed ^ 83, x, y, 0.6, footprint_m.max(0.9));
        let shade = (0.6 + 1.6 * (crowns + self.density)).clamp(0.0, 1.0);
        if shade <= 0.0 {
            return 1.0;
        }
        let leaves = tile.at(self.seed ^ 89, x, y, 0.05, footprint_m.max(0.15));
        let flecks = (1.5 * (leaves - 0.55)).clamp(0.0, 1.0);
        1.0 - shade * (1.0 - flecks)
    }
}
