use super::*;

fn spec(steps: u64, broken: Option<Broken>) -> CampaignSpec {
    CampaignSpec {
        seed: 3,
        steps,
        control: ControlSettings::default(),
        broken,
        plant: PlantModel::Kinematic,
    }
}

fn all(spec: &CampaignSpec) -> Tally {
    let mut all = Tally::default();
    for (_, tally) in run_campaign(spec, &|_| {}).expect("a campaign") {
        all.add(&tally);
    }
    all
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let with_threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
        pool.expect("threads")
            .install(|| run_campaign(&spec(30_000, None), &|_| {}))
            .expect("a campaign")
    };
    assert_eq!(with_threads(1), with_threads(2));
}

#[test]
fn every_step_is_made_and_told() {
    let most = AtomicU64::new(0);
    let found = run_campaign(&spec(12_345, None), &|done| {
        most.fetch_max(done, Ordering::Relaxed);
    })
    .expect("a campaign");
    let steps: u64 = found.iter().map(|(_, tally)| tally.campaign_steps).sum();
    // Shared out evenly: rounded up to a whole step a family.
    assert_eq!(steps, 12_345_u64.div_ceil(6) * 6);
    assert_eq!(most.into_inner(), steps);
}

#[test]
fn a_leader_that_brakes_too_hard_is_found_and_named() {
    let found = all(&spec(60_000, Some(Broken::LeaderBraking)));
    assert!(found.violations > 0, "{found:?}");
    assert_eq!(found.most_frequent_cause(), Some("leader-braking"));
}

#[test]
fn a_plant_with_a_lag_breaks_the_headway_of_the_model() {
    let lag = PlantModel::Lag {
        time_constant_s: 0.3,
    };
    let found = all(&CampaignSpec {
        plant: lag,
        ..spec(60_000, None)
    });
    assert!(found.headway_violations > 0, "{found:?}");
}
