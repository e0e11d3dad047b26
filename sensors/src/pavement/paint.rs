use covista_traffic::{MarkStyle, PaintColor, Scene};
use covista_world::MARK_COUNT;
use nalgebra::Vector3;

use super::{GroundPatch, stripe_share};
use crate::appearance::Rgb;
use crate::noise::uniform;
use crate::tile::Tile;

const MARKER_LENGTH_M: f64 = 0.14;
const MARKER_WIDTH_M: f64 = 0.11;

/// The carriageway's lane marks at equal distances, from the left.
pub(super) struct Paint {
    marks: Vec<Mark>,
    /// Offset of the leftmost mark from the road's reference line.
    pub(super) leftmost_m: f64,
    pub(super) lane_width_m: f64,
    width_m: f64,
    dash_m: f64,
    dash_period_m: f64,
    dash_offset_m: f64,
    /// Raised markers in the gaps between dashes.
    raised_markers: bool,
    wear: f32,
    seed: u32,
}

#[derive(Clone, Copy)]
struct Mark {
    style: MarkStyle,
    color: Rgb,
}

impl Paint {
    pub(super) fn new(scene: &Scene, seed: u32) -> Self {
        let (road, markings) = (&scene.road, &scene.markings);
        let wear = scene.look.paint_wear.clamp(0.0, 1.0) as f32;
        let draw = |index: i32| uniform(seed, index, 7919);
        let lane_width_m = road.lane_width_m();
        let [left, right] = markings.lanes_beyond.map(usize::from);
        let edge_color = if draw(5) < 0.6 {
            PaintColor::Yellow
        } else {
            PaintColor::White
        };
        let last = left + MARK_COUNT + right - 1;
        let mark = |index: usize| {
            let own = index.checked_sub(left).filter(|&own| own < MARK_COUNT);
            let (style, color) = match own {
                Some(own) => (markings.styles[own], markings.colors[own]),
                None if index == 0 => (MarkStyle::Solid, edge_color),
                None if index == last => (MarkStyle::Solid, PaintColor::White),
                None => (MarkStyle::Dashed, PaintColor::White),
            };
            let fresh = match color {
                PaintColor::White => Vector3::new(0.80, 0.80, 0.77),
                PaintColor::Yellow => {
                    Vector3::new(0.86, 0.42, 0.02).lerp(&Vector3::new(0.80, 0.58, 0.12), draw(6))
                }
            };
            let dirt = 0.12 + 0.35 * wear;
            Mark {
                style,
                color: fresh.lerp(&Vector3::new(0.33, 0.31, 0.28), dirt),
            }
        };
        let dash_period_m = markings.dash_period_m.max(0.1);
        Self {
            marks: (0..=last).map(mark).collect(),
            leftmost_m: road.mark_offset_m(0) + left as f64 * lane_width_m,
            lane_width_m,
            width_m: markings.paint_width_m.clamp(0.0, lane_width_m),
            dash_m: markings.dash_m.clamp(0.0, dash_period_m),
            dash_period_m,
            dash_offset_m: dash_period_m * f64::from(draw(4)),
            raised_markers: draw(7) < 0.35,
            wear,
            seed,
        }
    }

    /// Offset of the rightmost mark from the road's reference line.
    pub(super) fn rightmost_m(&self) -> f64 {
        self.leftmost_m - (self.marks.len() - 1) as f64 * self.lane_width_m
    }

    /// Number of lanes, those beyond the road's own included.
    pub(super) fn lane_count(&self) -> usize {
        self.marks.len() - 1
    }

    /// The colour of the paint in the patch and its share of it.
    pub(super) fn cover(&self, patch: &GroundPatch, footprint_m: f32) -> Option<(Rgb, f32)> {
        let nearest = ((self.leftmost_m - patch.d_m) / self.lane_width_m).round();
        let mark = self.marks.get(nearest.max(0.0) as usize)?;
        let from_mark_m = patch.d_m - (self.leftmost_m - nearest * self.lane_width_m);
        if mark.style == MarkStyle::None
            || from_mark_m.abs() > 0.5 * patch.spread_d_m + 2.0 * self.width_m.max(MARKER_WIDTH_M)
        {
            return None;
        }
        let painted = self.painted_share(mark.style, from_mark_m, patch) as f32;
        let marker = self.marker_share(mark.style, from_mark_m, patch) as f32;
        let share = (painted * self.unworn(patch, footprint_m)).max(marker);
        (share > 0.0).then_some((mark.color, share))
    }

    /// Share of fresh paint in a patch this far to the left of a mark's middle.
    fn painted_share(&self, style: MarkStyle, from_mark_m: f64, patch: &GroundPatch) -> f64 {
        let line = |at_m: f64| stripe_share(at_m, patch.spread_d_m, self.width_m);
        match style {
            MarkStyle::None => 0.0,
            MarkStyle::Solid => line(from_mark_m),
            MarkStyle::Dashed => line(from_mark_m) * self.dash_share(patch),
            MarkStyle::Double => {
                line(from_mark_m - self.width_m) + line(from_mark_m + self.width_m)
            }
        }
    }

    /// Share of the dashes' paint along the road in the patch.
    fn dash_share(&self, patch: &GroundPatch) -> f64 {
        let painted_up_to = |s_m: f64| {
            let periods = (s_m / self.dash_period_m).floor();
            periods * self.dash_m + (s_m - periods * self.dash_period_m).min(self.dash_m)
        };
        let (s_m, spread_m) = (patch.s_m - self.dash_offset_m, patch.spread_s_m.max(1e-3));
        (painted_up_to(s_m + 0.5 * spread_m) - painted_up_to(s_m - 0.5 * spread_m)) / spread_m
    }

    /// Share of a raised marker, one in the middle of every gap between dashes.
    fn marker_share(&self, style: MarkStyle, from_mark_m: f64, patch: &GroundPatch) -> f64 {
        if !self.raised_markers || style != MarkStyle::Dashed {
            return 0.0;
        }
        let middle_of_gap_m = 0.5 * (self.dash_m + self.dash_period_m);
        let along_m = patch.s_m - self.dash_offset_m - middle_of_gap_m;
        let along_m = along_m - (along_m / self.dash_period_m).round() * self.dash_period_m;
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
