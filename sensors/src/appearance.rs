use std::sync::LazyLock;

use covista_traffic::Material;
use nalgebra::{Point3, Vector3};

pub(crate) use crate::light::Light;
use crate::noise::uniform;
use crate::tile::Tile;

pub(crate) type Rgb = Vector3<f32>;

const SKY_SPECULAR: f32 = 0.04;

impl Light {
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

impl Finish {
    fn matt(albedo: Rgb) -> Self {
        Self { albedo, gloss: 0.0 }
    }
}

fn finish(
    material: Material,
    point: &Point3<f32>,
    normal: &Vector3<f32>,
    footprint_m: f32,
    seed: u32,
) -> Finish {
    // Coordinates on an upright surface: along it and up.
    let along = point.y * normal.x - point.x * normal.y;
    let up = point.z;
    let noise = |salt: u32, texel_m: f32| {
        let x = along + 0.37 * (point.x + point.y);
        Tile::shared().at(seed ^ salt, x, up, texel_m, footprint_m)
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
            albedo: Rgb::new(0.36, 0.37, 0.38) * (1.0 + 0.06 * noise(101, 0.05)),
            gloss: 0.9,
        },
        Material::Concrete => {
            let stain = 0.04 * noise(103, 0.03) + 0.08 * noise(105, 0.4);
            let streak = 0.06 * Tile::shared().at(seed ^ 107, along, 0.15 * up, 0.1, footprint_m);
            let joint = groove(along, 4.0, 0.03, footprint_m.max(1e-4));
            let foot = 0.25 * (1.0 - (point.z / 0.5)).clamp(0.0, 1.0);
            let tone = (1.0 + stain + streak - foot).max(0.2) * (1.0 - 0.55 * joint);
            Finish::matt(Rgb::new(0.37, 0.345, 0.305) * tone)
        }
        Material::Cloth(rgb) => Finish::matt(linear(rgb) * 0.8),
        Material::Plaster(rgb) => {
            let tone = 1.0 + 0.04 * noise(127, 0.06) + 0.06 * noise(131, 0.8);
            Finish::matt(linear(rgb) * tone.max(0.2))
        }
        Material::Foliage => {
            let leaf = 0.38 * noise(109, 0.05) + 0.25 * noise(111, 0.3);
            Finish::matt(leaves(point, seed) * (1.0 + leaf).max(0.08))
        }
    }
}

/// Colour of a crown's leaves: one for the place, fresh green to dry olive.
fn leaves(point: &Point3<f32>, seed: u32) -> Rgb {
    let dry = 1.4 * uniform(seed, 0, 113) - 0.4;
    let place = Tile::shared().at(seed ^ 113, point.x, point.y, 2.0, 2.0);
    let dry = (dry + 0.35 * place).clamp(0.0, 1.0);
    Rgb::new(0.050, 0.095, 0.022).lerp(&Rgb::new(0.135, 0.115, 0.045), dry)
}

/// Share of a patch of extent `footprint` that lies in grooves of `width`, one each `period`.
fn groove(x: f32, period: f32, width: f32, footprint: f32) -> f32 {
    let from_groove = (x - (x / period).round() * period).abs();
    let overlap = 0.5 * (width + footprint) - from_groove;
    overlap.clamp(0.0, width.min(footprint)) / footprint
}

/// Linear radiance of an sRGB colour.
fn linear(rgb: [u8; 3]) -> Rgb {
    static RADIANCES: LazyLock<[f32; 256]> =
        LazyLock::new(|| std::array::from_fn(|byte| (byte as f32 / 255.0).powf(2.2)));
    Rgb::from(rgb.map(|byte| RADIANCES[usize::from(byte)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::light;

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
}
