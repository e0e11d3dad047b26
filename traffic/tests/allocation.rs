//! A step of a ring allocates nothing, lane changes and contacts included.

#![allow(clippy::expect_used, reason = "helpers of tests")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use covista_traffic::{Ring, RingSettings, RingVehicle};
use covista_world::ControlInput;

/// Counts what this thread asks for.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is handed to the system's allocator as it comes.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are the same.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promises are the same.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Follows the middle lane, slowly and blindly: some touch each other.
fn keep_lane(cav: &RingVehicle) -> ControlInput {
    let place = cav.frenet();
    let bend_per_m = place.curvature_per_m - 0.02 * place.d_m - 0.3 * place.psi_rad;
    ControlInput {
        tan_delta: cav.dimensions().wheelbase_m * bend_per_m,
        accel_mps2: 0.2 * (8.0 - cav.speed_mps),
    }
}

#[test]
fn a_step_allocates_nothing() {
    let settings = RingSettings {
        vehicles: 90,
        cavs: 10,
        density: 0.2,
        ..RingSettings::default()
    };
    let mut ring = Ring::new(settings).expect("a ring");
    let before = ALLOCATIONS.get();
    for _ in 0..10_000 {
        let mut inputs = [ControlInput::default(); 10];
        for (input, cav) in inputs.iter_mut().zip(ring.vehicles()) {
            *input = keep_lane(cav);
        }
        ring.step(&inputs).expect("a step");
    }
    let report = ring.report();
    assert!(
        report.human_lane_changes > 0 && report.collisions > 0,
        "{report:?}"
    );
    assert_eq!(ALLOCATIONS.get(), before);
}
