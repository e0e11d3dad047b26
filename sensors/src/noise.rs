//! Value noise in the plane, the same on every machine.

/// A well mixed hash of a lattice point.
pub(crate) fn hash(seed: u32, x: i32, y: i32) -> u32 {
    let mut h = seed ^ (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// Uniform in [0, 1) from a lattice point.
pub(crate) fn uniform(seed: u32, x: i32, y: i32) -> f32 {
    (hash(seed, x, y) >> 8) as f32 / (1 << 24) as f32
}

/// Much faster than `f64::floor` on a machine's baseline instructions.
pub(crate) fn floor(x: f64) -> i32 {
    let towards_zero = x as i32;
    towards_zero.wrapping_sub(i32::from(f64::from(towards_zero) > x))
}

/// Smooth noise in [-1, 1] with features of size one.
pub(crate) fn value_noise(seed: u32, x: f64, y: f64) -> f32 {
    let (ix, iy) = (floor(x), floor(y));
    let smooth = |t: f64| (t * t * (3.0 - 2.0 * t)) as f32;
    let (tx, ty) = (smooth(x - f64::from(ix)), smooth(y - f64::from(iy)));
    let corner = |dx: i32, dy: i32| uniform(seed, ix.wrapping_add(dx), iy.wrapping_add(dy));
    let lower = corner(0, 0) + tx * (corner(1, 0) - corner(0, 0));
    let upper = corner(0, 1) + tx * (corner(1, 1) - corner(0, 1));
    2.0 * (lower + ty * (upper - lower)) - 1.0
}

/// Sum of octaves given as (wavelength in metres, amplitude); those finer than `footprint_m` fade.
pub(crate) fn octaves(
    seed: u32,
    x_m: f64,
    y_m: f64,
    footprint_m: f64,
    bands: &[(f64, f32)],
) -> f32 {
    bands
        .iter()
        .zip(seed..)
        .map(|(&(wavelength_m, amplitude), seed)| {
            let sharpness = (wavelength_m / footprint_m - 1.0).clamp(0.0, 1.0) as f32;
            if sharpness > 0.0 {
                let noise = value_noise(seed, x_m / wavelength_m, y_m / wavelength_m);
                sharpness * amplitude * noise
            } else {
                0.0
            }
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_bounded_continuous_and_about_centred() {
        let mut sum = 0.0;
        for i in 0..10_000 {
            let (x, y) = (0.37 * f64::from(i) - 1500.0, 0.11 * f64::from(i));
            let value = value_noise(7, x, y);
            assert!(value.abs() <= 1.0);
            assert!((value - value_noise(7, x + 1e-4, y)).abs() < 1e-2);
            sum += value;
        }
        assert!((sum / 10_000.0).abs() < 0.03);
    }

    #[test]
    fn octaves_finer_than_the_footprint_vanish() {
        assert!(octaves(1, 3.3, 4.7, 0.5, &[(0.4, 1.0)]).abs() < f32::EPSILON);
        assert!(octaves(1, 3.3, 4.7, 0.01, &[(0.4, 1.0)]).abs() > 1e-3);
    }
}
