use covista_perception::Sorted;

/// Wall times in seconds, by turn: whatever else the machine does meets all who take turns alike.
pub(super) type Turns = Vec<Vec<f64>>;

/// The times of all turns.
pub(super) fn sorted(turns: &Turns) -> Sorted {
    turns.iter().flatten().copied().collect()
}

/// How many times as fast `ours` are as `theirs`: the median over the rounds, whose turns followed
/// each other.
pub(super) fn speed_ratio(ours: &Turns, theirs: &Turns) -> f64 {
    let median = |turn: &Vec<f64>| turn.iter().copied().collect::<Sorted>().median();
    let ratios = ours
        .iter()
        .zip(theirs)
        .map(|(ours, theirs)| median(theirs) / median(ours));
    ratios.collect::<Sorted>().median()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_the_median_over_rounds_so_that_a_slow_one_does_not_count() {
        let ours = vec![vec![1.0, 1.0], vec![10.0, 10.0], vec![1.0, 2.0, 1.0]];
        let theirs = vec![vec![2.0, 2.0], vec![2.0, 2.0], vec![3.0, 3.0, 3.0]];
        assert!((speed_ratio(&ours, &theirs) - 2.0).abs() < 1e-12);
    }
}
