//! An update allocates nothing.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use crate::learning::{Algorithm, Hyperparameters, benchmark::prepared};

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
fn an_update_allocates_nothing() {
    for algorithm in [
        Algorithm::SafeActorCritic,
        Algorithm::Maddpg,
        Algorithm::EndToEnd,
    ] {
        let settings = Hyperparameters {
            hidden: 32,
            ..Hyperparameters::default()
        };
        let (mut learner, mut workspace, _) = prepared(algorithm, 5, 4, settings).expect("ready");
        let mut update = || learner.update(&mut workspace).expect("an update").is_some();
        // The room for packed matrices is taken by the first.
        assert!(update());
        let before = ALLOCATIONS.with(Cell::get);
        for _ in 0..10 {
            assert!(update());
        }
        assert_eq!(ALLOCATIONS.with(Cell::get) - before, 0, "{algorithm:?}");
    }
}
