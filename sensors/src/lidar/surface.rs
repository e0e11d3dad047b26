//! What a surface does to a pulse. The figures are fitted to KITTI's sweeps.

use covista_traffic::Material;

use super::strip::Ground;

/// A surface in the light of the LIDAR.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surface {
    /// Reflectance straight on.
    pub(super) albedo: f32,
    /// Share of the light that a surface seen at a grazing angle still sends back.
    pub(super) rough: f32,
    /// Mean depth that a pulse goes in, in metres.
    pub(super) depth_m: f32,
    /// Share of pulses that find a gap.
    pub(super) gaps: f32,
}

impl Surface {
    const fn solid(albedo: f32, rough: f32) -> Self {
        Self {
            albedo,
            rough,
            depth_m: 0.0,
            gaps: 0.0,
        }
    }

    pub(super) fn of(material: Material) -> Self {
        match material {
            // Clear coat mirrors: dark paint seen from the side sends hardly anything back.
            Material::CarPaint(rgb) => Self::solid(0.03 + 0.58 * brightness(rgb), 0.3),
            Material::Glass => Self::solid(0.12, 0.1),
            Material::Rubber => Self::solid(0.06, 0.5),
            Material::Reflector(_) => Self::solid(30.0, 1.0),
            Material::Metal => Self::solid(0.40, 0.4),
            Material::Concrete => Self::solid(0.42, 0.6),
            Material::Plaster(rgb) => Self::solid(0.22 + 0.32 * brightness(rgb), 0.6),
            Material::Cloth(rgb) => Self::solid(0.15 + 0.35 * brightness(rgb), 0.7),
            Material::Foliage => Self {
                albedo: 0.48,
                rough: 0.8,
                depth_m: 0.35,
                gaps: 0.25,
            },
        }
    }

    /// The ground, under a film of water for the share `wetness`: the film mirrors a grazing pulse
    /// away.
    pub(super) fn of_ground(ground: Ground, wetness: f32) -> Self {
        let dry = match ground {
            Ground::Asphalt(albedo) | Ground::Paint(albedo) => Self::solid(albedo, 0.33),
            Ground::Grass => return Self::solid(0.43, 0.5),
        };
        Self {
            albedo: dry.albedo * (1.0 - 0.4 * wetness),
            rough: dry.rough * (1.0 - 0.9 * wetness),
            ..dry
        }
    }

    /// Share of the light sent back where the pulse comes in at this angle.
    pub(super) fn facing(&self, cos_incidence: f32) -> f32 {
        self.rough + (1.0 - self.rough) * cos_incidence.clamp(0.0, 1.0)
    }
}

/// Brightness of a colour to the eye, in [0, 1]: infrared differs less between paints than light.
fn brightness(rgb: [u8; 3]) -> f32 {
    let [red, green, blue] = rgb.map(|channel| f32::from(channel) / 255.0);
    0.3 * red + 0.6 * green + 0.1 * blue
}
