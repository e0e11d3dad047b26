use covista_traffic::SceneLook;
use covista_world::{LANE_COUNT, LaneIndex, MARK_COUNT, Road};
use nalgebra::{Vector2, Vector3};

use crate::noise::{octaves, uniform, value_noise};

/// Width of a painted mark in metres.
pub(crate) const PAINT_WIDTH_M: f64 = 0.15;
const DASH_M: f64 = 3.0;
const DASH_PERIOD_M: f64 = 12.0;
const GRAVEL_M: f64 = 0.5;
/// Largest deviation of the ragged edges where gravel and grass begin.
const RAGGED_M: f64 = 0.18;

/// What one pixel sees of the ground.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroundPatch {
    /// Centre in the world.
    pub(crate) position: Vector2<f64>,
    /// Centre along and across the road.
    pub(crate) s_m: f64,
    pub(crate) d_m: f64,
    /// Extent along and across the road.
    pub(crate) spread_s_m: f64,
    pub(crate) spread_d_m: f64,
}

/// Colours of the ground: asphalt, paint, shoulders, grass.
pub(crate) struct Pavement {
    lane_centers_m: [f64; LANE_COUNT as usize],
    marks_m: [f64; MARK_COUNT],
    lane_width_m: f64,
    shoulders_m: [f64; 2],
    dash_offset_m: f64,
    left_paint: Vector3<f32>,
    asphalt: Vector3<f32>,
    grass: Vector3<f32>,
    wear: f32,
    seed: u32,
}

impl Pavement {
    pub(crate) fn new(road: &Road, look: &SceneLook) -> Self {
        let seed = (look.texture_seed ^ (look.texture_seed >> 32)) as u32;
        let draw = |index: i32| uniform(seed, index, 7919);
        let mut lane_centers_m = [0.0; LANE_COUNT as usize];
        for (center, lane) in lane_centers_m.iter_mut().zip(LaneIndex::all()) {
            *center = road.lane_center_m(lane);
        }
        let tint = 0.05 * (draw(0) - 0.4);
        let dry = draw(1);
        Self {
            lane_centers_m,
            marks_m: std::array::from_fn(|mark| road.mark_offset_m(mark)),
            lane_width_m: road.lane_width_m(),
            shoulders_m: [draw(2), draw(3)].map(|x| 1.5 + f64::from(x)),
            dash_offset_m: DASH_PERIOD_M * f64::from(draw(4)),
            left_paint: if draw(5) < 0.5 {
                Vector3::new(0.72, 0.46, 0.06)
            } else {
                Vector3::new(0.74, 0.74, 0.72)
            },
            asphalt: Vector3::new(1.0 + tint, 1.0, 1.0 - tint)
                * (0.6 * look.asphalt_albedo.clamp(0.02, 1.0) as f32),
            grass: Vector3::new(0.055, 0.085, 0.028).lerp(&Vector3::new(0.20, 0.16, 0.075), dry),
            wear: look.paint_wear.clamp(0.0, 1.0) as f32,
            seed,
        }
    }

    /// Diffuse albedo of a patch of the ground.
    pub(crate) fn albedo(&self, patch: &GroundPatch) -> Vector3<f32> {
        let footprint_m = (patch.spread_s_m * patch.spread_d_m).sqrt();
        let blur_m = patch.spread_d_m.max(0.05);
        let mut beyond_m = self.beyond_shoulder_m(patch.d_m);
        if beyond_m < -RAGGED_M - 0.5 * blur_m {
            return self.paved(patch, footprint_m);
        }
        if beyond_m > GRAVEL_M + RAGGED_M + 0.5 * blur_m {
            return self.meadow(patch, footprint_m);
        }
        let p = patch.position;
        let bands = [(2.0, 0.105), (0.4, 0.075)];
        beyond_m += f64::from(octaves(self.seed ^ 31, p.x, p.y, footprint_m, &bands));
        let share_beyond =
            |edge_m: f64| ((beyond_m - edge_m) / blur_m + 0.5).clamp(0.0, 1.0) as f32;
        let (unpaved, green) = (share_beyond(0.0), share_beyond(GRAVEL_M));
        self.paved(patch, footprint_m) * (1.0 - unpaved)
            + self.gravel(patch, footprint_m) * (unpaved - green)
            + self.meadow(patch, footprint_m) * green
    }

    /// How far `d_m` lies outside of the paved shoulders.
    fn beyond_shoulder_m(&self, d_m: f64) -> f64 {
        let [left_m, right_m] = self.shoulders_m;
        let left_edge_m = self.marks_m[0] + left_m;
        let right_edge_m = self.marks_m[MARK_COUNT - 1] - right_m;
        (d_m - left_edge_m).max(right_edge_m - d_m)
    }

    fn gravel(&self, patch: &GroundPatch, footprint_m: f64) -> Vector3<f32> {
        let p = patch.position;
        let bands = [(0.05, 0.3), (0.3, 0.2)];
        let grain = octaves(self.seed ^ 41, p.x, p.y, footprint_m, &bands);
        Vector3::new(0.21, 0.19, 0.16) * (1.0 + grain)
    }

    fn meadow(&self, patch: &GroundPatch, footprint_m: f64) -> Vector3<f32> {
        let p = patch.position;
        let bands = [
            (0.06, 0.30),
            (0.25, 0.25),
            (1.3, 0.2),
            (6.0, 0.2),
            (30.0, 0.2),
        ];
        let light = octaves(self.seed ^ 53, p.x, p.y, footprint_m, &bands);
        let hue = octaves(
            self.seed ^ 59,
            p.x,
            p.y,
            footprint_m,
            &[(9.0, 0.2), (0.8, 0.15)],
        );
        let tint = Vector3::new(1.0 + hue, 1.0, 1.0 - 0.5 * hue);
        self.grass.component_mul(&tint) * (1.0 + light).max(0.2)
    }

    fn paved(&self, patch: &GroundPatch, footprint_m: f64) -> Vector3<f32> {
        let asphalt = self.asphalt * self.asphalt_shade(patch, footprint_m);
        let mut color = asphalt;
        for (mark, &offset_m) in self.marks_m.iter().enumerate() {
            let half_reach_m = 0.5 * (PAINT_WIDTH_M + patch.spread_d_m);
            if (patch.d_m - offset_m).abs() >= half_reach_m {
                continue;
            }
            let edge = mark == 0 || mark == MARK_COUNT - 1;
            let across = stripe_share(patch.d_m - offset_m, patch.spread_d_m, PAINT_WIDTH_M);
            let along = if edge { 1.0 } else { self.dash_share(patch) };
            let paint = if mark == 0 {
                self.left_paint
            } else {
                Vector3::new(0.74, 0.74, 0.72)
            };
            let share = (across * along) as f32 * self.unworn(patch, footprint_m);
            color = color.lerp(&paint, share);
        }
        color
    }

    /// Brightness of bare asphalt about one.
    fn asphalt_shade(&self, patch: &GroundPatch, footprint_m: f64) -> f32 {
        let GroundPatch {
            position: p, d_m, ..
        } = *patch;
        let bands = [
            (0.03, 0.22),
            (0.08, 0.14),
            (0.25, 0.07),
            (1.1, 0.05),
            (5.0, 0.05),
            (25.0, 0.06),
        ];
        let grain = octaves(self.seed ^ 3, p.x, p.y, footprint_m, &bands);
        let lane_offset_m = self
            .lane_centers_m
            .iter()
            .map(|center| d_m - center)
            .fold(f64::MAX, |a, b| if b.abs() < a.abs() { b } else { a });
        let off_road = lane_offset_m.abs() > 0.5 * self.lane_width_m;
        let hump = |offset_m: f64, width_m: f64| {
            let x = (lane_offset_m.abs() - offset_m) / width_m.max(0.5 * patch.spread_d_m);
            (-x * x).exp() as f32
        };
        // Tyres polish two tracks, oil drips between them.
        let tracks = if off_road {
            -0.08
        } else {
            -0.10 * hump(0.85, 0.33) - 0.07 * hump(0.0, 0.4)
        };
        (1.0 + grain + tracks + self.repairs(patch) - self.cracks(patch, footprint_m)).max(0.15)
    }

    /// Patches of newer or older asphalt, a lane wide.
    fn repairs(&self, patch: &GroundPatch) -> f32 {
        const CELL_M: f64 = 17.0;
        let lane = ((self.marks_m[0] - patch.d_m) / self.lane_width_m).floor() as i32;
        let cell = (patch.s_m / CELL_M).floor();
        let draw = |index: i32| uniform(self.seed ^ 11, cell as i32, lane * 8 + index);
        if draw(0) > 0.16 {
            return 0.0;
        }
        let length_m = CELL_M * f64::from(0.3 + 0.6 * draw(1));
        let middle_m = (cell + 0.5) * CELL_M;
        let share = stripe_share(patch.s_m - middle_m, patch.spread_s_m, length_m);
        let tone = if draw(2) < 0.7 { -0.25 } else { 0.15 };
        share as f32 * tone
    }

    /// Tar-sealed cracks: zero lines of a noise, only in places.
    fn cracks(&self, patch: &GroundPatch, footprint_m: f64) -> f32 {
        const WIDTH_M: f64 = 0.025;
        if footprint_m > 0.4 {
            return 0.0;
        }
        let p = patch.position;
        let place = value_noise(self.seed ^ 17, p.x / 21.0, p.y / 21.0) - 0.25;
        if place <= 0.0 {
            return 0.0;
        }
        let from_line_m = 2.0 * f64::from(value_noise(self.seed ^ 19, p.x / 2.7, p.y / 2.7)).abs();
        let share = (WIDTH_M / footprint_m).min(1.0)
            * (1.0 - (from_line_m / (WIDTH_M + footprint_m))).clamp(0.0, 1.0);
        (0.45 * share) as f32 * (4.0 * place).min(1.0)
    }

    /// Share of the dashes' paint along the road in the patch.
    fn dash_share(&self, patch: &GroundPatch) -> f64 {
        let painted_up_to = |s_m: f64| {
            let periods = (s_m / DASH_PERIOD_M).floor();
            periods * DASH_M + (s_m - periods * DASH_PERIOD_M).min(DASH_M)
        };
        let (s_m, spread_m) = (patch.s_m - self.dash_offset_m, patch.spread_s_m.max(1e-3));
        (painted_up_to(s_m + 0.5 * spread_m) - painted_up_to(s_m - 0.5 * spread_m)) / spread_m
    }

    /// Share of the paint that is left.
    fn unworn(&self, patch: &GroundPatch, footprint_m: f64) -> f32 {
        let p = patch.position;
        let bands = [(0.04, 0.5), (0.15, 0.6), (0.9, 0.4), (7.0, 0.4)];
        let scuff = octaves(self.seed ^ 23, p.x, p.y, footprint_m, &bands);
        (1.0 - self.wear * (1.0 + 1.2 * scuff)).clamp(0.0, 1.0)
    }
}

/// Share of a patch at `x_m` with extent `spread_m` that a stripe about zero covers.
fn stripe_share(x_m: f64, spread_m: f64, width_m: f64) -> f64 {
    let spread_m = spread_m.max(1e-3);
    let (low, high) = (x_m - 0.5 * spread_m, x_m + 0.5 * spread_m);
    ((high.min(0.5 * width_m) - low.max(-0.5 * width_m)) / spread_m).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stripe_covers_its_share_of_a_wide_patch() {
        assert!((stripe_share(0.0, 0.6, 0.15) - 0.25).abs() < 1e-12);
        assert!((stripe_share(0.02, 0.01, 0.15) - 1.0).abs() < 1e-12);
        assert!((stripe_share(0.075, 0.01, 0.15) - 0.5).abs() < 1e-9);
        assert!(stripe_share(0.5, 0.2, 0.15).abs() < 1e-12);
    }
}
