//! Traffic on the loop: nobody touches anybody, and it has no seam.
#![allow(clippy::expect_used, reason = "helpers of tests")]

use covista_traffic::{Ring, RingSettings};

fn ring(density: f64, seed: u64) -> Ring {
    let settings = RingSettings {
        density,
        seed,
        ..RingSettings::default()
    };
    Ring::new(settings).expect("a ring")
}

fn run(ring: &mut Ring, duration_s: f64) {
    for _ in 0..(duration_s * 100.0) as usize {
        ring.step(&[]).expect("a step");
    }
}

#[test]
fn humans_never_touch_at_any_density() {
    for tenths in 1..=9 {
        for seed in 0..3 {
            let mut ring = ring(f64::from(tenths) / 10.0, seed);
            run(&mut ring, 200.0);
            let report = ring.report();
            eprintln!("{tenths} {report:?}");
            assert_eq!(report.collisions, 0, "{tenths} {seed}: {report:?}");
        }
    }
}
