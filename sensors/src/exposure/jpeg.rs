use std::f32::consts::PI;
use std::sync::OnceLock;

use rayon::prelude::*;

const SIDE: usize = 8;
/// Pixels to a side that share their colour difference.
const UNIT: usize = 2 * SIDE;

type Block = [[f32; SIDE]; SIDE];

/// The tables of annex K of the JPEG standard, for quality 50, row by row.
const LUMA: [u8; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56,
    14, 17, 22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113,
    92, 49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
];
const CHROMA: [u8; 64] = [
    17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99,
    47, 66, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
];

/// Replaces a picture by what is left of it after JPEG compression with this quality, 1 to 100,
/// and colour differences at half the resolution.
pub(super) fn compress(rgb: &mut [u8], width: usize, quality: u8) {
    if width == 0 {
        return;
    }
    let [luma, chroma] = [LUMA, CHROMA].map(|table| Steps::new(&table, quality));
    rgb.par_chunks_mut(3 * width * UNIT).for_each(|band| {
        for left in (0..width).step_by(UNIT) {
            Unit::read(band, width, left)
                .quantised(&luma, &chroma)
                .write(band, width, left);
        }
    });
}

/// Quantisation steps and their inverses.
struct Steps {
    steps: Block,
    inverses: Block,
}

impl Steps {
    fn new(table: &[u8; 64], quality: u8) -> Self {
        let quality = i32::from(quality.clamp(1, 100));
        let percent = if quality < 50 {
            5000 / quality
        } else {
            200 - 2 * quality
        };
        let step = |row: usize, column: usize| {
            let base = i32::from(table[row * SIDE + column]);
            ((base * percent + 50) / 100).clamp(1, 255) as f32
        };
        let steps = std::array::from_fn(|row| std::array::from_fn(|column| step(row, column)));
        Self {
            steps,
            inverses: steps.map(|row: [f32; SIDE]| row.map(f32::recip)),
        }
    }

    /// A block after the way to whole multiples of the steps and back.
    fn round_trip(&self, block: &Block) -> Block {
        let (cosines, transposed) = transforms();
        let mut frequencies = product(&product(cosines, block), transposed);
        for (line, (steps, inverses)) in frequencies
            .iter_mut()
            .zip(self.steps.iter().zip(&self.inverses))
        {
            for (x, (step, inverse)) in line.iter_mut().zip(steps.iter().zip(inverses)) {
                *x = round(*x * inverse) * step;
            }
        }
        product(&product(transposed, &frequencies), cosines)
    }
}

/// Sixteen by sixteen pixels: four blocks of brightness, one of either colour difference.
struct Unit {
    luma: [Block; 4],
    chroma: [Block; 2],
}

impl Unit {
    /// The unit from column `left` on; beyond the picture its edge goes on.
    fn read(band: &[u8], width: usize, left: usize) -> Self {
        let height = band.len() / (3 * width);
        let mut unit = Self {
            luma: [[[0.0; SIDE]; SIDE]; 4],
            chroma: [[[0.0; SIDE]; SIDE]; 2],
        };
        for y in 0..UNIT {
            let line = &band[3 * width * y.min(height - 1)..][..3 * width];
            for x in 0..UNIT {
                let pixel = &line[3 * (left + x).min(width - 1)..][..3];
                let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(f32::from);
                let luma = 0.299 * r + 0.587 * g + 0.114 * b;
                unit.luma[y / SIDE * 2 + x / SIDE][y % SIDE][x % SIDE] = luma - 128.0;
                unit.chroma[0][y / 2][x / 2] += 0.25 * 0.564 * (b - luma);
                unit.chroma[1][y / 2][x / 2] += 0.25 * 0.713 * (r - luma);
            }
        }
        unit
    }

    fn quantised(&self, luma: &Steps, chroma: &Steps) -> Self {
        Self {
            luma: self.luma.each_ref().map(|block| luma.round_trip(block)),
            chroma: self.chroma.each_ref().map(|block| chroma.round_trip(block)),
        }
    }

    fn write(&self, band: &mut [u8], width: usize, left: usize) {
        let wide = UNIT.min(width - left);
        for (y, line) in band.chunks_exact_mut(3 * width).enumerate() {
            let pixels = line[3 * left..][..3 * wide].chunks_exact_mut(3);
            for (x, pixel) in pixels.enumerate() {
                let luma = self.luma[y / SIDE * 2 + x / SIDE][y % SIDE][x % SIDE] + 128.5;
                let [blue, red] = self.chroma.each_ref().map(|block| block[y / 2][x / 2]);
                pixel[0] = (luma + 1.402 * red) as u8;
                pixel[1] = (luma - 0.344 * blue - 0.714 * red) as u8;
                pixel[2] = (luma + 1.772 * blue) as u8;
            }
        }
    }
}

/// The matrix of the discrete cosine transform and its transpose, which is its inverse.
fn transforms() -> &'static (Block, Block) {
    static MATRICES: OnceLock<(Block, Block)> = OnceLock::new();
    MATRICES.get_or_init(|| {
        let cosine = |frequency: usize, at: usize| {
            let scale = if frequency == 0 { 0.125_f32 } else { 0.25 };
            scale.sqrt() * (PI / 16.0 * (frequency * (2 * at + 1)) as f32).cos()
        };
        let matrix = |pick: &dyn Fn(usize, usize) -> f32| -> Block {
            std::array::from_fn(|row| std::array::from_fn(|column| pick(row, column)))
        };
        (
            matrix(&|row, column| cosine(row, column)),
            matrix(&|row, column| cosine(column, row)),
        )
    })
}

fn product(a: &Block, b: &Block) -> Block {
    std::array::from_fn(|row| {
        let mut line = [0.0; SIDE];
        for (factor, other) in a[row].iter().zip(b) {
            for (sum, x) in line.iter_mut().zip(other) {
                *sum += factor * x;
            }
        }
        line
    })
}

/// The nearest whole number of a number below four million.
fn round(x: f32) -> f32 {
    const WHOLE: f32 = 12_582_912.0;
    (x + WHOLE) - WHOLE
}

#[cfg(test)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;

    use super::*;

    const WIDTH: usize = 83;
    const HEIGHT: usize = 45;

    /// Smooth colours with an edge across.
    fn picture() -> Vec<u8> {
        (0..WIDTH * HEIGHT)
            .map(|index| (index % WIDTH, index / WIDTH))
            .flat_map(|(x, y)| {
                let edge = if 2 * x > 40 + y { 90 } else { 0 };
                [40 + x + edge, 60 + 2 * y, 30 + x / 2 + y].map(|value| value as u8)
            })
            .collect()
    }

    fn error(a: &[u8], b: &[u8]) -> f64 {
        let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
        (a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64).sqrt()
    }

    fn compressed(quality: u8) -> Vec<u8> {
        let mut rgb = picture();
        compress(&mut rgb, WIDTH, quality);
        rgb
    }

    #[test]
    fn lower_quality_leaves_less() {
        let errors = [100, 90, 60, 20].map(|quality| error(&compressed(quality), &picture()));
        assert!(errors.is_sorted(), "{errors:?}");
        assert!(errors[0] < 6.0 && errors[3] > 4.0, "{errors:?}");
    }

    #[test]
    fn grey_of_the_best_quality_stays_as_it_is() {
        let mut rgb = vec![77; 3 * WIDTH * HEIGHT];
        compress(&mut rgb, WIDTH, 100);
        assert!(rgb.iter().all(|&byte| byte == 77));
    }

    #[test]
    fn a_true_codec_leaves_the_same_greys() -> Result<(), image::ImageError> {
        let mut grey = picture();
        for pixel in grey.chunks_exact_mut(3) {
            pixel.fill(pixel[0]);
        }
        for quality in [90, 60, 30] {
            let mut file = Vec::new();
            JpegEncoder::new_with_quality(&mut file, quality).encode(
                &grey,
                WIDTH as u32,
                HEIGHT as u32,
                image::ExtendedColorType::Rgb8,
            )?;
            let theirs = image::load_from_memory(&file)?.to_rgb8().into_raw();
            let mut ours = grey.clone();
            compress(&mut ours, WIDTH, quality);
            let apart = error(&ours, &theirs);
            assert!(apart < 1.5, "{quality}: {apart}");
        }
        Ok(())
    }
}
