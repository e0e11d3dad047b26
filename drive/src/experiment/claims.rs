//! What an experiment should show, and whether it does.

mod truncation;

use std::collections::BTreeMap;

use super::{Case, Claim, Experiment, Figures, Row, SceneFigures, Spread, rank_correlation};

/// The paper's loss against MADDPG with the safe action mapping, in percent.
const PAPER_LOSS: [(&str, &str, f64); 2] = [
    ("mean_velocity_mph", "velocity", 6.0),
    ("mean_comfort", "comfort", 3.9),
];
/// Above this CAV ratio learning should show, and up to this density traffic is light.
const FEW: f64 = 0.3;
const LEAST_CORRELATION: f64 = 0.9;
/// P_safe.
const SAFE_DISTANCE_M: f64 = covista_traffic::SAFE_DISTANCE_M;

/// The claims about the rows of a whole experiment.
pub(super) fn of(experiment: Experiment, rows: &[Row], driven: &[(Case, Figures)]) -> Vec<Claim> {
    match experiment {
        Experiment::CavRatio => cav_ratio(rows),
        Experiment::Density => density(rows),
        Experiment::Safety => safety(rows),
        Experiment::Headway => headway(rows),
        Experiment::EpisodeReward => episode_reward(rows),
        Experiment::ActionDesign => action_design(rows),
        Experiment::ObstacleAtCorner => obstacle_at_corner(rows, driven),
        Experiment::Truncation => truncation::truncation(driven),
    }
}

fn claim(claim: impl Into<String>, found: impl Into<String>, holds: bool) -> Claim {
    Claim {
        claim: claim.into(),
        found: found.into(),
        holds,
    }
}

fn is_of(row: &Row, algorithm: &str) -> bool {
    row.text("algorithm") == Some(algorithm)
}

/// A quantity of an algorithm over a key, in the order of the rows.
fn course(rows: &[Row], algorithm: &str, key: &str, name: &str) -> Vec<(f64, Spread)> {
    let of = rows.iter().filter(|row| is_of(row, algorithm));
    of.filter_map(|row| Some((row.number(key)?, row.get(name)?.spread?)))
        .collect()
}

fn means(course: &[(f64, Spread)]) -> Vec<(f64, f64)> {
    course
        .iter()
        .map(|(at, spread)| (*at, spread.mean))
        .collect()
}

/// Where both have a value.
fn beside(one: &[(f64, Spread)], other: &[(f64, Spread)]) -> Vec<(f64, f64, f64)> {
    let pair = |&(at, of): &(f64, Spread)| {
        let (_, beside) = other.iter().find(|(place, _)| (place - at).abs() < 1e-9)?;
        Some((at, of.mean, beside.mean))
    };
    one.iter().filter_map(pair).collect()
}

fn cav_ratio(rows: &[Row]) -> Vec<Claim> {
    let mut claims = Vec::new();
    let of = |algorithm, name| course(rows, algorithm, "cav_ratio", name);
    for (name, what, loss) in PAPER_LOSS {
        let ours = of("ours", name);
        let correlation = rank_correlation(&means(&ours)).unwrap_or(0.0);
        claims.push(claim(
            format!("{what} of all traffic rises with the CAV ratio: rank correlation of at least {LEAST_CORRELATION}"),
            format!("{correlation:.3}"),
            correlation >= LEAST_CORRELATION,
        ));
        if let (Some((_, first)), Some((_, last))) = (ours.first(), ours.last()) {
            let (risen, spread) = (last.mean - first.mean, first.std + last.std);
            claims.push(claim(
                format!(
                    "{what}: the ends lie apart by more than both standard deviations together"
                ),
                format!("{risen:.3} against {spread:.3}"),
                risen > spread,
            ));
        }
        if let Some(&(at, ours, theirs)) = beside(&ours, &of("maddpg-mapped", name)).last() {
            let lost = 100.0 * (theirs - ours) / theirs;
            claims.push(claim(
                format!("{what} at CAV ratio {at}: at most {loss} % below MADDPG with the mapping"),
                format!("{lost:.2} %"),
                lost <= loss,
            ));
        }
        for other in ["keep-lane", "random-safe"] {
            let pairs = beside(&ours, &of(other, name));
            let mixed: Vec<_> = pairs.iter().filter(|(at, ..)| *at > FEW).collect();
            let least = mixed.iter().map(|(_, ours, theirs)| ours - theirs);
            let least = least.min_by(f64::total_cmp).unwrap_or(f64::NAN);
            claims.push(claim(
                format!("{what}: better than {other} at every CAV ratio above {FEW}"),
                format!("{least:+.3} at the worst"),
                least > 0.0,
            ));
        }
    }
    claims
}

fn density(rows: &[Row]) -> Vec<Claim> {
    let of = |algorithm, name| course(rows, algorithm, "density", name);
    let pairs = beside(&of("ours", "flow"), &of("idm", "flow"));
    let worst = |is_light: bool| {
        let shares = pairs
            .iter()
            .filter(|(rho, ..)| (*rho <= FEW + 1e-9) == is_light);
        let shares = shares.map(|(_, ours, theirs)| 100.0 * ours / theirs);
        shares.min_by(f64::total_cmp).unwrap_or(f64::NAN)
    };
    let (light, dense) = (worst(true), worst(false));
    vec![
        claim(
            format!("flow of at least IDM's up to density {FEW}"),
            format!("{light:.1} % of it at the worst"),
            light >= 100.0,
        ),
        claim(
            format!("flow of at least 95 % of IDM's above density {FEW}"),
            format!("{dense:.1} % of it at the worst"),
            dense >= 95.0,
        ),
    ]
}

fn safety(rows: &[Row]) -> Vec<Claim> {
    let of = |algorithm, name| course(rows, algorithm, "density", name);
    let most = |algorithm, name| {
        let all = of(algorithm, name)
            .into_iter()
            .map(|(_, spread)| spread.most);
        all.max_by(f64::total_cmp).unwrap_or(f64::NAN)
    };
    let both = |name| [most("ours", name), most("ours, exploring", name)];
    let none = |found: [f64; 2]| found.into_iter().all(|most| most < 0.5);
    let told =
        |[driving, exploring]: [f64; 2]| format!("{driving} at the most, exploring {exploring}");
    let (unsafe_actions, unattributed) = (both("unsafe_actions"), both("violations_unattributed"));
    let baseline = of("maddpg, exploring", "unsafe_actions");
    let least = baseline.iter().map(|(_, spread)| spread.least);
    let least = least.min_by(f64::total_cmp).unwrap_or(f64::NAN);
    let growth = rank_correlation(&means(&baseline)).unwrap_or(0.0);
    vec![
        claim(
            "ours takes no unsafe action at any density",
            told(unsafe_actions),
            none(unsafe_actions),
        ),
        claim(
            "ours has no violation without a broken assumption at any density",
            told(unattributed),
            none(unattributed),
        ),
        claim(
            "MADDPG takes unsafe actions at every density, exploring as at the end of its training",
            format!("{least} at the least"),
            least > 0.0,
        ),
        claim(
            format!(
                "and the more the denser it is: rank correlation of at least {LEAST_CORRELATION}"
            ),
            format!("{growth:.3}"),
            growth >= LEAST_CORRELATION,
        ),
    ]
}

fn headway(rows: &[Row]) -> Vec<Claim> {
    let least = |algorithm, name| {
        let row = rows.iter().find(|row| is_of(row, algorithm));
        let spread = row.and_then(|row| row.get(name)?.spread);
        spread.map_or(f64::NAN, |spread| spread.least)
    };
    let cavs = least("ours", "min_cav_headway_m");
    let (ours, theirs) = (
        least("ours", "min_headway_m"),
        least("maddpg", "min_headway_m"),
    );
    vec![
        claim(
            format!(
                "at the ends of behaviour steps no CAV of ours is nearer than {SAFE_DISTANCE_M} m to the vehicle ahead"
            ),
            format!("{cavs:.2} m at the least"),
            cavs >= SAFE_DISTANCE_M,
        ),
        claim(
            "the least headway of all vehicles is larger than with MADDPG",
            format!("{ours:.2} m against {theirs:.2} m"),
            ours > theirs,
        ),
    ]
}

fn episode_reward(rows: &[Row]) -> Vec<Claim> {
    let of = |algorithm, name| {
        let row = rows.iter().find(|row| is_of(row, algorithm));
        row.and_then(|row| row.get(name)?.spread)
    };
    let mean = |algorithm| of(algorithm, "largest_reward").map_or(f64::NAN, |spread| spread.mean);
    let [ours, theirs] = ["ours", "maddpg"].map(mean);
    let most = |name| of("ours", name).map_or(f64::NAN, |spread| spread.most);
    let unsafe_actions = most("unsafe_actions_training");
    let unattributed = most("violations_unattributed_training");
    vec![
        claim(
            "ours reaches the larger reward",
            format!("{ours:.1} against {theirs:.1}"),
            ours > theirs,
        ),
        claim(
            "ours takes no unsafe action in training",
            format!("{unsafe_actions} at the most"),
            unsafe_actions < 0.5,
        ),
        claim(
            "ours has no violation without a broken assumption in training",
            format!("{unattributed} at the most"),
            unattributed < 0.5,
        ),
    ]
}

/// Measures of smoothness, the less the smoother.
const ROUGHNESS: [(&str, &str); 8] = [
    ("lateral_accel_rms_mps2", "RMS lateral acceleration"),
    ("lateral_accel_p99_mps2", "p99 lateral acceleration"),
    ("lateral_jerk_rms_mps3", "RMS lateral jerk"),
    ("lateral_jerk_p99_mps3", "p99 lateral jerk"),
    ("heading_rms_deg", "RMS heading against the road"),
    ("heading_rate_rms_degps", "RMS heading rate"),
    ("steering_reversals_per_km", "steering reversals a km"),
    (
        "lateral_way_m_per_km",
        "way to the side beyond lane changes",
    ),
];

fn action_design(rows: &[Row]) -> Vec<Claim> {
    let mean = |algorithm, name| {
        let row = rows.iter().find(|row| is_of(row, algorithm));
        let spread = row.and_then(|row| row.get(name)?.spread);
        spread.map_or(f64::NAN, |spread| spread.mean)
    };
    let smoother = ROUGHNESS.iter().map(|&(name, what)| {
        let [ours, filtered, alone] =
            ["ours", "end-to-end", "end-to-end-unfiltered"].map(|of| mean(of, name));
        claim(
            format!("{what}: less with behaviours and a controller than end to end"),
            format!("{ours:.3} against {filtered:.3} behind the filter and {alone:.3} without it"),
            ours < filtered && ours < alone,
        )
    });
    let unattributed = |algorithm| {
        let row = rows.iter().find(|row| is_of(row, algorithm));
        let spread = row.and_then(|row| row.get("violations_unattributed")?.spread);
        spread.map_or(f64::NAN, |spread| spread.most)
    };
    let (ours, theirs) = (unattributed("ours"), unattributed("end-to-end"));
    let safe = claim(
        "behind the filter, neither has a violation without a broken assumption",
        format!("{ours} and {theirs}"),
        ours + theirs < 0.5,
    );
    smoother.chain([safe]).collect()
}

fn obstacle_at_corner(rows: &[Row], driven: &[(Case, Figures)]) -> Vec<Claim> {
    let mut by_seed: BTreeMap<u64, [Option<&SceneFigures>; 2]> = BTreeMap::new();
    for (case, figures) in driven {
        if let (Case::Scene(case), Figures::Scene(figures)) = (case, figures) {
            by_seed.entry(case.seed).or_default()[usize::from(case.sharing)] = Some(figures);
        }
    }
    let is_fewer = |pair: &&[Option<&SceneFigures>; 2]| match pair {
        [Some(off), Some(on)] => on.vehicles_stuck < off.vehicles_stuck,
        _ => false,
    };
    let fewer = by_seed.values().filter(is_fewer).count();
    let delay = |sharing: &str| {
        let row = rows.iter().find(|row| row.text("sharing") == Some(sharing));
        let spread = row.and_then(|row| row.get("blocked_delay_s")?.spread);
        spread.map_or(f64::NAN, |spread| spread.mean)
    };
    let (on, off) = (delay("on"), delay("off"));
    vec![
        claim(
            "sharing leaves fewer vehicles stuck with every seed",
            format!("with {fewer} of {}", by_seed.len()),
            fewer == by_seed.len() && fewer > 0,
        ),
        claim(
            "sharing cuts the delay behind the obstacle by half or more",
            format!("{on:.2} s against {off:.2} s"),
            on <= off / 2.0,
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::{Key, Quantity};

    fn rows(name: &'static str, key: &'static str, of: &[(&str, f64, f64)]) -> Vec<Row> {
        let row = |&(algorithm, at, value): &(&str, f64, f64)| Row {
            keys: vec![
                ("algorithm", Key::Text(algorithm.to_owned())),
                (key, Key::Number(at)),
            ],
            seeds: 1,
            quantities: vec![Quantity {
                name,
                title: name,
                spread: Spread::of([value]),
                paper: None,
                digits: 1,
            }],
        };
        of.iter().map(row).collect()
    }

    fn holds(claims: &[Claim]) -> Vec<bool> {
        claims.iter().map(|claim| claim.holds).collect()
    }

    #[test]
    fn flow_is_compared_with_idm_at_light_and_at_dense_traffic() {
        let table = |light: f64, dense: f64| {
            let of = [
                ("ours", 0.3, light),
                ("ours", 0.9, dense),
                ("idm", 0.3, 10.0),
                ("idm", 0.9, 10.0),
            ];
            holds(&density(&rows("flow", "density", &of)))
        };
        assert_eq!(table(10.1, 9.6), [true, true]);
        assert_eq!(table(9.9, 9.4), [false, false]);
    }

    #[test]
    fn one_unsafe_action_breaks_the_claim_and_none_of_maddpg_too() {
        let table = |ours: f64, theirs: [f64; 3]| {
            let mut of = vec![("ours", 0.1, 0.0), ("ours, exploring", 0.1, ours)];
            of.extend(
                [0.1, 0.2, 0.3]
                    .into_iter()
                    .zip(theirs)
                    .map(|(rho, n)| ("maddpg, exploring", rho, n)),
            );
            let [none, _, some, more] = safety(&rows("unsafe_actions", "density", &of))
                .try_into()
                .map(|claims: [Claim; 4]| claims.map(|claim| claim.holds))
                .expect("four claims");
            [none, some, more]
        };
        assert_eq!(table(0.0, [1.0, 2.0, 9.0]), [true, true, true]);
        assert_eq!(table(1.0, [1.0, 0.0, 9.0]), [false, false, false]);
    }

    #[test]
    fn what_is_not_there_does_not_hold() {
        for experiment in Experiment::ALL {
            let claims = of(experiment, &[], &[]);
            assert!(
                !holds(&claims).contains(&true),
                "{experiment:?}: {claims:?}"
            );
        }
    }
}
