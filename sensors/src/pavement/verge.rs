use nalgebra::Vector3;

use super::GroundPatch;
use crate::appearance::Rgb;
use crate::noise::uniform;
use crate::tile::Tile;

/// The ground beside the road: gravel next to it, then grass and soil.
pub(super) struct Verge {
    gravel: Rgb,
    fresh: Rgb,
    dry: Rgb,
    soil: Rgb,
    /// How much of the grass is dry, of the ground bare; both in about [-1.5, 1.5].
    dryness: f32,
    bareness: f32,
    seed: u32,
}

impl Verge {
    pub(super) fn new(seed: u32) -> Self {
        let draw = |index: i32| uniform(seed ^ 0xBEEF, index, 5);
        let between =
            |a: [f32; 3], b: [f32; 3], index| Rgb::from(a).lerp(&Rgb::from(b), draw(index));
        Self {
            gravel: between([0.16, 0.15, 0.14], [0.36, 0.31, 0.24], 0),
            fresh: between([0.035, 0.075, 0.012], [0.12, 0.16, 0.035], 1),
            dry: between([0.27, 0.20, 0.085], [0.46, 0.36, 0.19], 2),
            soil: between([0.12, 0.075, 0.045], [0.30, 0.21, 0.13], 3),
            dryness: 3.0 * draw(4) - 1.3,
            bareness: 1.6 * draw(5) - 1.5,
            seed,
        }
    }

    pub(super) fn gravel(&self, patch: &GroundPatch, footprint_m: f32) -> Rgb {
        let [x, y] = patch.plane();
        let grain = Tile::shared().at(self.seed ^ 41, x, y, 0.02, footprint_m);
        self.gravel * (1.0 + 0.28 * grain).max(0.2)
    }

    pub(super) fn meadow(&self, patch: &GroundPatch, footprint_m: f32) -> Rgb {
        let (tile, [x, y]) = (Tile::shared(), patch.plane());
        let blades = tile.at(self.seed ^ 53, x, y, 0.025, footprint_m);
        let tufts = tile.at(self.seed ^ 59, x, y, 0.34, footprint_m);
        let spots = tile.at(self.seed ^ 67, x, y, 2.9, footprint_m);
        let dry = (0.5 + self.dryness + 0.35 * tufts + 0.45 * spots).clamp(0.0, 1.0);
        let bare = (self.bareness + 0.5 * tufts - 0.4 * spots).clamp(0.0, 1.0);
        let light = 1.0 + 0.30 * blades + 0.20 * tufts + 0.08 * spots;
        self.fresh.lerp(&self.dry, dry).lerp(&self.soil, bare) * light.max(0.15)
    }

    /// Leaves and dust that lie on the road near its edge: their colour and share.
    pub(super) fn litter(
        &self,
        patch: &GroundPatch,
        from_edge_m: f32,
        footprint_m: f32,
    ) -> (Rgb, f32) {
        let [x, y] = patch.plane();
        let spread = Tile::shared().at(self.seed ^ 71, x, y, 0.03, footprint_m);
        let share = (0.35 + 0.45 * spread - 0.9 * from_edge_m).clamp(0.0, 0.8);
        let leaves = Vector3::new(0.22, 0.14, 0.06);
        (self.gravel.lerp(&leaves, 0.5), share)
    }
}
