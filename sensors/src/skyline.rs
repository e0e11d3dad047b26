use nalgebra::Vector3;

use crate::appearance::Rgb;
use crate::light::Light;
use crate::noise::{floor, uniform};
use crate::tile::Tile;

/// Haze lies before the land as thick as before something at this distance.
const HAZE_M: f32 = 300.0;

/// The land at the horizon: a far ridge and what stands before it.
pub(crate) struct Skyline {
    layers: [Layer; 2],
    seed: u32,
}

/// Heights are the z of a unit vector, widths are in radians.
#[derive(Clone, Copy)]
struct Layer {
    height: f32,
    relief: f32,
    texel_rad: f32,
    /// Houses are this wide; hills and woods have none.
    house_rad: Option<f64>,
    albedo: Rgb,
    /// Variation of the brightness.
    contrast: f32,
    /// Share of the air's colour before it.
    air: f32,
}

impl Layer {
    fn top(&self) -> f32 {
        self.height + 3.5 * self.relief
    }
}

impl Skyline {
    pub(crate) fn new(seed: u32) -> Self {
        let draw = |index: i32| uniform(seed ^ 0x5C1E, index, 2);
        let hills = Layer {
            height: 0.005 + 0.07 * draw(0) * draw(0),
            relief: 0.004 + 0.016 * draw(1),
            texel_rad: 0.02 + 0.03 * draw(2),
            house_rad: None,
            albedo: Rgb::new(0.06, 0.07, 0.04).lerp(&Rgb::new(0.26, 0.19, 0.10), draw(3)),
            contrast: 0.25,
            air: 0.35 + 0.45 * draw(4),
        };
        let woods = Layer {
            height: 0.006 + 0.03 * draw(5) * draw(5),
            relief: 0.002 + 0.005 * draw(6),
            texel_rad: 0.003 + 0.004 * draw(7),
            house_rad: None,
            albedo: Rgb::new(0.025, 0.05, 0.018).lerp(&Rgb::new(0.08, 0.075, 0.035), draw(8)),
            contrast: 0.55,
            air: 0.05 + 0.3 * draw(9),
        };
        let city = Layer {
            relief: 0.002 + 0.008 * draw(6),
            house_rad: Some(0.008 + 0.025 * f64::from(draw(7))),
            albedo: Rgb::new(0.16, 0.15, 0.14).lerp(&Rgb::new(0.32, 0.26, 0.2), draw(8)),
            ..woods
        };
        let near = if draw(10) < 0.25 { city } else { woods };
        Self {
            layers: [hills, near],
            seed,
        }
    }

    /// The sky's colour in this direction, or that of the land before it.
    pub(crate) fn before(&self, sky: Rgb, direction: &Vector3<f32>, light: &Light) -> Rgb {
        let top = self.layers[0].top().max(self.layers[1].top());
        if direction.z > top {
            return sky;
        }
        let level = direction.xy().norm().max(1e-6);
        let around = [direction.x / level, direction.y / level];
        let mut color = sky;
        for (layer, seed) in self.layers.iter().zip(self.seed..) {
            let (height, shade) = layer.at(around, direction.z, seed);
            let share = ((height - direction.z) / 0.0015).clamp(0.0, 1.0);
            if share > 0.0 {
                let near = light.open_ground().component_mul(&layer.albedo) * shade;
                let land = light.through_haze(near.lerp(&light.horizon, layer.air), HAZE_M);
                color = color.lerp(&land, share);
            }
        }
        color
    }
}

impl Layer {
    /// Height of the layer in a direction, and its brightness at elevation `z` there.
    fn at(&self, around: [f32; 2], z: f32, seed: u32) -> (f32, f32) {
        let [x, y] = around;
        let tile = Tile::shared();
        match self.house_rad {
            Some(width_rad) => {
                let house = floor(f64::from(y.atan2(x)) / width_rad);
                let tall = uniform(seed ^ 0xC17, house, 0);
                let shade = 1.0 + self.contrast * (2.0 * uniform(seed ^ 0xC17, house, 1) - 1.0);
                (self.height + 3.0 * self.relief * tall * tall * tall, shade)
            }
            None => {
                let relief = tile.at(seed, x, y, self.texel_rad, 0.0);
                let shade = tile.at(
                    seed ^ 5,
                    x + 2.3 * z,
                    y - 3.1 * z,
                    0.3 * self.texel_rad,
                    0.002,
                );
                (
                    self.height + self.relief * relief,
                    (1.0 + self.contrast * shade).max(0.2),
                )
            }
        }
    }
}
