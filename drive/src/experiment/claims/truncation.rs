use super::claim;
use crate::{
    experiment::{Case, Claim, Figures, NetworkedGame, TruncationCase, TruncationFigures},
    networked::TruncationErrors,
};

/// What is left of Bellman's equation by a global Q that counts as exact.
const EXACT: f64 = 1e-10;
/// The weights of the others, each with its largest error.
const WEIGHTS: [fn(&TruncationErrors) -> f64; 3] = [
    |errors| errors.zeros_largest,
    |errors| errors.uniform_largest,
    |errors| errors.worst_largest,
];

type Run<'a> = (&'a TruncationCase, &'a TruncationFigures);

pub(super) fn truncation(driven: &[(Case, Figures)]) -> Vec<Claim> {
    let runs: Vec<Run<'_>> = (driven.iter())
        .filter_map(|(case, figures)| match (case, figures) {
            (Case::Truncation(case), Figures::Truncation(figures)) => Some((case, figures)),
            _ => None,
        })
        .collect();
    let [relay, traffic] = [true, false].map(|is_relay| -> Vec<Run<'_>> {
        let of = |(case, _): &&Run<'_>| (case.game == NetworkedGame::Relay) == is_relay;
        runs.iter().filter(of).copied().collect()
    });
    let mut claims = vec![
        solved(&runs),
        within(
            "the largest error is within the bound of Theorem 2 at every kappa, with every discount, seed and weights",
            &runs,
            TruncationFigures::paper_bound,
        ),
        within(
            "and within that of its proof, gamma^(floor(kappa/2) + 1) of the rewards' span over 1 - gamma",
            &runs,
            TruncationFigures::proof_bound,
        ),
        reached(&relay),
        falls(&traffic),
    ];
    claims.extend(decays(&traffic));
    claims
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.max_by(f64::total_cmp).unwrap_or(f64::NAN)
}

fn solved(runs: &[Run<'_>]) -> Claim {
    let error = largest(runs.iter().map(|(_, figures)| figures.q_error));
    claim(
        format!("the global Q is exact to {EXACT:e}"),
        format!("{error:.1e} at the most"),
        error <= EXACT,
    )
}

/// Errors as shares of a bound, at every kappa from 0 on, with all weights.
fn shares<'a>(
    (case, figures): &'a Run<'_>,
    bound: fn(&TruncationFigures, f64, usize) -> f64,
) -> impl Iterator<Item = f64> + 'a {
    figures.by_kappa.iter().flat_map(move |errors| {
        let bound = bound(figures, case.discount, errors.kappa);
        WEIGHTS.map(|error| error(errors) / bound)
    })
}

fn within(what: &str, runs: &[Run<'_>], bound: fn(&TruncationFigures, f64, usize) -> f64) -> Claim {
    let share = largest(runs.iter().flat_map(|run| shares(run, bound)));
    claim(
        what,
        format!("{:.2} % of it at the most", 100.0 * share),
        share <= 1.0 + EXACT,
    )
}

/// Of the relay, but for the kappa that holds all vehicles.
fn reached(relay: &[Run<'_>]) -> Claim {
    let least = relay.iter().flat_map(|(case, figures)| {
        let some_outside = figures
            .by_kappa
            .iter()
            .filter(|errors| 2 * errors.kappa + 1 < case.vehicles);
        some_outside
            .map(|errors| errors.zeros_largest / figures.proof_bound(case.discount, errors.kappa))
    });
    let least = least.min_by(f64::total_cmp).unwrap_or(f64::NAN);
    claim(
        "the relay reaches the proof's bound at every kappa",
        format!("{:.6} % of it at the least", 100.0 * least),
        least >= 1.0 - EXACT,
    )
}

fn falls(traffic: &[Run<'_>]) -> Claim {
    let hops = traffic.iter().flat_map(|(_, figures)| {
        let hops = figures.by_kappa.windows(2);
        hops.flat_map(|hop| WEIGHTS.map(|error| error(&hop[1]) / error(&hop[0])))
    });
    let slowest = largest(hops);
    claim(
        "in traffic the largest error falls with every hop, in every seed, with all weights",
        format!("by a factor of {slowest:.3} at the worst"),
        slowest < 1.0,
    )
}

/// The error with the worst weights decays exponentially, and faster than Theorem 2 says, with
/// each discount.
fn decays(traffic: &[Run<'_>]) -> Vec<Claim> {
    let mut discounts: Vec<f64> = traffic.iter().map(|(case, _)| case.discount).collect();
    discounts.sort_by(f64::total_cmp);
    discounts.dedup();
    let of = |discount: f64| {
        let same = traffic
            .iter()
            .filter(|(case, _)| case.discount.total_cmp(&discount).is_eq());
        let slowest = largest(same.filter_map(|(_, figures)| decay(&figures.by_kappa)));
        let most = discount.sqrt();
        claim(
            format!(
                "in traffic it decays by at most sqrt(gamma) = {most:.3} a hop at discount {discount}"
            ),
            format!("{slowest:.3} in the slowest seed"),
            slowest <= most,
        )
    };
    discounts.into_iter().map(of).collect()
}

/// The factor of a hop, by the slope of a line through the logarithms of the errors that are not 0.
fn decay(by_kappa: &[TruncationErrors]) -> Option<f64> {
    let points: Vec<(f64, f64)> = (by_kappa.iter())
        .filter(|errors| errors.worst_largest > 0.0)
        .map(|errors| (errors.kappa as f64, errors.worst_largest.ln()))
        .collect();
    let count = points.len() as f64;
    let (x, y) = points
        .iter()
        .fold((0.0, 0.0), |(x, y), point| (x + point.0, y + point.1));
    let (x, y) = (x / count, y / count);
    let product: f64 = points
        .iter()
        .map(|point| (point.0 - x) * (point.1 - y))
        .sum();
    let square: f64 = points.iter().map(|point| (point.0 - x).powi(2)).sum();
    (square > 0.0).then(|| (product / square).exp())
}
