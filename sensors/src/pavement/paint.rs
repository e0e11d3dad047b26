use covista_traffic::{MarkStyle, PaintColor, Scene};
use nalgebra::Vector3;

use super::{GroundPatch, stripe_share};
use crate::appearance::Rgb;
use crate::carriageway::Carriageway;
use crate::noise::uniform;
use crate::tile::Tile;

const MARKER_LENGTH_M: f64 = 0.14;
const MARKER_WIDTH_M: f64 = 0.11;

/// The paint of a carriageway.
pub(super) struct Paint {
    pub(super) road: Carriageway,
    /// Of each mark, from the left.
    colors: Vec<Rgb>,
    /// Raised markers in the gaps between dashes.
    raised_markers: bool,
    wear: f32,
    seed: u32,
}

impl Paint {
    pub(super) fn new(scene: &Scene, seed: u32) -> Self {
        let (road, markings) = (Carriageway::new(scene), &scene.markings);
        let wear = scene.look.paint_wear.clamp(0.0, 1.0) as f32;
        let draw = |index: i32| uniform(seed, index, 7919);
        let left = usize::from(markings.lanes_beyond[0]);
        let yellow_edge = draw(5) < 0.6;
        let color = |index: usize| {
            let own = index.checked_sub(left);
            let color = match own.and_then(|own| markings.colors.get(own)) {
                Some(color) => *color,
                None if index == 0 && yellow_edge => PaintColor::Yellow,
                None => PaintColor::White,
            };
            let fresh = match color {
                PaintColor::White => Vector3::new(0.88, 0.88, 0.86),
                PaintColor::Yellow => {
                    Vector3::new(0.86, 0.42, 0.02).lerp(&Vector3::new(0.80, 0.58, 0.12), draw(6))
                }
            };
            let dirt = 0.04 + 0.35 * wear;
            fresh.lerp(&Vector3::new(0.33, 0.31, 0.28), dirt)
        };
        Self {
            colors: (0..road.styles.len()).map(color).collect(),
            road,
            raised_markers: draw(7) < 0.35,
            wear,
            seed,
        }
    }

    /// The colour of the paint in the patch and its share of it.
    pub(super) fn cover(&self, patch: &GroundPatch, footprint_m: f32) -> Option<(Rgb, f32)> {
        let road = &self.road;
        let nearest = ((road.leftmost_m - patch.d_m) / road.lane_width_m).round();
        let mark = nearest.max(0.0) as usize;
        let style = *road.styles.get(mark)?;
        let from_mark_m = patch.d_m - road.mark_m(mark);
        let reach_m = 2.0 * road.paint_width_m.max(MARKER_WIDTH_M);
        if style == MarkStyle::None || from_mark_m.abs() > 0.5 * patch.spread_d_m + reach_m {
            return None;
        }
        let painted = self.painted_share(style, from_mark_m, patch) as f32;
        let marker = self.marker_share(style, from_mark_m, patch) as f32;
        let share = (painted * self.unworn(patch, footprint_m)).max(marker);
        (share > 0.0).then(|| (self.colors[mark], share))
    }

    /// Share of fresh paint in a patch this far to the left of a mark's middle.
    fn painted_share(&self, style: MarkStyle, from_mark_m: f64, patch: &GroundPatch) -> f64 {
        let lines = self.road.lines_m(style);
        let width_m = self.road.paint_width_m;
        let share = |line_m: f64| stripe_share(from_mark_m - line_m, patch.spread_d_m, width_m);
        let across = lines.map(share).sum::<f64>();
        if style == MarkStyle::Dashed && across > 0.0 {
            across * self.dash_share(patch)
        } else {
            across
        }
    }

    /// Share of the dashes' paint along the road in the patch.
    fn dash_share(&self, patch: &GroundPatch) -> f64 {
        let painted_up_to = |s_m: f64| {
            let periods = (s_m / self.road.dash_period_m).floor();
            periods * self.road.dash_m
                + (s_m - periods * self.road.dash_period_m).min(self.road.dash_m)
        };
        let (s_m, spread_m) = (
            patch.s_m - self.road.dash_offset_m,
            patch.spread_s_m.max(1e-3),
        );
        (painted_up_to(s_m + 0.5 * spread_m) - painted_up_to(s_m - 0.5 * spread_m)) / spread_m
    }

    /// Share of a raised marker, one in the middle of every gap between dashes.
    fn marker_share(&self, style: MarkStyle, from_mark_m: f64, patch: &GroundPatch) -> f64 {
        if !self.raised_markers || style != MarkStyle::Dashed {
            return 0.0;
        }
        let middle_of_gap_m = 0.5 * (self.road.dash_m + self.road.dash_period_m);
        let along_m = patch.s_m - self.road.dash_offset_m - middle_of_gap_m;
        let along_m =
            along_m - (along_m / self.road.dash_period_m).round() * self.road.dash_period_m;
        0.9 * stripe_share(along_m, patch.spread_s_m, MARKER_LENGTH_M)
            * stripe_share(from_mark_m, patch.spread_d_m, MARKER_WIDTH_M)
    }

    /// Share of the paint that is left: chips, scuffs and stretches that tyres have rubbed.
    fn unworn(&self, patch: &GroundPatch, footprint_m: f32) -> f32 {
        let (tile, [x, y]) = (Tile::shared(), patch.plane());
        let chips = tile.at(self.seed ^ 23, x, y, 0.02, footprint_m);
        let rubbed = tile.at(self.seed ^ 29, 0.2 * patch.s_m as f32, y, 0.12, footprint_m);
        (1.0 - self.wear * (0.55 + 0.5 * chips + 0.4 * rubbed)).clamp(0.0, 1.0)
    }
}
