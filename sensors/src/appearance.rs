use covista_traffic::{Material, SceneLook};
use nalgebra::{Point3, Vector3};

use crate::noise::{octaves, uniform};

pub(crate) type Rgb = Vector3<f32>;

const SKY_SPECULAR: f32 = 0.04;
/// Wavelengths in radians and heights (as z of a unit vector) of the far skyline.
const SKYLINE_BANDS: [(f64, f32); 4] = [(0.5, 0.020), (0.12, 0.010), (0.03, 0.006), (0.008, 0.003)];
/// No skyline reaches higher.
const SKYLINE_TOP: f32 = 0.062;

/// Sun, sky and haze of a scene: radiances relative to a white surface in full sunlight.
pub(crate) struct Light {
    /// Unit vector towards the sun.
    pub(crate) sun_direction: Vector3<f32>,
    /// Irradiance of a surface that faces the sun.
    pub(crate) sun: Rgb,
    /// Irradiance from the whole sky on level ground.
    pub(crate) sky: Rgb,
    zenith: Rgb,
    horizon: Rgb,
    cloud_cover: f32,
    haze_per_m: f32,
    seed: u32,
}

impl Light {
    pub(crate) fn new(look: &SceneLook) -> Self {
        let seed = (look.texture_seed ^ (look.texture_seed >> 29)) as u32 ^ 0x5EED;
        let direct = look.direct_light.clamp(0.0, 1.0) as f32;
        let sun_direction = look
            .sun_direction
            .try_normalize(1e-6)
            .unwrap_or_else(Vector3::z)
            .cast::<f32>();
        let low_sun = (1.0 - sun_direction.z * 2.0).clamp(0.0, 1.0);
        let warm = Rgb::new(1.0, 0.95, 0.87).lerp(&Rgb::new(1.0, 0.80, 0.58), low_sun);
        let mix = |clear: Rgb, overcast: Rgb| overcast.lerp(&clear, direct.sqrt());
        Self {
            sun_direction,
            sun: warm * (1.5 * direct) * if sun_direction.z > 0.0 { 1.0 } else { 0.0 },
            sky: mix(Rgb::new(0.23, 0.28, 0.36), Rgb::new(0.60, 0.62, 0.65)),
            zenith: mix(Rgb::new(0.13, 0.30, 0.68), Rgb::new(0.62, 0.66, 0.72)),
            horizon: mix(Rgb::new(0.62, 0.76, 0.92), Rgb::new(0.80, 0.82, 0.84)),
            cloud_cover: 0.75 * uniform(seed, 1, 1),
            haze_per_m: look.haze_per_m.clamp(0.0, 0.05) as f32,
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
    fn backdrop(&self, direction: &Vector3<f32>) -> Rgb {
        if direction.z < 0.0 {
            let below = (-4.0 * direction.z).min(1.0);
            return self.horizon.lerp(&(self.open_ground() * 0.18), below);
        }
        self.horizon.lerp(&self.zenith, direction.z.sqrt())
    }

    fn sun_glow(&self, direction: &Vector3<f32>) -> Rgb {
        let toward = self.sun_direction.dot(direction).max(0.0);
        self.sun * (0.15 * toward.powi(6) + 0.5 * toward.powi(48) + 12.0 * toward.powi(4000))
    }

    /// The sky with clouds and a line of far woods and hills.
    pub(crate) fn sky(&self, direction: &Vector3<f32>) -> Rgb {
        let clear = self.backdrop(direction) + self.sun_glow(direction);
        let clouds = self.sky * 0.9 + self.sun * 0.75;
        let color = clear.lerp(&clouds, self.cloud_share(direction));
        if direction.z > SKYLINE_TOP {
            return color;
        }
        let azimuth = f64::from(direction.y.atan2(direction.x));
        let skyline = 0.022 + octaves(self.seed, azimuth + 9.0, 0.5, 1e-6, &SKYLINE_BANDS);
        let share = ((skyline - direction.z) / 0.0015).clamp(0.0, 1.0);
        if share > 0.0 {
            color.lerp(&self.woods(azimuth, f64::from(direction.z)), share)
        } else {
            color
        }
    }

    fn cloud_share(&self, direction: &Vector3<f32>) -> f32 {
        let height = direction.z + 0.12;
        let (x, y) = (direction.x / height, direction.y / height);
        let bands = [(1.6, 0.55), (0.7, 0.3), (0.3, 0.18), (0.13, 0.1)];
        let billow = octaves(self.seed ^ 77, f64::from(x), f64::from(y), 1e-6, &bands);
        (billow + 1.3 * self.cloud_cover - 0.75).clamp(0.0, 0.8)
    }

    fn woods(&self, azimuth: f64, height: f64) -> Rgb {
        let bands = [(0.012, 0.3), (0.004, 0.3)];
        let leaves = octaves(self.seed ^ 5, azimuth, height, 1e-6, &bands);
        let green = Rgb::new(0.045, 0.065, 0.04);
        let near = self.open_ground().component_mul(&green) * (1.0 + leaves);
        self.through_haze(near.lerp(&self.horizon, 0.35), 600.0)
    }

    /// The colour after `distance_m` of haze.
    pub(crate) fn through_haze(&self, color: Rgb, distance_m: f32) -> Rgb {
        let through = (-self.haze_per_m * distance_m).exp();
        self.horizon.lerp(&color, through)
    }

    /// Radiance of a surface seen along `view`, with the share of sunlight that reaches it.
    pub(crate) fn surface(
        &self,
        material: Material,
        point: &Point3<f32>,
        normal: &Vector3<f32>,
        view: &Vector3<f32>,
        sunlit: f32,
        footprint_m: f32,
    ) -> Rgb {
        let finish = finish(material, point, normal, footprint_m, self.seed);
        let facing_sun = normal.dot(&self.sun_direction).max(0.0);
        // Half of the sky is seen by a wall, the other half of its view is the ground.
        let up = 0.5 + 0.5 * normal.z;
        let bounce = self.open_ground() * 0.16;
        // Surfaces near the ground look at a darker neighbourhood.
        let openness = 0.55 + 0.45 * (point.z / 0.9).clamp(0.0, 1.0);
        let ambient = (self.sky * up + bounce * (1.0 - up)) * openness;
        let mut color = finish
            .albedo
            .component_mul(&(self.sun * facing_sun * sunlit + ambient));
        if finish.gloss > 0.0 {
            let reflected = view - 2.0 * view.dot(normal) * normal;
            let grazing = (1.0 + view.dot(normal)).clamp(0.0, 1.0);
            let fresnel = SKY_SPECULAR + (1.0 - SKY_SPECULAR) * grazing.powi(5);
            color += self.backdrop(&reflected) * (finish.gloss * fresnel);
            let glint = self.sun_direction.dot(&reflected).max(0.0);
            color += self.sun
                * (finish.gloss * sunlit * (6.0 * glint.powi(600) + 0.25 * glint.powi(24)));
        }
        color
    }
}

/// What a surface does to light.
struct Finish {
    albedo: Rgb,
    gloss: f32,
}

fn finish(
    material: Material,
    point: &Point3<f32>,
    normal: &Vector3<f32>,
    footprint_m: f32,
    seed: u32,
) -> Finish {
    // Coordinates on an upright surface: along it and up.
    let along = f64::from(point.y * normal.x - point.x * normal.y);
    let up = f64::from(point.z);
    let footprint = f64::from(footprint_m).max(1e-4);
    let noise = |salt: u32, bands: &[(f64, f32)]| {
        let x = along + 0.37 * f64::from(point.x + point.y);
        octaves(seed ^ salt, x, up, footprint, bands)
    };
    match material {
        Material::CarPaint(rgb) => Finish {
            albedo: linear(rgb) * 0.9,
            gloss: 1.0,
        },
        Material::Glass => Finish {
            albedo: Rgb::new(0.02, 0.022, 0.024),
            gloss: 1.6,
        },
        Material::Rubber => Finish {
            albedo: Rgb::repeat(0.025),
            gloss: 0.15,
        },
        Material::Reflector(rgb) => Finish {
            albedo: linear(rgb) * 1.1,
            gloss: 0.8,
        },
        Material::Metal => Finish {
            albedo: Rgb::new(0.36, 0.37, 0.38) * (1.0 + noise(101, &[(0.5, 0.1), (0.06, 0.08)])),
            gloss: 0.9,
        },
        Material::Concrete => {
            let stain = noise(103, &[(0.05, 0.06), (0.3, 0.08), (1.7, 0.10), (6.0, 0.10)]);
            let streak = octaves(seed ^ 107, along, 0.2 * up, footprint, &[(0.35, 0.08)]);
            let joint = groove(along, 4.0, 0.03, footprint);
            let foot = 0.25 * (1.0 - (point.z / 0.5)).clamp(0.0, 1.0);
            Finish {
                albedo: Rgb::new(0.36, 0.35, 0.325)
                    * ((1.0 + stain + streak - foot) * (1.0 - 0.55 * joint)),
                gloss: 0.0,
            }
        }
        Material::Cloth(rgb) => Finish {
            albedo: linear(rgb) * 0.8,
            gloss: 0.0,
        },
        Material::Plaster(rgb) => Finish {
            albedo: linear(rgb) * (1.0 + noise(127, &[(0.1, 0.06), (1.2, 0.06), (5.0, 0.08)])),
            gloss: 0.0,
        },
        Material::Foliage => {
            let leaf = noise(109, &[(0.05, 0.45), (0.18, 0.45), (0.6, 0.35), (1.8, 0.2)]);
            let hue = noise(113, &[(0.9, 0.15), (4.0, 0.25)]);
            Finish {
                albedo: Rgb::new(0.075 * (1.0 + hue), 0.105, 0.035) * (1.0 + 0.9 * leaf).max(0.08),
                gloss: 0.0,
            }
        }
    }
}

/// Share of a patch of extent `footprint` that lies in grooves of `width`, one each `period`.
fn groove(x: f64, period: f64, width: f64, footprint: f64) -> f32 {
    let from_groove = (x - (x / period).round() * period).abs();
    let overlap = 0.5 * (width + footprint) - from_groove;
    (overlap.clamp(0.0, width.min(footprint)) / footprint) as f32
}

/// Linear radiance of an sRGB colour.
fn linear(rgb: [u8; 3]) -> Rgb {
    Rgb::from(rgb.map(|byte| (f32::from(byte) / 255.0).powf(2.2)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(direct: f64) -> Light {
        Light::new(&SceneLook {
            sun_direction: Vector3::new(0.5, 0.3, 0.8),
            direct_light: direct,
            paint_wear: 0.2,
            asphalt_albedo: 0.3,
            haze_per_m: 0.002,
            wetness: 0.0,
            damage: 0.0,
            texture_seed: 5,
        })
    }

    #[test]
    fn no_material_gives_a_colour_that_is_no_number() {
        let light = light(0.7);
        let view = Vector3::new(1.0, 0.2, -0.1).normalize();
        let materials = [
            Material::CarPaint([255, 0, 3]),
            Material::Glass,
            Material::Rubber,
            Material::Reflector([200, 10, 10]),
            Material::Metal,
            Material::Concrete,
            Material::Plaster([200, 180, 150]),
            Material::Foliage,
        ];
        for (material, normal) in materials.iter().flat_map(|&m| {
            [Vector3::x(), -Vector3::x(), Vector3::z(), Vector3::y()].map(|n| (m, n))
        }) {
            let point = Point3::new(12.0, -3.0, 0.4);
            let color = light.surface(material, &point, &normal, &view, 1.0, 0.01);
            assert!(
                color.iter().all(|c| c.is_finite() && *c >= 0.0),
                "{material:?}: {color}"
            );
        }
    }

    #[test]
    fn shade_is_darker_than_sun_and_overcast_knows_no_difference() {
        let shade = |light: &Light, sunlit| {
            let point = Point3::new(4.0, 1.0, 1.0);
            let view = Vector3::x();
            light
                .surface(
                    Material::Concrete,
                    &point,
                    &Vector3::z(),
                    &view,
                    sunlit,
                    0.01,
                )
                .norm()
        };
        let (clear, overcast) = (light(1.0), light(0.0));
        assert!(shade(&clear, 0.0) < 0.6 * shade(&clear, 1.0));
        assert!((shade(&overcast, 0.0) - shade(&overcast, 1.0)).abs() < 1e-6);
    }

    #[test]
    fn far_things_take_the_colour_of_the_haze() {
        let light = light(0.7);
        assert!((light.through_haze(Rgb::zeros(), 1e5) - light.horizon).norm() < 1e-5);
        assert!(light.through_haze(Rgb::zeros(), 0.0).norm() < 1e-6);
    }
}
