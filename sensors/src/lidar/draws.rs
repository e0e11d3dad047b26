//! Random numbers of a pulse: a hash of seed, column and beam, so that no generator need be set up
//! and the order in which pulses are computed is of no matter.

/// SplitMix64 from a start of its own for each pulse.
pub(super) struct Draws(u64);

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

impl Draws {
    pub(super) fn new(seed: u64, column: u32, beam: u32) -> Self {
        let pulse = u64::from(column) << 32 | u64::from(beam);
        Self(mix(seed ^ mix(pulse.wrapping_add(GOLDEN))))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(GOLDEN);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub(super) fn uniform(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    /// Mean zero, variance one, in about the shape of a bell: the sum of four uniform numbers.
    pub(super) fn bell(&mut self) -> f32 {
        let bits = self.next();
        let sum: i32 = (0..4).map(|part| (bits >> (16 * part)) as u16 as i32).sum();
        const MIDDLE: f32 = 2.0 * 65_535.0;
        const SCALE: f32 = 1.732_050_8 / 65_536.0;
        (sum as f32 - MIDDLE) * SCALE
    }
}

fn mix(bits: u64) -> u64 {
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_draws_of_neighbouring_pulses_have_the_moments_that_they_should() {
        let (mut uniform, mut bell, mut square, mut product) = (0.0, 0.0, 0.0, 0.0);
        let count = 64 * 1000;
        for column in 0..1000 {
            let mut before = 0.0;
            for beam in 0..64 {
                let mut draws = Draws::new(7, column, beam);
                uniform += f64::from(draws.uniform());
                let drawn = f64::from(draws.bell());
                assert!(drawn.abs() < 3.5);
                bell += drawn;
                square += drawn * drawn;
                product += drawn * before;
                before = drawn;
            }
        }
        let mean = |sum: f64| sum / f64::from(count);
        assert!((mean(uniform) - 0.5).abs() < 5e-3);
        assert!(mean(bell).abs() < 0.02);
        assert!((mean(square) - 1.0).abs() < 0.02);
        assert!(mean(product).abs() < 0.02);
    }
}
