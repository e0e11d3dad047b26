use super::settings::CameraSettings;

const BRIGHTEST: f32 = 4.0;
const TONES: usize = 4096;

/// Tables indexed by the square root of the exposure.
pub(super) struct Tones {
    bytes: Vec<u8>,
    /// Standard deviation of the index.
    noise: Vec<f32>,
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
            bytes: (0..TONES)
                .map(|index| byte(exposure(index), contrast, gamma))
                .collect(),
            noise: (0..TONES).map(noise).collect(),
        }
    }

    /// The picture's value for an exposure with this deviation from it.
    pub(super) fn byte(&self, exposure: f32, deviation: f32) -> u8 {
        let highest = (TONES - 1) as f32;
        let index = (exposure * (1.0 / BRIGHTEST)).clamp(0.0, 1.0).sqrt() * highest;
        let noisy = index + deviation * self.noise[index as usize];
        self.bytes[noisy.clamp(0.0, highest) as usize]
    }
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
