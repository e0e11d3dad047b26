use nalgebra::Vector3;

use super::damage::Damage;
use super::{GroundPatch, stripe_share};
use crate::appearance::Rgb;
use crate::carriageway::Carriageway;
use crate::noise::{floor, uniform};
use crate::tile::Tile;

const PROFILE_STEP_M: f64 = 0.02;
const SLAB_JOINT_M: f64 = 0.03;

/// What a carriageway is paved with.
pub(super) struct Surface {
    color: Rgb,
    /// Length of the concrete slabs; asphalt has none.
    slab_m: Option<f64>,
    left_m: f64,
    lane_width_m: f64,
    /// Sum up to each step across the road, from the left, of how much lighter than its
    /// neighbourhood the surface is there: tracks, stains, seams along the lanes.
    profile: Vec<f32>,
    coarseness: f32,
    stains: f32,
    damage: Damage,
    seed: u32,
}

impl Surface {
    pub(super) fn new(road: &Carriageway, albedo: f64, damage: f64, seed: u32) -> Self {
        let draw = |index: i32| uniform(seed ^ 0xA5F, index, 3);
        let damage = damage.clamp(0.0, 1.0) as f32;
        let albedo = albedo.clamp(0.02, 1.0) as f32;
        let concrete = draw(0) < 0.25;
        let tint = 0.11 * (draw(1) - 0.6);
        let (grey, slab_m) = if concrete {
            (0.18 + 0.35 * albedo, Some(4.0 + 2.0 * f64::from(draw(2))))
        } else {
            (0.45 * albedo, None)
        };
        let warmth = if concrete {
            0.04 + 0.12 * draw(5)
        } else {
            tint
        };
        Self {
            color: Vector3::new(1.0 + warmth, 1.0, 1.0 - 1.3 * warmth) * grey,
            slab_m,
            left_m: road.edges_m[0],
            lane_width_m: road.lane_width_m,
            profile: profile(road, concrete, damage, seed),
            coarseness: 0.05 + 0.08 * draw(3),
            stains: if concrete { 0.24 } else { 0.05 } * (0.3 + draw(4) + damage),
            damage: Damage::new(damage, seed),
            seed,
        }
    }

    pub(super) fn albedo(&self, patch: &GroundPatch, footprint_m: f32) -> Rgb {
        let (tile, [x, y]) = (Tile::shared(), patch.plane());
        let grain = tile.at(self.seed ^ 3, x, y, 0.012, footprint_m);
        let blotches = tile.at(self.seed ^ 7, x, y, 0.21, footprint_m);
        let along = 0.06 * patch.s_m as f32;
        let streaks = tile.at(self.seed ^ 13, along, patch.d_m as f32, 0.07, footprint_m);
        // Stains are dark and have edges; the rest of the surface is even.
        let stained = (0.4 * blotches + streaks - 0.5).clamp(0.0, 1.5);
        let tone = 1.0 + 1.4 * self.coarseness * grain + 0.025 * blotches + 0.035 * streaks
            - self.stains * stained
            + self.across(patch, streaks)
            + self.slab(patch);
        let worn = self
            .damage
            .tone(patch, self.lane(patch.d_m), self.lane_width_m, footprint_m);
        self.color * (tone * worn).max(0.12)
    }

    fn lane(&self, d_m: f64) -> i32 {
        floor((self.left_m - d_m) / self.lane_width_m)
    }

    /// Mean of the profile over the patch; `streaks` lets the stains' edges wander.
    fn across(&self, patch: &GroundPatch, streaks: f32) -> f32 {
        let d_m = patch.d_m + 0.015 * f64::from(streaks);
        let width = (patch.spread_d_m / PROFILE_STEP_M).max(1.0);
        let middle = (self.left_m - d_m) / PROFILE_STEP_M;
        let (from, to) = (
            self.up_to(middle - 0.5 * width),
            self.up_to(middle + 0.5 * width),
        );
        (to - from) / width as f32
    }

    fn up_to(&self, steps: f64) -> f32 {
        let steps = steps.clamp(0.0, (self.profile.len() - 2) as f64);
        let index = steps as usize;
        let (a, b) = (self.profile[index], self.profile[index + 1]);
        a + (steps - index as f64) as f32 * (b - a)
    }

    /// Concrete is poured slab by slab with joints between them.
    fn slab(&self, patch: &GroundPatch) -> f32 {
        let Some(slab_m) = self.slab_m else {
            return 0.0;
        };
        let lane = self.lane(patch.d_m);
        let place = patch.s_m / slab_m + 0.37 * f64::from(lane & 1);
        let slab = floor(place);
        let from_joint_m = (place - place.round()) * slab_m;
        let joint = stripe_share(from_joint_m, patch.spread_s_m, SLAB_JOINT_M) as f32;
        let fade = (slab_m / (4.0 * patch.spread_s_m)).min(1.0) as f32;
        0.16 * fade * (uniform(self.seed ^ 61, slab, lane) - 0.5) - 0.45 * joint
    }
}

/// Prefix sums of the tones across the road.
fn profile(road: &Carriageway, concrete: bool, damage: f32, seed: u32) -> Vec<f32> {
    let [left_m, right_m] = road.edges_m;
    let draw = |index: i32, lane: i32| uniform(seed ^ 0x9A0F, index, lane);
    let steps = ((left_m - right_m) / PROFILE_STEP_M).ceil() as usize + 1;
    let d_m = |step: usize| left_m - (step as f64 + 0.5) * PROFILE_STEP_M;
    let mut tones = vec![0.0_f32; steps];
    let mut add = |middle_m: f64, width_m: f64, tone: f32| {
        for (step, value) in tones.iter_mut().enumerate() {
            let x = (d_m(step) - middle_m) / width_m;
            *value += tone * (-x * x).exp() as f32;
        }
    };
    let (tracks, oil) = if concrete { (0.10, 0.24) } else { (0.08, 0.09) };
    for lane in 0..road.lane_count() as i32 {
        let middle_m = road.leftmost_m - (f64::from(lane) + 0.5) * road.lane_width_m;
        for side in [-0.87, 0.87] {
            // Tyres darken concrete and polish old asphalt; some tracks shine.
            let sign = if concrete || draw(0, -1) < 0.65 {
                -1.0
            } else {
                0.6
            };
            add(middle_m + side, 0.36, sign * tracks * (0.2 + draw(1, lane)));
        }
        add(middle_m, 0.36, -oil * draw(2, lane));
        // Seams of tar and traces of ground off lines run along the lanes.
        for seam in 0..2 {
            if draw(3 + 4 * seam, lane) < 0.10 + 0.40 * damage {
                let at_m = middle_m + road.lane_width_m * f64::from(draw(4 + 4 * seam, lane) - 0.5);
                let dark = draw(5 + 4 * seam, lane) < 0.7;
                let width_m = f64::from(0.02 + 0.05 * draw(6 + 4 * seam, lane));
                let strength = 0.15 + 0.35 * damage;
                add(at_m, width_m, if dark { -strength } else { 0.6 * strength });
            }
        }
    }
    // Every lane is paved in one pass of its own, a little beside its marks.
    let joint_m = 0.3 * f64::from(draw(20, 0) - 0.5);
    for pass in 0..=road.lane_count() as i32 {
        let at_m = road.leftmost_m - f64::from(pass) * road.lane_width_m + joint_m;
        if draw(21, pass) < 0.3 + 0.4 * damage {
            add(at_m, 0.02, -0.30 * draw(22, pass));
        }
    }
    let shoulder = 0.35 * (draw(23, 0) - 0.6);
    for (step, tone) in tones.iter_mut().enumerate() {
        let pass = floor((road.leftmost_m + joint_m - d_m(step)) / road.lane_width_m);
        let beyond = pass < 0 || pass >= road.lane_count() as i32;
        *tone += if beyond {
            shoulder
        } else {
            0.14 * (draw(24, pass) - 0.5)
        };
    }
    let mut sum = 0.0;
    let mut sums = vec![0.0];
    sums.extend(tones.iter().map(|tone| {
        sum += tone;
        sum
    }));
    sums
}
