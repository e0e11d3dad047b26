use std::path::Path;

use covista_perception::{OnnxRuntime, SessionSettings};
use covista_traffic::RingSettings;
use covista_world::Track;

use super::*;
use crate::{
    RingEnvironment, RingEnvironmentSettings, RingPerception,
    environment::{FRAME_STEPS, perceived::tests::track_of},
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
