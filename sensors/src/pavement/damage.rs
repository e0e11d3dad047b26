use super::{GroundPatch, stripe_share};
use crate::noise::{floor, uniform};
use crate::tile::Tile;

/// Features along the road are drawn one for each stretch of this length.
const PATCH_CELL_M: f64 = 17.0;
const SKID_CELL_M: f64 = 45.0;
const CUT_CELL_M: f64 = 31.0;
const SEAL_WIDTH_M: f32 = 0.035;

/// Patches, sealed cracks, saw cuts and skid marks of a road.
pub(super) struct Damage {
    amount: f32,
    seed: u32,
}

impl Damage {
    pub(super) fn new(amount: f32, seed: u32) -> Self {
        Self { amount, seed }
    }

    /// What the brightness of the surface is multiplied by.
    pub(super) fn tone(
        &self,
        patch: &GroundPatch,
        lane: i32,
        lane_width_m: f64,
        footprint_m: f32,
    ) -> f32 {
        let skids = self.skid_marks(patch, lane, lane_width_m);
        let cracks = self.cracks(patch, footprint_m);
        self.patches(patch, lane) * (1.0 - skids) * (1.0 - cracks) * (1.0 - self.cuts(patch))
    }

    /// Stretches of a lane that were paved anew.
    fn patches(&self, patch: &GroundPatch, lane: i32) -> f32 {
        let cell = floor(patch.s_m / PATCH_CELL_M);
        let draw = |index: i32| uniform(self.seed ^ 11, cell, lane * 8 + index);
        if draw(0) > 0.3 * self.amount {
            return 1.0;
        }
        let length_m = PATCH_CELL_M * f64::from(0.15 + 0.75 * draw(1));
        let from_middle_m = patch.s_m - (f64::from(cell) + 0.5) * PATCH_CELL_M;
        let share = stripe_share(from_middle_m, patch.spread_s_m, length_m) as f32;
        let tone = if draw(2) < 0.7 { -0.35 } else { 0.18 };
        1.0 + share * tone * (0.4 + 0.6 * draw(3))
    }

    /// Pairs of dark stripes that end somewhere in their cell.
    fn skid_marks(&self, patch: &GroundPatch, lane: i32, lane_width_m: f64) -> f32 {
        let cell = floor(patch.s_m / SKID_CELL_M);
        let draw = |index: i32| uniform(self.seed ^ 37, cell, lane * 8 + index);
        if draw(0) > 0.06 + 0.16 * self.amount {
            return 0.0;
        }
        let along_m = patch.s_m - f64::from(cell) * SKID_CELL_M;
        let share = |from: f64| ((along_m / SKID_CELL_M - from) * 6.0).clamp(0.0, 1.0);
        let fade = share(0.5 * f64::from(draw(1))) * (1.0 - share(0.75));
        let drift = f64::from(draw(2) - 0.5) * 0.03 * along_m;
        let in_lane_m = patch.d_m - (patch.d_m / lane_width_m).round() * lane_width_m - drift;
        let off_m = in_lane_m.abs() - 0.78;
        (0.45 * fade * stripe_share(off_m, patch.spread_d_m, 0.19)) as f32
    }

    /// Straight lines across the road: saw cuts, ends of a day's paving, sealed joints.
    fn cuts(&self, patch: &GroundPatch) -> f32 {
        let cell = floor(patch.s_m / CUT_CELL_M);
        let draw = |index: i32| uniform(self.seed ^ 43, cell, index);
        if draw(0) > 0.15 + 0.5 * self.amount {
            return 0.0;
        }
        let at_m = CUT_CELL_M * (f64::from(cell) + 0.1 + 0.8 * f64::from(draw(1)));
        let skew = 0.05 * f64::from(draw(2) - 0.5);
        let width_m = f64::from(0.015 + 0.06 * draw(3));
        let share = stripe_share(
            patch.s_m - at_m - skew * patch.d_m,
            patch.spread_s_m,
            width_m,
        );
        let tone = if draw(4) < 0.6 { 0.5 } else { -0.4 };
        share as f32 * tone
    }

    /// Tar-sealed cracks: zero lines of a noise, only in places.
    fn cracks(&self, patch: &GroundPatch, footprint_m: f32) -> f32 {
        if footprint_m > 0.4 || self.amount <= 0.0 {
            return 0.0;
        }
        let (tile, [x, y]) = (Tile::shared(), patch.plane());
        let place = tile.at(self.seed ^ 17, x, y, 1.3, 1.3) - 1.6 + 1.9 * self.amount;
        if place <= 0.0 {
            return 0.0;
        }
        // Averaged over a metre so that only long lines are left.
        let from_line_m = 1.5 * tile.at(self.seed ^ 19, x, y, 0.13, 1.0).abs();
        let blur_m = SEAL_WIDTH_M + 0.5 * footprint_m;
        let share = (SEAL_WIDTH_M / blur_m) * (1.0 - from_line_m / blur_m).clamp(0.0, 1.0);
        0.6 * share * (4.0 * place).min(1.0)
    }
}
