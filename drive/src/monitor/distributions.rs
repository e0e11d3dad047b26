use covista_world::STEP_S;

/// Counts of a quantity at or above zero, in bins of equal width.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    bins_per_unit: f64,
    bins: Vec<u64>,
    beyond: u64,
}

impl Histogram {
    fn new(bins_per_unit: f64, bins: usize) -> Self {
        Self {
            bins_per_unit,
            bins: vec![0; bins],
            beyond: 0,
        }
    }

    /// Takes `value` in; what is below zero or no number counts as zero.
    fn add(&mut self, value: f64) {
        match self.bins.get_mut((value * self.bins_per_unit) as usize) {
            Some(bin) => *bin += 1,
            None => self.beyond += 1,
        }
    }

    /// How many values it holds.
    pub fn count(&self) -> u64 {
        self.bins.iter().sum::<u64>() + self.beyond
    }

    /// The value that a share of `p` in [0, 1] of all values lies at or below: the upper edge of
    /// its bin, and the end of the last bin for what lies beyond it. `None` while it is empty.
    pub fn quantile(&self, p: f64) -> Option<f64> {
        let count = self.count();
        let rank = ((p * count as f64).ceil() as u64).max(1);
        let mut sum = 0;
        let bin = self.bins.iter().position(|bin| {
            sum += bin;
            sum >= rank
        });
        let bins = bin.map_or(self.bins.len(), |bin| bin + 1);
        (count > 0).then_some(bins as f64 / self.bins_per_unit)
    }

    /// How many values lie below `limit`, a whole number of bins.
    pub fn below(&self, limit: f64) -> u64 {
        let bins = (limit * self.bins_per_unit).round() as usize;
        self.bins.iter().take(bins).sum()
    }
}

/// Steps over which acceleration is averaged before jerk is taken of it (0.1 s).
///
/// Over one step of 0.01 s the difference would show the controller's sampling alone: any braking
/// begins within one step, and W_v alone would make 100 m/s^3.
const JERK_STEPS: u32 = 10;

/// How near CAVs came in time, and how roughly they drove.
#[derive(Debug, Clone, PartialEq)]
pub struct Distributions {
    /// Time to collision of CAVs in seconds, to 0.05 s up to 60 s: bumper gap by closing speed, to
    /// the vehicle ahead in their lanes that is nearest in time, at each step on which it closes.
    pub ttc_s: Histogram,
    /// |jerk| of CAVs in m/s^3, to 0.1 m/s^3 up to 200 m/s^3: from one mean acceleration over
    /// 0.1 s to the next.
    pub jerk_mps3: Histogram,
}

impl Distributions {
    pub(super) fn new() -> Self {
        Self {
            ttc_s: Histogram::new(20.0, 1200),
            jerk_mps3: Histogram::new(10.0, 2000),
        }
    }

    pub(super) fn note_ttc(&mut self, ttc_s: f64) {
        self.ttc_s.add(ttc_s);
    }

    pub(super) fn note_jerk(&mut self, jerk_mps3: f64) {
        self.jerk_mps3.add(jerk_mps3.abs());
    }
}

/// Takes the jerk from one vehicle's speed, step by step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct JerkMeter {
    steps: u32,
    speed_mps: Option<f64>,
    accel_mps2: Option<f64>,
}

impl JerkMeter {
    /// The jerk in m/s^3, where this step of 0.01 s completes one more average.
    pub fn step(&mut self, speed_mps: f64) -> Option<f64> {
        let due = self.steps.is_multiple_of(JERK_STEPS);
        self.steps = self.steps.wrapping_add(1);
        if !due {
            return None;
        }
        let window_s = f64::from(JERK_STEPS) * STEP_S;
        let before_mps = self.speed_mps.replace(speed_mps)?;
        let accel_mps2 = (speed_mps - before_mps) / window_s;
        let before_mps2 = self.accel_mps2.replace(accel_mps2)?;
        Some((accel_mps2 - before_mps2) / window_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_values() {
        let mut histogram = Histogram::new(10.0, 1000);
        assert_eq!(histogram.quantile(0.5), None);
        (0..100).for_each(|i| histogram.add(f64::from(i) + 0.05));
        for (p, value) in [(0.01, 0.1), (0.05, 4.1), (0.5, 49.1), (0.99, 98.1)] {
            let found = histogram.quantile(p).expect("some value");
            assert!((found - value).abs() < 1e-9, "{p}: {found}");
        }
        assert_eq!((histogram.below(10.0), histogram.count()), (10, 100));
        histogram.add(1e9);
        assert_eq!(histogram.quantile(1.0), Some(100.0));
        histogram.add(f64::NAN);
        assert_eq!(histogram.below(0.1), 2);
    }

    #[test]
    fn constant_jerk_is_found_and_constant_acceleration_has_none() {
        let (mut steady, mut rising) = (JerkMeter::default(), JerkMeter::default());
        for step in 0..100 {
            let t = f64::from(step) * STEP_S;
            if let Some(jerk) = steady.step(20.0 - 3.0 * t) {
                assert!(jerk.abs() < 1e-9);
            }
            if let Some(jerk) = rising.step(20.0 + 2.0 * t * t) {
                assert!((jerk - 4.0).abs() < 1e-9);
            }
        }
    }
}
