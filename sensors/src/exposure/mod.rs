mod bonnet;
mod jpeg;
mod motion;
mod settings;
mod tone;

use covista_world::CameraImage;
use rayon::prelude::*;

use self::bonnet::Overlay;
pub(crate) use self::motion::Motion;
pub use self::settings::{Bonnet, CameraSettings};
use self::tone::Tones;
use crate::appearance::Rgb;
use crate::noise::hash;

/// Radiance behind the lens and how far away it comes from, row by row from the top.
pub(crate) struct Radiance {
    pub(crate) width: usize,
    pub(crate) pixels: Vec<Rgb>,
    /// Along the optical axis; infinite in the sky.
    pub(crate) depth_m: Vec<f32>,
}

impl Radiance {
    /// What a camera with this gain makes of it; noise is drawn per row from `seed`.
    pub(crate) fn expose(
        &self,
        gain: Rgb,
        settings: &CameraSettings,
        motion: &Motion,
        seed: u64,
    ) -> CameraImage {
        let mut rgb = vec![0; 3 * self.pixels.len()];
        if !rgb.is_empty() {
            let time_s = settings.motion_blur_s.clamp(0.0, 0.05) as f32;
            let film = Film::new(self, gain, settings);
            if time_s > 0.0 {
                film.develop(&self.blurred(motion, time_s), &mut rgb, seed);
            } else {
                film.develop(&self.pixels, &mut rgb, seed);
            }
        }
        if let Some(quality) = settings.jpeg_quality {
            jpeg::compress(&mut rgb, self.width, quality);
        }
        CameraImage {
            width_px: self.width as u32,
            height_px: self.height() as u32,
            rgb,
        }
    }

    fn height(&self) -> usize {
        self.pixels.len() / self.width.max(1)
    }
}

/// Lens, sensor and tones, made ready for one picture.
struct Film {
    width: usize,
    height: usize,
    gain: Rgb,
    vignetting: f32,
    spread: f32,
    saturation: f32,
    tones: Tones,
    bonnet: Option<Overlay>,
}

impl Film {
    fn new(picture: &Radiance, gain: Rgb, settings: &CameraSettings) -> Self {
        let exposure = settings.exposure_ev.clamp(-4.0, 4.0).exp2() as f32;
        let balance = Rgb::from(
            settings
                .white_balance
                .map(|gain| gain.clamp(0.0, 4.0) as f32),
        );
        let (width, height) = (picture.width, picture.height());
        Self {
            width,
            height,
            gain: gain.component_mul(&balance) * exposure,
            vignetting: settings.vignetting.clamp(0.0, 1.0) as f32,
            spread: settings.lens_spread.clamp(0.0, 0.25) as f32,
            saturation: settings.saturation.clamp(0.0, 3.0) as f32,
            tones: Tones::new(settings),
            bonnet: settings
                .bonnet
                .as_ref()
                .map(|bonnet| Overlay::new(bonnet, width, height)),
        }
    }

    fn develop(&self, pixels: &[Rgb], rgb: &mut [u8], seed: u64) {
        let lines = rgb.par_chunks_mut(3 * self.width).enumerate();
        lines.for_each(|(row, bytes)| {
            let mut noise = Noise::new(seed, row);
            let mut line = self.exposures(&self.spread_down(pixels, row), row);
            self.tones.scale(line.as_flattened_mut());
            for (pixel, exposure) in bytes.chunks_exact_mut(3).zip(&line) {
                for ((byte, x), deviation) in pixel.iter_mut().zip(exposure).zip(noise.three()) {
                    *byte = self.tones.byte(*x, deviation);
                }
            }
        });
    }

    /// Exposures of the pixels of a row: lens, gain, bonnet and colours.
    fn exposures(&self, line: &[Rgb], row: usize) -> Vec<[f32; 3]> {
        let last = line.len() - 1;
        let bonnet = self.bonnet.as_ref();
        let bonnet = bonnet.filter(|bonnet| row >= bonnet.first_row());
        let vignette = self.vignette(row);
        let exposure = |column: usize| {
            let (left, right) = (column.saturating_sub(1), (column + 1).min(last));
            let sharp = line[column] * (1.0 - 2.0 * self.spread);
            let seen = sharp + (line[left] + line[right]) * self.spread;
            let mut color = seen.component_mul(&self.gain);
            if let Some(bonnet) = bonnet {
                color = bonnet.cover(color, row, column);
            }
            let grey = 0.25 * color.x + 0.6 * color.y + 0.15 * color.z;
            let color = Rgb::repeat(grey) + (color - Rgb::repeat(grey)) * self.saturation;
            <[f32; 3]>::from(color * vignette(column))
        };
        (0..line.len()).map(exposure).collect()
    }

    /// Vertical half of the lens's point spread.
    fn spread_down(&self, pixels: &[Rgb], row: usize) -> Vec<Rgb> {
        let line = |row: usize| &pixels[row * self.width..][..self.width];
        let (above, below) = (row.saturating_sub(1), (row + 1).min(self.height - 1));
        let others = line(above).iter().zip(line(below));
        let middle = line(row).iter().zip(others);
        middle
            .map(|(x, (a, b))| x * (1.0 - 2.0 * self.spread) + (a + b) * self.spread)
            .collect()
    }

    /// Share of the light that reaches each pixel of a row.
    fn vignette(&self, row: usize) -> impl Fn(usize) -> f32 + use<> {
        let half = 0.5 * self.width as f32;
        let y = row as f32 - 0.5 * self.height as f32;
        let loss = self.vignetting / (half * half);
        move |column| {
            let x = column as i32 as f32 - half;
            (1.0 - loss * (x * x + y * y)).max(0.0)
        }
    }
}

/// Independent nearly normal numbers for the pixels of one row.
struct Noise(u64);

impl Noise {
    fn new(seed: u64, row: usize) -> Self {
        let half = |bits: u64, salt| u64::from(hash(bits as u32, row as i32, salt));
        let state = seed ^ (half(seed, 1) << 32 | half(seed >> 32, 2));
        Self(state)
    }

    /// Three numbers of mean zero and variance one, each the sum of three of a word's parts.
    fn three(&mut self) -> [f32; 3] {
        // SplitMix64.
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut word = self.0;
        word = (word ^ (word >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        word ^= word >> 31;
        std::array::from_fn(|channel| {
            let bits = (word >> (21 * channel)) as u32 & 0x1F_FFFF;
            let sum = (bits & 127) + ((bits >> 7) & 127) + (bits >> 14);
            // Three uniform integers in 0..128 have variance 3 (128^2 - 1) / 12.
            (sum as f32 - 190.5) / 64.0
        })
    }
}

#[cfg(test)]
mod tests;
