use covista_control::{ControlSettings, SafetySettings};
use rayon::prelude::*;

use super::{
    CampaignError, CampaignSpec, Family, Nominals, PlantModel, Tally,
    cases::{COVERS, CoverCase},
    exact::closed_m,
    run_families,
};

/// A candidate is thrown out after one of these parts of the steps where it fails early.
const SCREEN_PARTS: [u64; 2] = [32, 8];
/// The smallest W_p is looked for in these parts of what is enough by the derivation.
const POSITION_NOTCHES: u32 = 8;
/// Slip is tried in these steps, in rad, this many times.
const SLIP_NOTCH_RAD: f64 = 4e-3;
const SLIP_NOTCHES: u32 = 15;

/// Which noise bounds cover a plant unlike the model, and what they cost. Lanes are kept, not
/// changed.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantCover {
    /// The plant.
    pub case: CoverCase,
    /// eta, with which all of it was run.
    pub eta: f64,
    /// What the default bounds find: how wrong the model is.
    pub with_defaults: Tally,
    /// W_p in metres that is enough by the derivation.
    pub position_m: f64,
    /// Whether with it no headway is broken and nothing is hit.
    pub keeps_headway: bool,
    /// The smallest W_p with which that was found; where there is none, the same behind moving
    /// leaders alone, where nothing comes into sight.
    pub smallest_position_m: Option<f64>,
    /// Bound on slip in rad with which no corner leaves its lane.
    pub across: Option<f64>,
    /// The same when nothing but the controller's own reference is asked for.
    pub across_own: Option<f64>,
    /// What the bounds that cover it find in a campaign that was not searched with.
    pub covered: Option<Tally>,
    /// How much farther from a leader of the same steady speed it stays with that W_p, in metres,
    /// at 15 and 30 m/s.
    pub headway_cost_m: [f64; 2],
}

/// The campaigns of one plant.
struct Search<'a> {
    plant: PlantModel,
    control: &'a ControlSettings,
    seed: u64,
    steps: u64,
}

impl Search<'_> {
    fn run(
        &self,
        safety: SafetySettings,
        families: &[Family],
        nominal: Nominals,
    ) -> Result<Tally, CampaignError> {
        let spec = CampaignSpec {
            seed: self.seed,
            steps: self.steps,
            control: ControlSettings {
                safety,
                ..*self.control
            },
            broken: None,
            nominal,
            plant: self.plant,
        };
        let mut all = Tally::default();
        for (_, tally) in run_families(&spec, families, &|_| {})? {
            all.add(&tally);
        }
        Ok(all)
    }

    /// The first of `candidates` that holds in a short campaign, the whole one and another.
    fn first(
        &self,
        candidates: impl Iterator<Item = SafetySettings>,
        families: &[Family],
        nominal: Nominals,
        holds: fn(&Tally) -> bool,
    ) -> Result<Option<SafetySettings>, CampaignError> {
        let [first, second] = SCREEN_PARTS.map(|part| self.steps.div_ceil(part));
        let stages = [
            (self.seed, first),
            (self.seed, second),
            (self.seed, self.steps),
            (self.seed.wrapping_add(1), self.steps),
        ];
        'candidates: for safety in candidates {
            for (seed, steps) in stages {
                let stage = Self {
                    seed,
                    steps,
                    ..*self
                };
                if !holds(&stage.run(safety, families, nominal)?) {
                    continue 'candidates;
                }
            }
            return Ok(Some(safety));
        }
        Ok(None)
    }
}

/// Looks for the bounds under which the plant of `case` keeps its headway and its lane.
///
/// # Errors
/// When the settings are refused.
pub fn cover_plant(
    case: CoverCase,
    control: &ControlSettings,
    seed: u64,
    steps: u64,
) -> Result<PlantCover, CampaignError> {
    let search = Search {
        plant: case.plant,
        control,
        seed,
        steps,
    };
    let every = [Family::Open, Family::Leaders, Family::Standing];
    let (open, leaders, ahead) = (&every[..1], &every[1..2], &every[1..]);
    let start = case.settings(&control.safety);
    let farther = |share: f64| SafetySettings {
        noise_position_m: start.noise_position_m + share * case.more_position_m(&start),
        ..start
    };
    let notches = || (0..=POSITION_NOTCHES).map(|k| f64::from(k) / f64::from(POSITION_NOTCHES));
    let along = farther(1.0);
    let wider = || {
        (0..=SLIP_NOTCHES).map(|k| SafetySettings {
            noise_slip_rad: along.noise_slip_rad + f64::from(k) * SLIP_NOTCH_RAD,
            ..along
        })
    };

    let all = Nominals::All;
    let with_defaults = search.run(start, &every, all)?;
    let holding = search.first([along].into_iter(), ahead, all, keeps_headway)?;
    let met = if holding.is_some() { ahead } else { leaders };
    let smallest = search.first(notches().map(farther), met, all, keeps_headway)?;
    let across = search.first(wider(), open, all, keeps_lane)?;
    let across_own = search.first(wider(), open, Nominals::Own, keeps_lane)?;
    let covered = match (holding, across) {
        (Some(_), Some(safety)) => {
            let fresh = Search {
                seed: seed.wrapping_add(2),
                steps: 2 * steps,
                ..search
            };
            Some(fresh.run(safety, &every, all)?)
        }
        _ => None,
    };
    Ok(PlantCover {
        case,
        eta: start.eta,
        with_defaults,
        position_m: along.noise_position_m,
        keeps_headway: holding.is_some(),
        smallest_position_m: smallest.map(|safety| safety.noise_position_m),
        across: across.map(|safety| safety.noise_slip_rad),
        across_own: across_own.map(|safety| safety.noise_slip_rad),
        covered,
        headway_cost_m: [15.0, 30.0].map(|v| {
            let closed = |safety: &SafetySettings| closed_m(safety, v, v, 1.0, 1.0);
            closed(&along) - closed(&start) + case.lead_s() * v
        }),
    })
}

/// Every case of [`COVERS`].
///
/// # Errors
/// When the settings are refused.
pub fn cover_plants(
    control: &ControlSettings,
    seed: u64,
    steps: u64,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Vec<PlantCover>, CampaignError> {
    COVERS
        .par_iter()
        .map(|&case| {
            let cover = cover_plant(case, control, seed, steps)?;
            progress(steps);
            Ok(cover)
        })
        .collect()
}

fn keeps_headway(tally: &Tally) -> bool {
    tally.headway_violations == 0 && tally.collisions == 0
}

fn keeps_lane(tally: &Tally) -> bool {
    tally.lane_excess_steps == 0
}

#[cfg(test)]
mod tests {
    use super::super::cases::lag;
    use super::*;

    fn cover(case: CoverCase) -> PlantCover {
        cover_plant(case, &ControlSettings::default(), 0, 12_000).expect("a cover")
    }

    #[test]
    fn the_controllers_own_plant_needs_nothing_more_than_the_defaults() {
        let found = cover(CoverCase {
            plant: PlantModel::Kinematic,
            is_slow: false,
        });
        let defaults = SafetySettings::default();
        assert_eq!(found.smallest_position_m, Some(defaults.noise_position_m));
        assert_eq!(found.across, Some(defaults.noise_slip_rad));
        assert!(found.headway_cost_m.iter().all(|cost_m| *cost_m <= 0.0));
        let covered = found.covered.expect("bounds that cover it");
        assert!(keeps_headway(&covered) && keeps_lane(&covered));
    }

    #[test]
    fn the_longer_the_lag_the_more_it_needs() {
        for is_told in [false, true] {
            let found = [0.1, 0.3].map(|tau_s| cover(lag(tau_s, is_told, !is_told)));
            let smallest = found.each_ref().map(|of| of.smallest_position_m);
            let cost_m = found.each_ref().map(|of| of.headway_cost_m[0]);
            assert!(found.iter().all(|of| of.keeps_headway));
            assert!(smallest.is_sorted(), "{smallest:?}");
            assert!(cost_m[0] > 0.0 && cost_m.is_sorted(), "{cost_m:?}");
        }
    }

    #[test]
    fn a_lag_that_nobody_heeds_leaves_the_lane_under_every_bound_tried() {
        let found = cover(lag(0.3, false, false));
        // What a short search takes for enough does not hold in a fresh run.
        assert!(!found.covered.is_some_and(|covered| keeps_lane(&covered)));
        assert!(found.with_defaults.lane_excess_steps > 0);
    }
}
