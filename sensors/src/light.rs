use covista_traffic::SceneLook;
use nalgebra::Vector3;

use crate::appearance::Rgb;
use crate::noise::uniform;
use crate::skyline::Skyline;
use crate::tile::Tile;

/// Share of the scenes with a cloudless sky, where the sun shines.
const CLOUDLESS: f32 = 0.45;

/// Sun, sky and haze of a scene: radiances relative to a white surface in full sunlight.
pub(crate) struct Light {
    /// Unit vector towards the sun.
    pub(crate) sun_direction: Vector3<f32>,
    /// Irradiance of a surface that faces the sun.
    pub(crate) sun: Rgb,
    /// Irradiance from the whole sky on level ground.
    pub(crate) sky: Rgb,
    pub(crate) horizon: Rgb,
    zenith: Rgb,
    /// Amount of clouds; none where it is absent.
    clouds: Option<f32>,
    skyline: Skyline,
    haze_per_m: f32,
    pub(crate) seed: u32,
}

impl Light {
    pub(crate) fn new(look: &SceneLook) -> Self {
        let seed = (look.texture_seed ^ (look.texture_seed >> 29)) as u32 ^ 0x5EED;
        let draw = |index: i32| uniform(seed, index, 1);
        let direct = look.direct_light.clamp(0.0, 1.0) as f32;
        let haze_per_m = look.haze_per_m.clamp(0.0, 0.05) as f32;
        let sun_direction = look
            .sun_direction
            .try_normalize(1e-6)
            .unwrap_or_else(Vector3::z)
            .cast::<f32>();
        let low_sun = (1.0 - sun_direction.z * 2.0).clamp(0.0, 1.0);
        let warm = Rgb::new(1.0, 0.95, 0.87).lerp(&Rgb::new(1.0, 0.80, 0.58), low_sun);
        let clear = (1.6 * direct).min(1.0);
        let mix = |blue: Rgb, overcast: Rgb| overcast.lerp(&blue, clear);
        let depth = draw(2);
        let zenith = Rgb::new(0.040, 0.155, 0.46).lerp(&Rgb::new(0.10, 0.28, 0.66), depth);
        // Dust and vapour pale the sky near the horizon.
        let vapour = (0.2 * draw(3) + haze_per_m / 0.006).min(1.0);
        let horizon = Rgb::new(0.30, 0.52, 0.88).lerp(&Rgb::new(0.70, 0.79, 0.90), vapour);
        Self {
            sun_direction,
            sun: warm * (1.5 * direct) * if sun_direction.z > 0.0 { 1.0 } else { 0.0 },
            sky: mix(Rgb::new(0.17, 0.23, 0.34), Rgb::new(0.60, 0.62, 0.65)),
            zenith: mix(zenith, Rgb::new(0.62, 0.66, 0.72)),
            horizon: mix(horizon, Rgb::new(0.80, 0.82, 0.84)),
            clouds: (clear < 1.0 || draw(4) > CLOUDLESS).then(|| draw(1)),
            skyline: Skyline::new(seed),
            haze_per_m,
            seed,
        }
    }

    /// Irradiance of level ground in the open.
    pub(crate) fn open_ground(&self) -> Rgb {
        self.on_ground(1.0, 1.0)
    }

    /// Irradiance of level ground that this share of the sun and of the sky reaches.
    pub(crate) fn on_ground(&self, sunlit: f32, openness: f32) -> Rgb {
        self.sun * (self.sun_direction.z.max(0.0) * sunlit) + self.sky * openness
    }

    /// Sky without clouds, or the ground's glow below the horizon; for reflections too.
    pub(crate) fn backdrop(&self, direction: &Vector3<f32>) -> Rgb {
        if direction.z < 0.0 {
            let below = (-4.0 * direction.z).min(1.0);
            return self.horizon.lerp(&(self.open_ground() * 0.18), below);
        }
        let rise = 1.0 - direction.z;
        let rise = rise * rise;
        self.zenith.lerp(&self.horizon, rise * rise)
    }

    fn sun_glow(&self, direction: &Vector3<f32>) -> Rgb {
        let toward = self.sun_direction.dot(direction);
        if toward < 0.5 {
            return Rgb::zeros();
        }
        let (near, nearer) = (toward.powi(8), toward.powi(64));
        self.sun * (0.12 * near + 0.5 * nearer + 12.0 * nearer.powi(64))
    }

    /// What a film of water shows of the sky in this direction; the thinner it is the more blurred.
    pub(crate) fn mirrored(&self, direction: &Vector3<f32>, film: f32, sunlit: f32) -> Rgb {
        // Ripples mix the sky with trees, walls and vehicles.
        let clear = self.backdrop(direction);
        let sky = 0.35 * (clear + Rgb::repeat(clear.mean()));
        let toward = self.sun_direction.dot(direction);
        if toward < 0.7 || sunlit <= 0.0 {
            return sky;
        }
        let near = toward.powi(16);
        sky + self.sun * (sunlit * (0.25 * near + 5.0 * film * near.powi(16)))
    }

    /// The sky with clouds and the land at the horizon.
    pub(crate) fn sky(&self, direction: &Vector3<f32>) -> Rgb {
        let clear = self.backdrop(direction) + self.sun_glow(direction);
        let color = match self.clouds {
            Some(amount) => {
                let clouds = self.sky * 0.9 + self.sun * 0.75;
                clear.lerp(&clouds, self.cloud_share(direction, amount))
            }
            None => clear,
        };
        self.skyline.before(color, direction, self)
    }

    fn cloud_share(&self, direction: &Vector3<f32>, amount: f32) -> f32 {
        let height = direction.z.max(0.0) + 0.12;
        let (x, y) = (direction.x / height, direction.y / height);
        let tile = Tile::shared();
        let billow = 0.42 * tile.at(self.seed ^ 77, x, y, 0.055, 0.0)
            + 0.3 * tile.at(self.seed ^ 78, x, y, 0.6, 0.0);
        (billow + 1.2 * amount - 0.75).clamp(0.0, 0.85)
    }

    /// The colour after `distance_m` of haze.
    pub(crate) fn through_haze(&self, color: Rgb, distance_m: f32) -> Rgb {
        let through = (-self.haze_per_m * distance_m).exp();
        self.horizon.lerp(&color, through)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn far_things_take_the_colour_of_the_haze() {
        let light = crate::testing::light(0.7);
        assert!((light.through_haze(Rgb::zeros(), 1e5) - light.horizon).norm() < 1e-5);
        assert!(light.through_haze(Rgb::zeros(), 0.0).norm() < 1e-6);
    }

    #[test]
    fn a_clear_sky_is_bluer_than_an_overcast_one() {
        let blueness = |direct| {
            let color = crate::testing::light(direct).backdrop(&Vector3::new(0.9, 0.0, 0.436));
            color.z / color.x
        };
        assert!(blueness(1.0) > 2.0 && blueness(0.0) < 1.3);
    }
}
