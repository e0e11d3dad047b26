use super::settings::CameraSettings;

const BRIGHTEST: f32 = 4.0;
const TONES: usize = 4096;
const HIGHEST: f32 = (TONES - 1) as f32;

/// Tables indexed by the square root of the exposure.
pub(super) struct Tones {
    bytes: Box<[u8; TONES]>,
    /// Standard deviation of the index.
    noise: Box<[f32; TONES]>,
}

impl Tones {
    pub(super) fn new(settings: &CameraSettings) -> Self {
        let read = settings.read_noise.clamp(0.0, 0.1) as f32;
        let shot = settings.shot_noise.clamp(0.0, 0.01) as f32;
        let contrast = settings.contrast.clamp(-1.0, 1.0) as f32;
        let gamma = settings.gamma.clamp(0.3, 3.0) as f32;
        let exposure = |index: usize| BRIGHTEST * (index as f32 / (TONES - 1) as f32).powi(2);
        let noise = |index: usize| {
            let x = exposure(index);
            let noisier = x + (read * read + shot * x).sqrt();
            (TONES - 1) as f32 * (noisier / BRIGHTEST).sqrt() - index as f32
        };
        Self {
            bytes: Box::new(std::array::from_fn(|index| {
                byte(exposure(index), contrast, gamma)
            })),
            noise: Box::new(std::array::from_fn(noise)),
        }
    }

    /// Turns exposures into places in the tables.
    pub(super) fn scale(&self, exposures: &mut [f32]) {
        for x in exposures {
            *x = (*x * (1.0 / BRIGHTEST)).clamp(0.0, 1.0).sqrt() * HIGHEST;
        }
    }

    /// The picture's value at a place in the tables with this deviation from it.
    pub(super) fn byte(&self, place: f32, deviation: f32) -> u8 {
        let noisy = place + deviation * self.noise[nearest(place)];
        self.bytes[nearest(noisy.clamp(0.0, HIGHEST))]
    }
}

/// The whole number nearest to `place`, which lies between 0 and [`HIGHEST`]; much faster than a
/// cast that has to saturate.
fn nearest(place: f32) -> usize {
    // From 2^23 on the last bits of a floating point number count ones.
    (place + 8_388_608.0).to_bits() as usize % TONES
}

/// Film-like shoulder, sRGB, gamma, more contrast.
fn byte(exposure: f32, contrast: f32, gamma: f32) -> u8 {
    let y = 1.0 - (-1.5 * exposure).exp();
    let srgb = if y <= 0.003_130_8 {
        12.92 * y
    } else {
        1.055 * y.powf(1.0 / 2.4) - 0.055
    };
    let tone = srgb.max(0.0).powf(gamma);
    let steeper = tone * tone * (3.0 - 2.0 * tone);
    (255.0 * (tone + contrast * (steeper - tone))).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tones_rise_from_black() {
        for contrast in [-1.0, 0.0, 1.0] {
            let settings = CameraSettings {
                contrast,
                ..CameraSettings::default()
            };
            let tones = Tones::new(&settings).bytes;
            assert!(tones[0] == 0 && tones[TONES - 1] > 250);
            assert!(tones.is_sorted());
        }
    }
}
