use std::sync::OnceLock;

use crate::noise::uniform;

const SIZE: usize = 256;
const LEVELS: usize = 8;
/// Standard deviations of the octaves with features of 1, 2, 4, ... texels.
const OCTAVES: [f32; 6] = [0.7, 0.7, 0.65, 0.6, 0.5, 0.4];
/// Averages over more texels than this are taken as zero.
const FADED_TEXELS: f32 = 100.0;

/// All levels, the finest first, fit into this many texels.
const STORED: usize = 2 * SIZE * SIZE;

/// Fractal noise of mean zero and variance one on a tile that repeats, with its averages over
/// squares of 2, 4, 8, ... texels: one look-up stands for six octaves of noise.
pub(crate) struct Tile {
    texels: Box<[f32; STORED]>,
    /// Where each level begins.
    starts: [usize; LEVELS],
}

impl Tile {
    /// The one tile, made on first use.
    pub(crate) fn shared() -> &'static Self {
        static TILE: OnceLock<Tile> = OnceLock::new();
        TILE.get_or_init(Self::new)
    }

    fn new() -> Self {
        let mut tile = Self {
            texels: Box::new([0.0; STORED]),
            starts: [0; LEVELS],
        };
        let finest = &mut tile.texels[..SIZE * SIZE];
        for (octave, &amplitude) in OCTAVES.iter().enumerate() {
            for (index, value) in finest.iter_mut().enumerate() {
                let cell = 1 << octave;
                *value += amplitude * lattice(octave as u32, index % SIZE, index / SIZE, cell);
            }
        }
        let count = finest.len() as f32;
        let mean = finest.iter().sum::<f32>() / count;
        let variance = finest.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / count;
        for value in finest {
            *value = (*value - mean) / variance.sqrt();
        }
        for level in 1..LEVELS {
            let (finer, size) = (tile.starts[level - 1], SIZE >> level);
            let start = finer + 4 * size * size;
            tile.starts[level] = start;
            for index in 0..size * size {
                let corner = finer + index / size * 4 * size + index % size * 2;
                let pair = |at: usize| tile.texels[at] + tile.texels[at + 1];
                tile.texels[start + index] = 0.25 * (pair(corner) + pair(corner + 2 * size));
            }
        }
        tile
    }

    /// The noise at a point, averaged over `footprint_m`; texels are `texel_m` wide, the pattern
    /// repeats every 256 of them.
    #[inline]
    pub(crate) fn at(&self, seed: u32, x_m: f32, y_m: f32, texel_m: f32, footprint_m: f32) -> f32 {
        let per_m = 1.0 / texel_m;
        let texels = footprint_m * per_m;
        if texels > FADED_TEXELS {
            return 0.0;
        }
        // The exponent of a floating point number is the logarithm that is wanted here.
        let level = ((texels * 1.41).max(1.0).to_bits() >> 23) - 127;
        let scale = per_m * f32::from_bits((127 - level) << 23);
        let shift = seed.wrapping_mul(0x9E37_79B1);
        let x = x_m * scale + (shift >> 24) as f32 * 0.731;
        let y = y_m * scale + (shift >> 16 & 255) as f32 * 0.731;
        self.bilinear(level as usize, x, y)
    }

    fn bilinear(&self, level: usize, x: f32, y: f32) -> f32 {
        let (start, size) = (self.starts[level % LEVELS], SIZE >> level);
        let (column, tx) = whole_and_rest(x);
        let (row, ty) = whole_and_rest(y);
        let wrapped = |i: i32| i as usize & (size - 1);
        let (left, right) = (wrapped(column), wrapped(column.wrapping_add(1)));
        let line = |row: i32| {
            let start = start + wrapped(row) * size;
            // The remainder changes nothing but tells the compiler that the index is in range.
            let texel = |column: usize| self.texels[(start + column) % STORED];
            texel(left) + tx * (texel(right) - texel(left))
        };
        let (above, below) = (line(row), line(row.wrapping_add(1)));
        above + ty * (below - above)
    }
}

/// Much faster than `f32::floor` on a machine's baseline instructions.
fn whole_and_rest(x: f32) -> (i32, f32) {
    let towards_zero = x as i32;
    let whole = towards_zero.wrapping_sub(i32::from(towards_zero as f32 > x));
    (whole, (x - whole as f32).clamp(0.0, 1.0))
}

/// Value noise with features of `cell` texels that repeats with the tile.
fn lattice(seed: u32, x: usize, y: usize, cell: usize) -> f32 {
    let cells = SIZE / cell;
    let smooth = |t: usize| {
        let t = t as f32 / cell as f32;
        t * t * (3.0 - 2.0 * t)
    };
    let corner = |dx: usize, dy: usize| {
        let (column, row) = ((x / cell + dx) % cells, (y / cell + dy) % cells);
        uniform(seed ^ 0x711E, column as i32, row as i32) - 0.5
    };
    let (tx, ty) = (smooth(x % cell), smooth(y % cell));
    let upper = corner(0, 0) + tx * (corner(1, 0) - corner(0, 0));
    let lower = corner(0, 1) + tx * (corner(1, 1) - corner(0, 1));
    upper + ty * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(footprint_m: f32) -> (f32, f32) {
        let values: Vec<f32> = (0..40_000)
            .map(|i| (0.0137 * (i % 200) as f32, 0.0137 * (i / 200) as f32))
            .map(|(x_m, y_m)| Tile::shared().at(3, x_m, y_m, 0.01, footprint_m))
            .collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        let square = values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32;
        (mean, square)
    }

    #[test]
    fn noise_is_centred_and_wider_averages_vary_less() {
        let (mean, fine) = moments(0.001);
        let coarse = moments(0.1).1;
        assert!(
            mean.abs() < 0.05 && (0.4..1.1).contains(&fine),
            "{mean} {fine}"
        );
        assert!(coarse < 0.5 * fine && coarse > 0.01, "{coarse}");
        assert!(moments(5.0).1.abs() < 1e-9);
    }

    #[test]
    fn noise_is_continuous_also_where_the_tile_repeats() {
        for i in 0..5_000 {
            let at = |x_m| Tile::shared().at(9, x_m, -3.3, 0.02, 0.0);
            let x_m = 0.0041 * i as f32 - 10.0;
            assert!((at(x_m) - at(x_m + 1e-4)).abs() < 0.05);
        }
    }
}
