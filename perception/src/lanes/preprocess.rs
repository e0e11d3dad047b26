//! The camera's image to the lane network's input: bilinear resize and normalisation.

#[cfg(target_arch = "x86_64")]
mod avx2;

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
    /// Of each channel `(value * scale) + offset`.
    normal: [[f32; 2]; 3],
    row: Vec<f32>,
    #[cfg(target_arch = "x86_64")]
    groups: Option<avx2::Groups>,
}

impl Resize {
    /// From and to (width, height) in pixels, with mean and standard deviation of r, g, b.
    pub fn new(from: [usize; 2], to: [usize; 2], mean: [f32; 3], std: [f32; 3]) -> Self {
        let columns = taps(from[0], to[0]);
        Self {
            #[cfg(target_arch = "x86_64")]
            groups: avx2::Groups::new(&columns, from[0]),
            columns,
            rows: taps(from[1], to[1]),
            source_width: from[0],
            normal: std::array::from_fn(|channel| {
                let std = std[channel];
                [1.0 / (255.0 * std), -mean[channel] / std]
            }),
            row: vec![0.0; 3 * from[0]],
        }
    }

    /// Writes the network's input [3, height, width], channel by channel, of an image of the size
    /// that was named at the start.
    pub fn apply(&mut self, image: &CameraImage, input: &mut [f32]) {
        let stride = 3 * self.source_width;
        let width = self.columns.len();
        let (red, rest) = input.split_at_mut(self.rows.len() * width);
        let (green, blue) = rest.split_at_mut(self.rows.len() * width);
        for (y, tap) in self.rows.iter().enumerate() {
            let source = [tap.low, tap.high].map(|row| &image.rgb[row * stride..][..stride]);
            let target =
                [&mut *red, &mut *green, &mut *blue].map(|plane| &mut plane[y * width..][..width]);
            #[cfg(target_arch = "x86_64")]
            if let Some(groups) = &mut self.groups {
                groups.apply(source, tap.weight, self.normal, target);
                continue;
            }
            mix_rows(source, tap.weight, &mut self.row);
            mix_columns(&self.row, &self.columns, self.normal, target);
        }
    }
}

fn mix_rows([low, high]: [&[u8]; 2], weight: f32, row: &mut [f32]) {
    for ((value, &low), &high) in row.iter_mut().zip(low).zip(high) {
        *value = mix(low.into(), high.into(), weight);
    }
}

fn mix_columns(row: &[f32], columns: &[Tap], normal: [[f32; 2]; 3], target: [&mut [f32]; 3]) {
    let [red, green, blue] = target;
    for (x, tap) in columns.iter().enumerate() {
        let [low, high] = [tap.low, tap.high].map(|pixel| &row[3 * pixel..][..3]);
        let normal = |channel: usize| {
            let [scale, offset] = normal[channel];
            mix(low[channel], high[channel], tap.weight) * scale + offset
        };
        red[x] = normal(0);
        green[x] = normal(1);
        blue[x] = normal(2);
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
        let mut planes = vec![0.0; 3 * 16 * 40];
        resize.apply(&image, &mut planes);
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

    /// A number from 0 to 255 for each place, without a pattern.
    fn noise(width: usize, height: usize) -> CameraImage {
        let hash = |at: usize| (at.wrapping_mul(0x9E37_79B9) >> 13) as u8;
        CameraImage {
            width_px: width as u32,
            height_px: height as u32,
            rgb: (0..3 * width * height).map(hash).collect(),
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn eight_at_a_time_are_the_same_bits_as_one_by_one() {
        // The shipped network's sizes, up and down, equal sizes, and steps that reach the limit.
        for (from, to) in [
            ([1242, 375], [800, 288]),
            ([62, 20], [80, 31]),
            ([40, 7], [40, 7]),
            ([29, 9], [16, 3]),
            ([1, 1], [8, 2]),
        ] {
            let image = noise(from[0], from[1]);
            let mut resize = Resize::new(from, to, [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]);
            let apply = |resize: &mut Resize| {
                let mut planes = vec![0.0; 3 * to[0] * to[1]];
                resize.apply(&image, &mut planes);
                planes.into_iter().map(f32::to_bits).collect::<Vec<_>>()
            };
            assert_eq!(resize.groups.is_some(), is_x86_feature_detected!("avx2"));
            let fast = apply(&mut resize);
            resize.groups = None;
            assert_eq!(fast, apply(&mut resize), "{from:?} {to:?}");
        }
        // Too far apart, and no whole groups.
        for to in [[8, 4], [60, 4]] {
            assert!(avx2::Groups::new(&taps(62, to[0]), 62).is_none());
        }
    }
}
