use serde::Serialize;

/// One quantity over several seeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// How many values there are.
    pub count: usize,
    /// Their mean.
    pub mean: f64,
    /// Their standard deviation (that of a sample); 0 for one value.
    pub std: f64,
    /// The least.
    pub least: f64,
    /// The most.
    pub most: f64,
}

impl Spread {
    /// Of these values; `None` of no value.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let count = values.len();
        let (least, most) = (
            values.iter().copied().min_by(f64::total_cmp)?,
            values.iter().copied().max_by(f64::total_cmp)?,
        );
        let mean = values.iter().sum::<f64>() / count as f64;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        Some(Self {
            count,
            mean,
            std: (squares / (count - 1).max(1) as f64).sqrt(),
            least,
            most,
        })
    }
}

/// Spearman's rank correlation of pairs; values alike share the mean of their ranks. `None` where
/// one of both never changes.
pub fn rank_correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let of = |side: fn(&(f64, f64)) -> f64| ranks(&pairs.iter().map(side).collect::<Vec<_>>());
    let (x, y) = (of(|pair| pair.0), of(|pair| pair.1));
    let middle = (pairs.len() as f64 - 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| -> f64 {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - middle) * (b - middle))
            .sum()
    };
    let spread = (product(&x, &x) * product(&y, &y)).sqrt();
    (spread > 0.0).then(|| product(&x, &y) / spread)
}

fn ranks(values: &[f64]) -> Vec<f64> {
    let rank = |value: &f64| {
        let below = values
            .iter()
            .filter(|other| other.total_cmp(value).is_lt())
            .count();
        let alike = values
            .iter()
            .filter(|other| other.total_cmp(value).is_eq())
            .count();
        below as f64 + (alike as f64 - 1.0) / 2.0
    };
    values.iter().map(rank).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_spread_of_a_sample() {
        let spread = Spread::of([2.0, 4.0, 4.0, 6.0]).expect("values");
        assert!((spread.mean - 4.0).abs() < 1e-12);
        assert!((spread.std - (8.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!((spread.count, spread.least, spread.most), (4, 2.0, 6.0));
        assert!(Spread::of([3.0]).is_some_and(|one| one.std == 0.0));
        assert_eq!(Spread::of([]), None);
    }

    #[test]
    fn ranks_count_not_values() {
        let correlation = |y: &[f64]| {
            let pairs: Vec<_> = (0..y.len()).map(|i| (i as f64, y[i])).collect();
            rank_correlation(&pairs)
        };
        let near = |found: Option<f64>, expected: f64| {
            assert!(
                found.is_some_and(|found| (found - expected).abs() < 1e-12),
                "{found:?}"
            );
        };
        near(correlation(&[1.0, 10.0, 100.0, 101.0]), 1.0);
        near(correlation(&[3.0, 2.0, 1.0]), -1.0);
        // 1 - 6 * 2 / (4 * 15), two neighbours changed places.
        near(correlation(&[1.0, 3.0, 2.0, 4.0]), 0.8);
        // Ties: ranks 0, 1.5, 1.5, 3.
        near(correlation(&[1.0, 2.0, 2.0, 4.0]), 0.948_683_298_050_513_8);
        assert_eq!(correlation(&[5.0, 5.0, 5.0]), None);
        assert_eq!(correlation(&[]), None);
    }
}
