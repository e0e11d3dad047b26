//! A step of a ring allocates nothing, lane changes included.

#![allow(clippy::expect_used, reason = "helpers of tests")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use covista_traffic::{Ring, RingSettings};
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

#[test]
fn a_step_allocates_nothing() {
    let settings = RingSettings {
        vehicles: 90,
        cavs: 10,
        density: 0.2,
        ..RingSettings::default()
    };
    let mut ring = Ring::new(settings).expect("a ring");
    let inputs = [ControlInput::default(); 10];
    let before = ALLOCATIONS.get();
    // The CAVs roll straight on, over the edge of the road, past everybody.
    for _ in 0..10_000 {
        ring.step(&inputs).expect("a step");
    }
    assert!(ring.report().human_lane_changes > 0);
    assert_eq!(ring.report().collisions, 0);
    assert_eq!(ALLOCATIONS.get(), before);
}
