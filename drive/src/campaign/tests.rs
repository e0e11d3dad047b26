use super::*;

fn spec(steps: u64, broken: Option<Broken>) -> CampaignSpec {
    CampaignSpec {
        seed: 3,
        steps,
        control: ControlSettings::default(),
        broken,
        nominal: Nominals::All,
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

/// Steps after which each broken assumption has shown, and the one that the monitor names most.
fn named(broken: Broken) -> Option<&'static str> {
    let found = all(&spec(60_000, Some(broken)));
    if broken.is_about_followers() {
        assert!(found.rear_gap_breaches > 5, "{found:?}");
        found.most_frequent_rear_cause()
    } else {
        assert!(found.violations > 5, "{found:?}");
        found.most_frequent_cause()
    }
}

#[test]
fn every_assumption_that_is_broken_on_purpose_is_found_and_named() {
    for broken in Broken::ALL {
        assert_eq!(named(broken), Some(broken.cause()), "{}", broken.name());
    }
}

#[test]
fn with_no_assumption_broken_none_is_named_and_nothing_happens() {
    let found = all(&spec(300_000, None));
    let allowed = ["start", "cut-in", "revealed", "leaving"];
    assert!(
        found.cause.keys().all(|cause| allowed.contains(cause)),
        "{:?}",
        found.cause
    );
    let bad = [
        found.violations,
        found.headway_violations,
        found.infeasible,
        found.collisions,
        found.lane_excess_steps,
        found.bad_inputs,
        found.curve_speed_steps,
        found.lateral_accel_steps,
        found.unattributed,
    ];
    assert_eq!(bad, [0; 9], "{found:?}");
}

#[test]
fn an_episode_that_is_looked_at_is_the_one_of_the_campaign() {
    let spec = spec(18_000, Some(Broken::LeaderBraking));
    let found = all(&spec);
    let id = found.first_bad_episode.expect("a violation");
    let (tally, lines) = look_at_episode(&spec, id).expect("an episode");
    assert!(tally.is_bad() && tally.lines.is_none());
    assert!(
        lines.iter().any(|line| line.starts_with("step ")),
        "{lines:?}"
    );
}

/// Followers at the edge of what they keep: behind a vehicle that turns as it brakes, and behind
/// one whose noise shortens the way that it stops in.
#[test]
fn a_follower_that_stops_keeps_its_distance() {
    for (seed, number) in [(1, 1099), (0, 930)] {
        let spec = CampaignSpec {
            seed,
            ..spec(0, None)
        };
        let family = Family::LaneChange;
        let (tally, _) = look_at_episode(&spec, EpisodeId { family, number }).expect("an episode");
        assert_eq!(tally.rear_gap_breaches, 0, "{tally:?}");
        assert!(tally.smallest_rear_room_m < 0.01, "{tally:?}");
    }
}

#[test]
fn a_plant_with_a_lag_breaks_the_headway_of_the_model() {
    let lag = PlantModel::Lag {
        time_constant_s: 0.3,
        is_told: false,
    };
    let found = all(&CampaignSpec {
        plant: lag,
        ..spec(60_000, None)
    });
    assert!(found.headway_violations > 0, "{found:?}");
}
