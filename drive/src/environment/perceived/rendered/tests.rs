use std::path::Path;

use covista_control::SightLine;
use covista_perception::{OnnxRuntime, SessionSettings};
use covista_traffic::RingSettings;
use covista_world::{LANE_COUNT, LaneIndex, Track};

use super::*;
use crate::{
    RingEnvironment, RingEnvironmentSettings, RingPerception,
    environment::{
        FRAME_STEPS,
        perceived::{Eyes, Perceived, tests::track_of},
        perception::Knowledge,
    },
};

fn open(folder: &Path) -> Result<Networks, covista_perception::ModelError> {
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    Networks::open(&runtime, folder, SessionSettings::cpu(1), 3)
}

fn networks() -> Networks {
    open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../models")).expect("networks")
}

fn settings() -> RingEnvironmentSettings {
    RingEnvironmentSettings {
        ring: RingSettings {
            vehicles: 8,
            cavs: 2,
            density: 0.25,
            seed: 3,
            ..RingSettings::default()
        },
        perception: RingPerception::Network,
        steps: 2,
        ..RingEnvironmentSettings::default()
    }
}

#[test]
fn whoever_is_in_plain_view_is_tracked_near_the_truth() {
    let networks = networks();
    let mut ring = RingEnvironment::with_networks(settings(), Some(&networks)).expect("a ring");
    // A track is believed after some frames.
    for _ in 0..6 * FRAME_STEPS {
        ring.control_step().expect("a step");
    }
    let (mut plain, mut errors_m) = (0, Vec::new());
    for cav in 0..2 {
        let ([eye_s_m, _], _) = ring.sights.about(cav);
        for seen in ring.sights.seen(cav) {
            let away_m = (seen.body.middle()[0] - eye_s_m).abs();
            if seen.visibility > 0.9 && away_m < 40.0 {
                plain += 1;
                let found = track_of(&ring, cav, seen.vehicle);
                errors_m.extend(found.map(|(_, error_m)| error_m));
            }
        }
    }
    assert!(plain >= 3, "{plain}");
    assert_eq!(errors_m.len(), plain, "{errors_m:?}");
    let mean_m = errors_m.iter().sum::<f64>() / errors_m.len() as f64;
    assert!((0.01..0.6).contains(&mean_m), "{errors_m:?}");
}

/// Road s up to which each lane is seen free.
fn open_s_m(sight: &SightLine) -> Vec<f64> {
    LaneIndex::all().map(|lane| sight.open_s_m(lane)).collect()
}

/// How far CAV `index` of `ring` sees each lane free by `knowledge`.
fn sight(ring: &RingEnvironment, knowledge: &dyn Knowledge, index: usize) -> SightLine {
    let (road, safety) = (ring.profile.road(), &ring.settings.control.safety);
    let (pose, time_s) = (ring.cavs[index].state.pose, ring.ring.time_s());
    let sight = knowledge.sight(index, pose, road, time_s, safety);
    sight.expect("measured, not exact")
}

#[test]
fn how_far_lanes_are_free_is_measured_by_the_sweep() {
    let networks = networks();
    let ring = RingEnvironment::with_networks(settings(), Some(&networks)).expect("a ring");
    let (road, safety) = (ring.profile.road(), &ring.settings.control.safety);
    let mut free = Vec::new();
    for (index, cav) in ring.cavs.iter().enumerate() {
        let measured_s_m = open_s_m(&sight(&ring, &*ring.knowledge, index));
        assert_eq!(open_s_m(&cav.sight), measured_s_m);
        let exact = ring.sights.free(index, 0.0, road, safety, |_, _| true);
        let exact_s_m = open_s_m(&exact);
        let pairs = measured_s_m.into_iter().zip(exact_s_m);
        let from_here = pairs.map(|(one, other)| [one, other].map(|s_m| s_m - cav.frenet.s_m));
        free.extend(from_here.filter(|[_, exact_m]| *exact_m > 25.0));
    }
    assert!(free.len() >= 4, "{free:?}");
    for [measured_m, exact_m] in free {
        let apart_m = (measured_m - exact_m).abs();
        assert!(0.0 < apart_m && apart_m < 1.5, "{measured_m} {exact_m}");
    }
}

#[test]
fn without_a_sweep_no_lane_is_free() {
    let networks = networks();
    let ring = RingEnvironment::with_networks(settings(), Some(&networks)).expect("a ring");
    let before_the_first = Perceived::new(Eyes::Network(Rendered::new(networks)), &ring.cavs);
    let blind = SightLine::new([f64::NEG_INFINITY; LANE_COUNT as usize], 0.0);
    for index in 0..2 {
        assert_eq!(sight(&ring, &before_the_first, index), blind);
    }
}

/// All tracks of the third frame of a ring on so many threads.
fn tracks(networks: &Networks, threads: usize) -> Vec<Vec<Track>> {
    let drive = || {
        let mut ring = RingEnvironment::with_networks(settings(), Some(networks)).expect("a ring");
        for _ in 0..2 * FRAME_STEPS {
            ring.control_step().expect("a step");
        }
        let tracks = (0..2).map(|cav| ring.knowledge.tracks(&ring.ring, cav));
        tracks.collect()
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.expect("threads").install(drive)
}

#[test]
fn the_same_seed_gives_the_same_tracks_on_any_number_of_threads() {
    let networks = networks();
    let alone = tracks(&networks, 1);
    assert!(alone.iter().all(|tracks| !tracks.is_empty()));
    assert_eq!(alone, tracks(&networks, 3));
}

#[test]
fn networks_that_are_missing_are_told() {
    let error = RingEnvironment::new(settings()).err().expect("refused");
    assert!(
        error.to_string().contains("perception = \"network\""),
        "{error}"
    );
    let folder = tempfile::tempdir().expect("a folder");
    let error = open(folder.path()).expect_err("refused").to_string();
    let place = folder.path().display().to_string();
    assert!(error.contains(&place) && !error.contains('\n'), "{error}");
}
