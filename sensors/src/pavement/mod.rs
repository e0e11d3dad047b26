mod canopy;
mod damage;
mod paint;
mod surface;
#[cfg(test)]
mod tests;
mod verge;

use covista_traffic::Scene;
use nalgebra::{Vector2, Vector3};

use self::canopy::Canopy;
use self::paint::Paint;
use self::surface::Surface;
use self::verge::Verge;
use crate::appearance::{Light, Rgb};
use crate::carriageway::texture_seed;
use crate::tile::Tile;

const GRAVEL_M: f64 = 0.5;
/// Largest deviation of the ragged edges where gravel and grass begin.
const RAGGED_M: f64 = 0.25;
/// From here to the edge of the pavement leaves and dust gather.
const LITTER_M: f64 = 1.2;
/// What water reflects that is looked at from above.
const WATER_SPECULAR: f32 = 0.02;
/// Stones rise from the water: no ray meets it flatter than this.
const ROUGHNESS: f32 = 0.13;

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

impl GroundPatch {
    fn plane(&self) -> [f32; 2] {
        [self.position.x as f32, self.position.y as f32]
    }

    fn footprint_m(&self) -> f32 {
        (self.spread_s_m * self.spread_d_m).sqrt() as f32
    }
}

/// Colours of the ground: asphalt or concrete, paint, shoulders, grass.
pub(crate) struct Pavement {
    paint: Paint,
    surface: Surface,
    verge: Verge,
    canopy: Option<Canopy>,
    wetness: f32,
    seed: u32,
}

impl Pavement {
    pub(crate) fn new(scene: &Scene) -> Self {
        let look = &scene.look;
        let seed = texture_seed(look);
        let paint = Paint::new(scene, seed);
        Self {
            surface: Surface::new(&paint.road, look.asphalt_albedo, look.damage, seed),
            paint,
            verge: Verge::new(seed),
            canopy: Canopy::new(seed),
            wetness: look.wetness.clamp(0.0, 1.0) as f32,
            seed,
        }
    }

    /// Radiance of a patch seen along `view`, which this share of the sun and the sky reaches.
    pub(crate) fn radiance(
        &self,
        patch: &GroundPatch,
        light: &Light,
        view: &Vector3<f32>,
        sunlit: f32,
        openness: f32,
    ) -> Rgb {
        let footprint_m = patch.footprint_m();
        let sunlit = match &self.canopy {
            Some(canopy) if sunlit > 0.0 => sunlit * canopy.sunlit(patch, light, footprint_m),
            _ => sunlit,
        };
        let albedo = self.albedo(patch);
        let diffuse = albedo.component_mul(&light.on_ground(sunlit, openness));
        if self.beyond_pavement_m(patch.d_m) > 0.0 {
            return diffuse;
        }
        let grazing = (1.0 + view.z - ROUGHNESS).clamp(0.0, 1.0);
        let fresnel = WATER_SPECULAR + (1.0 - WATER_SPECULAR) * grazing.powi(5);
        // Dry stones shine a little too where one looks along the road.
        let film = self.film(patch, footprint_m).max(0.06);
        let mirrored = Vector3::new(view.x, view.y, -view.z);
        let reflected = light.mirrored(&mirrored, film, sunlit) * openness;
        diffuse + reflected * (film * fresnel)
    }

    /// Diffuse albedo of a patch of the ground.
    pub(crate) fn albedo(&self, patch: &GroundPatch) -> Rgb {
        let footprint_m = patch.footprint_m();
        let blur_m = patch.spread_d_m.max(0.05);
        let mut beyond_m = self.beyond_pavement_m(patch.d_m);
        if beyond_m < -LITTER_M - 0.5 * blur_m {
            return self.paved(patch, footprint_m);
        }
        if beyond_m > GRAVEL_M + RAGGED_M + 0.5 * blur_m {
            return self.verge.meadow(patch, footprint_m) * (1.0 - 0.3 * self.wetness);
        }
        let [x, y] = patch.plane();
        let ragged = Tile::shared().at(self.seed ^ 31, x, y, 0.06, footprint_m);
        beyond_m += (0.09 * f64::from(ragged)).clamp(-RAGGED_M, RAGGED_M);
        let share_beyond =
            |edge_m: f64| ((beyond_m - edge_m) / blur_m + 0.5).clamp(0.0, 1.0) as f32;
        let (unpaved, green) = (share_beyond(0.0), share_beyond(GRAVEL_M));
        let (litter, share) = self.verge.litter(patch, -beyond_m as f32, footprint_m);
        self.paved(patch, footprint_m).lerp(&litter, share) * (1.0 - unpaved)
            + self.verge.gravel(patch, footprint_m) * (unpaved - green)
            + self.verge.meadow(patch, footprint_m) * green
    }

    /// How far `d_m` lies outside of the paved shoulders.
    fn beyond_pavement_m(&self, d_m: f64) -> f64 {
        let [left_m, right_m] = self.paint.road.edges_m;
        (d_m - left_m).max(right_m - d_m)
    }

    fn paved(&self, patch: &GroundPatch, footprint_m: f32) -> Rgb {
        let film = self.film(patch, footprint_m);
        let bare = self.surface.albedo(patch, footprint_m) * (1.0 - 0.5 * film);
        match self.paint.cover(patch, footprint_m) {
            Some((paint, share)) => bare.lerp(&(paint * (1.0 - 0.25 * film)), share),
            None => bare,
        }
    }

    /// How wet the patch is: a road dries first where it lies higher.
    fn film(&self, patch: &GroundPatch, footprint_m: f32) -> f32 {
        if self.wetness <= 0.0 {
            return 0.0;
        }
        let [x, y] = patch.plane();
        let hollows = Tile::shared().at(self.seed ^ 97, x, y, 0.31, footprint_m);
        (1.3 * self.wetness * (1.0 + 0.25 * hollows)).clamp(0.0, 1.0)
    }
}

/// Share of a patch at `x_m` with extent `spread_m` that a stripe about zero covers.
fn stripe_share(x_m: f64, spread_m: f64, width_m: f64) -> f64 {
    let spread_m = spread_m.max(1e-3);
    let (low, high) = (x_m - 0.5 * spread_m, x_m + 0.5 * spread_m);
    ((high.min(0.5 * width_m) - low.max(-0.5 * width_m)) / spread_m).clamp(0.0, 1.0)
}
