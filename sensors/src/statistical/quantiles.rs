use serde::{Deserialize, Serialize};

/// The shares at which [`Quantiles`] are given.
pub const QUANTILE_SHARES: [f64; 9] = [0.0, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 1.0];

/// A distribution by its quantiles at [`QUANTILE_SHARES`], uniform between two of them: from the
/// least value measured, over the median, to the greatest. Tails are as heavy as measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Quantiles(pub [f64; QUANTILE_SHARES.len()]);

impl Quantiles {
    /// Those of measured values, interpolated between neighbours in order; `None` without any.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        let at = |share: f64| {
            let place = share * last as f64;
            let below = (place as usize).min(last);
            let above = (below + 1).min(last);
            values[below] + (place - below as f64) * (values[above] - values[below])
        };
        Some(Self(QUANTILE_SHARES.map(at)))
    }

    /// The value that a share `share` in [0, 1] of all values lies below.
    pub fn at(&self, share: f64) -> f64 {
        let Self(values) = self;
        let above = QUANTILE_SHARES
            .iter()
            .position(|&known| share < known)
            .unwrap_or(values.len() - 1)
            .max(1);
        let [low, high] = [QUANTILE_SHARES[above - 1], QUANTILE_SHARES[above]];
        let part = ((share - low) / (high - low)).clamp(0.0, 1.0);
        values[above - 1] + part * (values[above] - values[above - 1])
    }

    /// Whether they are numbers in ascending order within `allowed`.
    pub(super) fn are_in(&self, allowed: std::ops::RangeInclusive<f64>) -> bool {
        self.0.is_sorted() && self.0.iter().all(|value| allowed.contains(value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_known_values_are_those_of_the_definition() {
        let shuffled = (0..=1000).map(|i| f64::from(i * 5 % 1001) / 100.0);
        let found = Quantiles::of(shuffled.collect()).expect("values");
        for (value, share) in found.0.iter().zip(QUANTILE_SHARES) {
            assert!((value - 10.0 * share).abs() < 1e-9, "{share}: {value}");
        }
        for share in [0.0, 0.005, 0.3, 0.97, 1.0] {
            assert!((found.at(share) - 10.0 * share).abs() < 1e-9);
        }
        assert_eq!(Quantiles::of(vec![f64::NAN]), None);
        assert_eq!(Quantiles::of(vec![2.0]), Some(Quantiles([2.0; 9])));
    }

    #[test]
    fn what_is_out_of_order_or_no_number_is_not_in_any_range() {
        let mut quantiles = Quantiles([0.0; 9]);
        assert!(quantiles.are_in(-1.0..=1.0) && !quantiles.are_in(0.5..=1.0));
        quantiles.0[3] = f64::NAN;
        assert!(!quantiles.are_in(-1.0..=1.0));
        quantiles.0[3] = 0.5;
        assert!(!quantiles.are_in(-1.0..=1.0));
    }
}
