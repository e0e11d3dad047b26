use covista_world::CameraImage;
use rand::{RngCore, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::appearance::Rgb;

/// Weight of each direct neighbour in the lens's point spread.
const SPREAD: f32 = 0.12;
const VIGNETTE: f32 = 0.28;
const READ_NOISE: f32 = 0.003;
/// Variance of the shot noise per exposure.
const SHOT_NOISE: f32 = 0.0002;
/// Share of an S-shaped curve in the tones.
const CONTRAST: f32 = 0.6;
const BRIGHTEST: f32 = 4.0;
const TONES: usize = 4096;

/// Radiance behind the lens, row by row from the top.
pub(crate) struct Radiance {
    pub(crate) width: usize,
    pub(crate) pixels: Vec<Rgb>,
}

impl Radiance {
    /// What a sensor with this gain makes of it; noise is drawn per row from `seed`.
    pub(crate) fn expose(&self, gain: Rgb, seed: u64) -> CameraImage {
        let tones = tone_curve();
        let mut rgb = vec![0; 3 * self.pixels.len()];
        rgb.par_chunks_mut((3 * self.width).max(3))
            .enumerate()
            .for_each(|(row, bytes)| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(row as u64);
                let exposure = |column| {
                    let color = self.spread(row, column) * self.vignette(row, column);
                    color.component_mul(&gain)
                };
                for (column, pixel) in bytes.chunks_exact_mut(3).enumerate() {
                    let noise = three_normals(rng.next_u64());
                    let color = exposure(column);
                    for (channel, byte) in pixel.iter_mut().enumerate() {
                        let x = color[channel];
                        let sigma = (READ_NOISE * READ_NOISE + SHOT_NOISE * x).sqrt();
                        let noisy = (x + sigma * noise[channel]).clamp(0.0, BRIGHTEST);
                        let tone = (noisy / BRIGHTEST).sqrt() * (TONES - 1) as f32;
                        *byte = tones[tone as usize];
                    }
                }
            });
        CameraImage {
            width_px: self.width as u32,
            height_px: (self.pixels.len() / self.width.max(1)) as u32,
            rgb,
        }
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// Separable point spread over 3x3 pixels.
    fn spread(&self, row: usize, column: usize) -> Rgb {
        let (up, down) = (row.saturating_sub(1), (row + 1).min(self.height() - 1));
        let (left, right) = (column.saturating_sub(1), (column + 1).min(self.width - 1));
        let across = |row: usize| {
            let line = &self.pixels[row * self.width..(row + 1) * self.width];
            line[column] * (1.0 - 2.0 * SPREAD) + (line[left] + line[right]) * SPREAD
        };
        across(row) * (1.0 - 2.0 * SPREAD) + (across(up) + across(down)) * SPREAD
    }

    fn vignette(&self, row: usize, column: usize) -> f32 {
        let half = 0.5 * self.width as f32;
        let (x, y) = (
            column as f32 - half,
            row as f32 - 0.5 * self.height() as f32,
        );
        1.0 - VIGNETTE * (x * x + y * y) / (half * half)
    }
}

/// Film-like shoulder, sRGB, more contrast; indexed by the square root of the exposure.
fn tone_curve() -> Vec<u8> {
    (0..TONES)
        .map(|i| {
            let x = BRIGHTEST * (i as f32 / (TONES - 1) as f32).powi(2);
            let y = 1.0 - (-1.5 * x).exp();
            let srgb = if y <= 0.003_130_8 {
                12.92 * y
            } else {
                1.055 * y.powf(1.0 / 2.4) - 0.055
            };
            let contrast = srgb * srgb * (3.0 - 2.0 * srgb);
            (255.0 * (srgb + CONTRAST * (contrast - srgb))).round() as u8
        })
        .collect()
}

/// Three nearly normal numbers, each from the sum of three of the word's bytes-like parts.
fn three_normals(word: u64) -> [f32; 3] {
    std::array::from_fn(|channel| {
        let bits = (word >> (21 * channel)) & 0x1F_FFFF;
        let sum = (bits & 127) + ((bits >> 7) & 127) + (bits >> 14);
        // Three uniform integers in 0..128 have variance 3 (128^2 - 1) / 12.
        (sum as f32 - 190.5) / 64.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_zero_and_variance_one() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let draws: Vec<f32> = (0..20_000)
            .flat_map(|_| three_normals(rng.next_u64()))
            .collect();
        let mean = draws.iter().sum::<f32>() / draws.len() as f32;
        let variance = draws.iter().map(|x| x * x).sum::<f32>() / draws.len() as f32;
        assert!(
            mean.abs() < 0.02 && (variance - 1.0).abs() < 0.03,
            "{mean} {variance}"
        );
    }

    #[test]
    fn tones_rise_from_black() {
        let tones = tone_curve();
        assert!(tones[0] == 0 && tones[TONES - 1] > 250);
        assert!(tones.is_sorted());
    }
}
