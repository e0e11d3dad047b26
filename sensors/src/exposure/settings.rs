use rand::Rng;
use serde::{Deserialize, Serialize};

/// How a camera turns light into a picture. Values out of range act as the nearest that is in it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSettings {
    /// Exposure beyond what the automatic exposure chose, in stops, -4 to 4.
    pub exposure_ev: f64,
    /// Gains of red, green and blue after the automatic white balance, 0 to 4.
    pub white_balance: [f64; 3],
    /// Share of the light that is lost in the middle of the left and the right edge, 0 to 1.
    pub vignetting: f64,
    /// Standard deviation of the noise in the dark, as a share of white, 0 to 0.1.
    pub read_noise: f64,
    /// Variance of the noise that each unit of exposure adds, 0 to 0.01.
    pub shot_noise: f64,
    /// Time that the shutter is open, in seconds, 0 to 0.05; what moves is blurred by it.
    pub motion_blur_s: f64,
    /// Share of a pixel's light that falls on each of its four neighbours, 0 (sharp) to 0.25.
    pub lens_spread: f64,
    /// Share of an S-shaped curve in the tones, -1 to 1.
    pub contrast: f64,
    /// Exponent of the tones; above 1 is darker, 0.3 to 3.
    pub gamma: f64,
    /// Distance of the colours from grey as a multiple of the true one, 0 to 3.
    pub saturation: f64,
    /// Quality from 1 to 100 of the JPEG compression, with colours at half resolution; none where
    /// absent.
    pub jpeg_quality: Option<u8>,
    /// The carrier's own bonnet where the camera sees it.
    pub bonnet: Option<Bonnet>,
}

/// A car's bonnet along the lower edge of its camera's picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bonnet {
    /// Share of the picture's height that it covers at most, 0 to 0.5.
    pub height: f64,
    /// Share of that height by which it falls off towards the sides, -1 to 1.
    pub arch: f64,
    /// Column of its highest point as a share of the picture's width, 0 to 1.
    pub middle: f64,
    /// Colour as shares of white.
    pub color: [f64; 3],
    /// Brightness of the sky that it mirrors along its rim, 0 to 1.
    pub gloss: f64,
}

impl Default for CameraSettings {
    /// A good camera as in the KITTI vehicle: sharp, little noise, no compression.
    fn default() -> Self {
        Self {
            exposure_ev: 0.0,
            white_balance: [1.0; 3],
            vignetting: 0.2,
            read_noise: 0.003,
            shot_noise: 0.0002,
            motion_blur_s: 0.002,
            lens_spread: 0.10,
            contrast: 0.6,
            gamma: 1.0,
            saturation: 1.1,
            jpeg_quality: None,
            bonnet: None,
        }
    }
}

impl CameraSettings {
    /// Any camera on any car; the distributions are in `docs/randomisation.md`.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let (red, blue) = (rng.random_range(-0.12..0.12), rng.random_range(-0.12..0.12));
        let mut about_log = |low: f64, high: f64| rng.random_range(low.ln()..high.ln()).exp();
        let (read_noise, shot_noise) = (about_log(0.001, 0.01), about_log(3e-5, 8e-4));
        Self {
            exposure_ev: rng.random_range(-0.6..0.7),
            white_balance: [1.0 + red, 1.0, 1.0 + blue],
            vignetting: rng.random_range(0.0..0.4),
            read_noise,
            shot_noise,
            motion_blur_s: if rng.random_bool(0.6) {
                rng.random_range(0.0005..0.008)
            } else {
                0.0
            },
            lens_spread: rng.random_range(0.02..0.2),
            contrast: rng.random_range(0.0..1.0),
            gamma: rng.random_range(0.85..1.2),
            saturation: rng.random_range(0.7..1.6),
            jpeg_quality: rng.random_bool(0.6).then(|| rng.random_range(45..=95)),
            bonnet: rng.random_bool(0.25).then(|| Bonnet::draw(rng)),
        }
    }
}

impl Bonnet {
    fn draw(rng: &mut impl Rng) -> Self {
        let (light, hue): (f64, f64) = (rng.random_range(0.01..0.12), rng.random_range(-0.6..0.6));
        Self {
            height: rng.random_range(0.03..0.11),
            arch: rng.random_range(-0.1..0.7),
            middle: rng.random_range(0.35..0.65),
            color: [light * (1.0 + hue), light, light * (1.0 - hue)],
            gloss: rng.random_range(0.05..0.6),
        }
    }
}
