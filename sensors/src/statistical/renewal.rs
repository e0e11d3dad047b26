//! Random numbers that last: each is kept for a while and then drawn anew.

/// Frames closer together than this get the same draw.
const STEP_S: f64 = 0.05;

/// A uniform number in [0, 1) of its own for each key and time: a renewal process, drawn anew at
/// random times, on average every `lasting_s`.
///
/// At every time it is uniform, and any function of it has the autocorrelation exp(-lag /
/// `lasting_s`), as a process of first order has. It is a hash of key and time: neither what was
/// drawn before nor the order of the draws matters.
pub(super) fn lasting_uniform(key: u64, time_s: f64, lasting_s: f64) -> f64 {
    let now = (time_s / STEP_S).round() as i64;
    let renewal_share = if lasting_s > 0.0 {
        1.0 - (-STEP_S / lasting_s).exp()
    } else {
        1.0
    };
    // The chance to look farther back than this is exp(-20).
    let farthest = (20.0 * lasting_s / STEP_S).ceil() as i64;
    let renewed = (0..farthest)
        .map(|back| now - back)
        .find(|&step| uniform(mix(key ^ mix(step as u64))) < renewal_share)
        .unwrap_or(now - farthest);
    uniform(mix(key.wrapping_add(GOLDEN) ^ mix(renewed as u64)))
}

/// One key of many numbers.
pub(super) fn key(parts: &[u64]) -> u64 {
    parts
        .iter()
        .fold(GOLDEN, |key, &part| mix(key.wrapping_add(GOLDEN) ^ part))
}

/// Uniform in [0, 1).
pub(super) fn uniform(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// SplitMix64's finaliser.
pub(super) fn mix(bits: u64) -> u64 {
    let bits = bits.wrapping_add(GOLDEN);
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEYS: u64 = 20_000;

    /// Mean over keys of a function of the draws at two times.
    fn mean(lag_s: f64, lasting_s: f64, of: impl Fn(f64, f64) -> f64) -> f64 {
        let draws = (0..KEYS).map(|index| {
            let key = key(&[7, index]);
            let [first, second] =
                [3.2, 3.2 + lag_s].map(|time_s| lasting_uniform(key, time_s, lasting_s));
            of(first, second)
        });
        draws.sum::<f64>() / KEYS as f64
    }

    #[test]
    fn draws_are_uniform_and_their_autocorrelation_is_that_of_a_process_of_first_order() {
        assert!((mean(0.0, 0.8, |u, _| u) - 0.5).abs() < 0.01);
        assert!((mean(0.0, 0.8, |u, _| f64::from(u < 0.1)) - 0.1).abs() < 0.01);
        for (lag_s, lasting_s) in [(0.4, 0.8), (0.8, 0.8), (0.4, 2.0), (0.4, 0.0), (0.4, 0.1)] {
            let correlation = 12.0 * mean(lag_s, lasting_s, |u, v| (u - 0.5) * (v - 0.5));
            let expected = if lasting_s > 0.0 {
                (-lag_s / lasting_s).exp()
            } else {
                0.0
            };
            assert!(
                (correlation - expected).abs() < 0.03,
                "{lag_s} {lasting_s}: {correlation} instead of {expected}"
            );
        }
    }

    #[test]
    fn neighbouring_keys_have_nothing_in_common() {
        let product: f64 = (0..KEYS)
            .map(|index| {
                let draw = |index| lasting_uniform(key(&[1, index, 3]), 1.0, 1.0) - 0.5;
                draw(index) * draw(index + 1)
            })
            .sum();
        assert!((12.0 * product / KEYS as f64).abs() < 0.03);
    }
}
