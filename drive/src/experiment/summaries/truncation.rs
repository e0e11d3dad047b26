use super::{line, quantity};
use crate::{
    experiment::{
        Case, Diagram, Figures, Key, Line, Results, Row, Spread, TruncationCase, TruncationFigures,
    },
    networked::TruncationErrors,
};

type Runs<'a> = Vec<(&'a TruncationCase, &'a TruncationFigures)>;

/// An error at one kappa beside what bounds it there.
struct Bounded<'a> {
    errors: &'a TruncationErrors,
    paper: f64,
    proof: f64,
}

/// |truncated Q - global Q| by kappa.
pub(super) fn truncation(driven: &[(Case, Figures)]) -> Results {
    let runs = runs(driven);
    let mut settings: Vec<(&str, f64)> = Vec::new();
    for (case, _) in &runs {
        let setting = (case.game.name(), case.discount);
        if !settings.contains(&setting) {
            settings.push(setting);
        }
    }
    let mut rows = Vec::new();
    for &(game, discount) in &settings {
        let of = |(case, _): &&(&TruncationCase, _)| is_of(case, game, discount);
        let of: Runs<'_> = runs.iter().filter(of).copied().collect();
        let largest_kappa = of.iter().map(|(_, figures)| figures.by_kappa.len()).max();
        for kappa in 0..largest_kappa.unwrap_or(0) {
            rows.push(row(game, discount, kappa, &of));
        }
    }
    let mut discounts: Vec<f64> = settings.iter().map(|&(_, discount)| discount).collect();
    discounts.sort_by(f64::total_cmp);
    discounts.dedup();
    Results {
        diagrams: (discounts.iter())
            .map(|&discount| diagram(&runs, discount))
            .collect(),
        notes: notes(),
        rows,
        claims: Vec::new(),
    }
}

fn runs(driven: &[(Case, Figures)]) -> Runs<'_> {
    let of = driven
        .iter()
        .filter_map(|(case, figures)| match (case, figures) {
            (Case::Truncation(case), Figures::Truncation(figures)) => Some((case, figures)),
            _ => None,
        });
    of.collect()
}

fn is_of(case: &TruncationCase, game: &str, discount: f64) -> bool {
    case.game.name() == game && case.discount.total_cmp(&discount).is_eq()
}

fn row(game: &str, discount: f64, kappa: usize, runs: &Runs<'_>) -> Row {
    let bounded: Vec<Bounded<'_>> = (runs.iter())
        .filter_map(|(case, figures)| {
            Some(Bounded {
                errors: figures.by_kappa.get(kappa)?,
                paper: figures.paper_bound(case.discount, kappa),
                proof: figures.proof_bound(case.discount, kappa),
            })
        })
        .collect();
    let bounded: Vec<&Bounded<'_>> = bounded.iter().collect();
    let of = |named, value: fn(&Bounded<'_>) -> f64| {
        quantity(named, &bounded, |run| Some(value(run)), None)
    };
    Row {
        keys: vec![
            ("game", Key::Text(game.to_owned())),
            ("discount", Key::Number(discount)),
            ("kappa", Key::Number(kappa as f64)),
        ],
        seeds: bounded.len(),
        quantities: vec![
            of(("error_zeros", "error, zeros", 4), |run| {
                run.errors.zeros_largest
            }),
            of(("error_uniform", "uniform", 4), |run| {
                run.errors.uniform_largest
            }),
            of(("error_worst", "worst weights", 4), |run| {
                run.errors.worst_largest
            }),
            of(("bound_theorem_2", "Theorem 2", 4), |run| run.paper),
            of(("bound_proof", "its proof", 4), |run| run.proof),
            of(("mean_error_zeros", "mean error, zeros", 4), |run| {
                run.errors.zeros_mean
            }),
            of(("mean_error_uniform", "uniform", 4), |run| {
                run.errors.uniform_mean
            }),
            of(("greedy_wrong_percent", "greedy wrong, %", 2), |run| {
                100.0 * run.errors.greedy_wrong
            }),
            of(("greedy_loss_largest", "its largest loss", 4), |run| {
                run.errors.greedy_loss_largest
            }),
        ],
    }
}

/// All errors and bounds of one discount as powers of ten; what is 0 has none.
fn diagram(runs: &Runs<'_>, discount: f64) -> Diagram {
    let errors = |label: &str, game: &str, value: fn(&TruncationErrors) -> f64| {
        let of = runs.iter().filter(|(case, _)| is_of(case, game, discount));
        let of: Vec<_> = of.map(|(_, figures)| &figures.by_kappa).collect();
        over_kappa(
            label,
            of.iter()
                .map(|errors| errors.iter().map(value).collect())
                .collect(),
        )
    };
    let any = runs
        .iter()
        .find(|(case, _)| case.discount.total_cmp(&discount).is_eq());
    let bound = |label: &str, value: fn(&TruncationFigures, f64, usize) -> f64| {
        let of = any.map(|(_, figures)| {
            (0..figures.by_kappa.len())
                .map(|kappa| value(figures, discount, kappa))
                .collect()
        });
        over_kappa(label, of.into_iter().collect())
    };
    Diagram {
        title: format!("Discount {discount}"),
        x: "kappa, hops".to_owned(),
        y: "log10 of the largest error".to_owned(),
        lines: vec![
            bound("bound of Theorem 2", TruncationFigures::paper_bound),
            bound("bound of its proof", TruncationFigures::proof_bound),
            errors("relay, zeros", "relay", |errors| errors.zeros_largest),
            errors("traffic, worst weights", "traffic", |errors| {
                errors.worst_largest
            }),
            errors("traffic, zeros", "traffic", |errors| errors.zeros_largest),
            errors("traffic, uniform", "traffic", |errors| {
                errors.uniform_largest
            }),
        ],
    }
}

/// Powers of ten over kappa, the mean over `runs`.
fn over_kappa(label: &str, runs: Vec<Vec<f64>>) -> Line {
    let longest = runs.iter().map(Vec::len).max().unwrap_or(0);
    let point = |kappa: usize| {
        let values = runs.iter().filter_map(|run| Some(run.get(kappa)?.log10()));
        let spread = Spread::of(values.filter(|power| power.is_finite()))?;
        Some([kappa as f64, spread.mean, spread.std])
    };
    line(label, (0..longest).filter_map(point).collect())
}

fn notes() -> Vec<String> {
    vec![
        "Errors are the largest of |truncated Q^i - global Q^i| over all joint states and actions and all vehicles i, but for the two columns of means. Zeros: the others stand and wait (the paper's definition); uniform: the mean over their states and actions; worst weights: the two completions farthest apart, which bounds any weights.".into(),
        "Theorem 2 is rbar / (1 - gamma) gamma^(kappa/2) for rewards of at most rbar. Its proof needs rewards between 0 and rbar (in general their span for rbar: with rewards below 0 the bound as worded fails), and gives gamma^(floor(kappa/2) + 1), which is less: by gamma at even kappa, by its square root at odd. The relay reaches that, so nothing better holds of all such games.".into(),
        "Greedy wrong: the share of all (s, a of the others) in which a vehicle's better own action by the truncated Q is not the better one by the global; its largest loss in units of Q.".into(),
    ]
}
