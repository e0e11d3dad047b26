//! In steady state a frame's way through the networks allocates nothing on this side of ONNX
//! Runtime, whose own memory is not counted.

#![allow(clippy::expect_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

use covista_perception::{
    DETECTOR_MODEL, Detector, LANE_MODEL, LaneFinder, OnnxRuntime, SessionSettings,
};
use covista_world::{CameraImage, PointCloud};

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

fn allocations(work: impl FnOnce()) -> usize {
    let before = ALLOCATIONS.get();
    work();
    ALLOCATIONS.get() - before
}

#[test]
fn the_count_counts() {
    assert_eq!(
        allocations(|| drop(std::hint::black_box(vec![1_u8; 10]))),
        1
    );
}

#[test]
fn marks_are_found_without_allocating() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    let settings = SessionSettings::cpu(1);
    let mut finder = LaneFinder::open(&runtime, &models, LANE_MODEL, settings).expect("a network");
    let image = CameraImage {
        width_px: 1242,
        height_px: 375,
        rgb: vec![90; 3 * 1242 * 375],
    };
    finder.find_marks(&image).expect("marks");
    let count = allocations(|| {
        finder.find_marks(&image).expect("marks");
    });
    assert_eq!(count, 0);
}

#[test]
fn boxes_are_found_with_no_memory_but_their_own() {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let runtime = OnnxRuntime::acquire(&|_| ()).expect("ONNX Runtime");
    let settings = SessionSettings::cpu(1);
    let mut detector =
        Detector::open(&runtime, &models, DETECTOR_MODEL, settings).expect("a network");
    let at = |i: u32| [0.05 * i as f32 - 60.0, 3.0, -1.0, 0.4];
    let sweep = PointCloud {
        points: (0..2000).map(at).collect(),
    };
    let first = detector.detect(&sweep).expect("boxes");
    let mut again = Vec::new();
    let count = allocations(|| again = detector.detect(&sweep).expect("boxes"));
    assert!(!first.is_empty() && first == again);
    assert_eq!(count, 1);
}
