//! The camera's image to the lane network's input: bilinear resize and normalisation.

use covista_world::CameraImage;

/// One sample along an axis: `(1 - weight) * source[low] + weight * source[high]`.
#[derive(Debug, Clone, Copy)]
struct Tap {
    low: usize,
    high: usize,
    weight: f32,
}

/// Resizes with pixel centres aligned, `source = (target + 0.5) * scale - 0.5`, without
/// antialiasing, and normalises to `(value / 255 - mean) / std`.
#[derive(Debug)]
pub struct Resize {
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    source_width: usize,
    scale: [f32; 3],
    offset: [f32; 3],
    row: Vec<f32>,
    planes: Vec<f32>,
}

impl Resize {
    /// From and to (width, height) in pixels, with mean and standard deviation of r, g, b.
    pub fn new(from: [usize; 2], to: [usize; 2], mean: [f32; 3], std: [f32; 3]) -> Self {
        Self {
            columns: taps(from[0], to[0]),
            rows: taps(from[1], to[1]),
            source_width: from[0],
            scale: std.map(|std| 1.0 / (255.0 * std)),
            offset: std::array::from_fn(|channel| -mean[channel] / std[channel]),
            row: vec![0.0; 3 * from[0]],
            planes: vec![0.0; 3 * to[0] * to[1]],
        }
    }

    /// The network's input [3, height, width], channel by channel, of an image of the size that
    /// was named at the start.
    pub fn apply(&mut self, image: &CameraImage) -> &[f32] {
        let stride = 3 * self.source_width;
        let width = self.columns.len();
        let (red, rest) = self.planes.split_at_mut(self.rows.len() * width);
        let (green, blue) = rest.split_at_mut(self.rows.len() * width);
        for (y, tap) in self.rows.iter().enumerate() {
            let low = &image.rgb[tap.low * stride..][..stride];
            let high = &image.rgb[tap.high * stride..][..stride];
            for ((value, &low), &high) in self.row.iter_mut().zip(low).zip(high) {
                *value = mix(f32::from(low), f32::from(high), tap.weight);
            }
            let start = y * width;
            for (x, tap) in self.columns.iter().enumerate() {
                let [low, high] = [
                    &self.row[3 * tap.low..][..3],
                    &self.row[3 * tap.high..][..3],
                ];
                let normal = |channel: usize| {
                    mix(low[channel], high[channel], tap.weight) * self.scale[channel]
                        + self.offset[channel]
                };
                red[start + x] = normal(0);
                green[start + x] = normal(1);
                blue[start + x] = normal(2);
            }
        }
        &self.planes
    }
}

fn mix(low: f32, high: f32, weight: f32) -> f32 {
    low + weight * (high - low)
}

fn taps(from: usize, to: usize) -> Vec<Tap> {
    let scale = from as f64 / to as f64;
    (0..to)
        .map(|target| {
            let source = ((target as f64 + 0.5) * scale - 0.5).max(0.0);
            let low = (source as usize).min(from - 1);
            Tap {
                low,
                high: (low + 1).min(from - 1),
                weight: (source - low as f64) as f32,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp() {
        // u of the source pixel's centre is in red, v in green, a constant in blue.
        let (width, height) = (62, 20);
        let rgb = (0..height)
            .flat_map(|v| (0..width).flat_map(move |u| [u as u8, v as u8, 255]))
            .collect();
        let image = CameraImage {
            width_px: width,
            height_px: height,
            rgb,
        };
        let mut resize = Resize::new([62, 20], [40, 16], [0.0, 0.0, 0.5], [1.0, 1.0, 0.25]);
        let planes = resize.apply(&image).to_vec();
        for y in 0..16 {
            for x in 0..40 {
                let at = |channel: usize| f64::from(planes[(channel * 16 + y) * 40 + x]);
                let u = ((x as f64 + 0.5) * 62.0 / 40.0 - 0.5).clamp(0.0, 61.0);
                let v = ((y as f64 + 0.5) * 20.0 / 16.0 - 0.5).clamp(0.0, 19.0);
                assert!((at(0) * 255.0 - u).abs() < 1e-4);
                assert!((at(1) * 255.0 - v).abs() < 1e-4);
                assert!((at(2) - 2.0).abs() < 1e-6);
            }
        }
    }
}
