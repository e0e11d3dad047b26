//! On the closed-form path a step of the controller allocates nothing.

#![allow(clippy::expect_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

use covista_control::{
    ControlOutput, ControlSettings, Controller, EgoState, Excuse, Manoeuvre, Neighbour,
    RoadProfile, SightLine, Situation,
};
use covista_world::{
    Action, BicycleState, ControlInput, LaneIndex, ObjectClass, ObjectState, Road, RoadSegment,
    STEP_S, Se2Pose, Sighting, StationId, Track, VehicleDimensions, bicycle_step,
};

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

const SEDAN: VehicleDimensions = VehicleDimensions {
    length_m: 4.6,
    width_m: 1.85,
    height_m: 1.5,
    wheelbase_m: 2.51,
    rear_overhang_m: 0.95,
};

/// Another vehicle: road s and d of its centre, and its speed.
#[derive(Clone, Copy)]
struct Other {
    id: u32,
    s_m: f64,
    d_m: f64,
    speed_mps: f64,
}

fn other(id: u32, s_m: f64, d_m: f64, speed_mps: f64) -> Other {
    Other {
        id,
        s_m,
        d_m,
        speed_mps,
    }
}

struct Drive {
    controller: Controller,
    profile: RoadProfile,
    state: BicycleState,
    others: Vec<Other>,
    sight: SightLine,
    time_s: f64,
    /// Allocations within the controller since the warm-up.
    allocated: usize,
}

impl Drive {
    fn new(s_m: f64, others: &[Other]) -> Self {
        let segments = [
            RoadSegment::Straight { length_m: 150.0 },
            RoadSegment::Arc {
                length_m: 90.0,
                curvature_per_m: 0.0125,
            },
            RoadSegment::Straight { length_m: 900.0 },
        ];
        let road = Arc::new(Road::new(Se2Pose::default(), &segments, 3.5).expect("a road"));
        let settings = ControlSettings::default();
        let center = road.pose_from_frenet(s_m, 0.0, 0.0);
        let lane = LaneIndex::new(1).expect("a lane");
        let drive = Self {
            controller: Controller::new(settings, lane).expect("valid settings"),
            state: BicycleState {
                pose: SEDAN.axle_pose(center),
                speed_mps: 14.0,
            },
            profile: RoadProfile::new(road, &settings),
            others: others.to_vec(),
            sight: SightLine::new([1e4; 3], 0.0),
            time_s: 0.0,
            allocated: 0,
        };
        drive.warmed(s_m)
    }

    fn track(&self, other: &Other) -> Track {
        let center = self
            .profile
            .road()
            .pose_from_frenet(other.s_m, other.d_m, 0.0);
        Track {
            id: other.id,
            station: None,
            state: ObjectState {
                center,
                velocity_mps: center.forward() * other.speed_mps,
                length_m: SEDAN.length_m,
                width_m: SEDAN.width_m,
                height_m: SEDAN.height_m,
                class: ObjectClass::Car,
            },
            time_s: self.time_s,
            position_std_m: 0.0,
            velocity_std_mps: 0.0,
            confidence: 1.0,
            lane: None,
            action: None,
            announced_s: None,
            sightings: vec![Sighting {
                station: StationId(1),
                measured_s: self.time_s,
            }],
        }
    }

    fn step(&mut self, u_nominal: Option<ControlInput>) -> ControlOutput {
        let safety = self.controller.settings().safety;
        let road = self.profile.road();
        let neighbours: Vec<_> = (self.others.iter())
            .filter_map(|other| {
                Neighbour::from_track(&self.track(other), road, self.time_s, &safety)
            })
            .collect();
        let situation = Situation {
            profile: &self.profile,
            ego: EgoState::new(StationId(7), self.state, SEDAN, road),
            neighbours: &neighbours,
            sight: &self.sight,
            time_s: self.time_s,
            desired_speed_mps: 14.0,
        };
        let before = ALLOCATIONS.get();
        let output = match u_nominal {
            Some(u_nominal) => self.controller.filter(&situation, u_nominal),
            None => self.controller.control(&situation),
        };
        self.allocated += ALLOCATIONS.get() - before;
        self.state = bicycle_step(self.state, output.u, SEDAN.wheelbase_m);
        self.time_s += STEP_S;
        for other in &mut self.others {
            other.s_m += other.speed_mps * STEP_S;
        }
        output
    }

    /// The storage grows once to what a crowd needs, a change announced among it; then the count
    /// starts.
    fn warmed(mut self, s_m: f64) -> Self {
        let (state, others) = (self.state, self.others.clone());
        self.others = (0..12_u32)
            .map(|i| {
                let d_m = [-3.5, 3.5, 0.0][i as usize % 3];
                other(100 + i, s_m - 52.0 + 12.0 * f64::from(i), d_m, 14.0)
            })
            .collect();
        for action in [Action::ChangeLeft, Action::ChangeRight, Action::KeepLane] {
            self.controller.set_action(action, self.time_s - 1.0);
            self.step(None);
            self.step(Some(ControlInput::default()));
        }
        self.others = others;
        self.state = state;
        self.step(None);
        self.state = state;
        assert!(matches!(
            self.controller.manoeuvre(),
            Manoeuvre::KeepLane { .. }
        ));
        self.allocated = 0;
        self
    }
}

#[test]
fn the_count_counts() {
    let before = ALLOCATIONS.get();
    drop(std::hint::black_box(vec![1_u8; 10]));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}

#[test]
fn following_through_a_curve_allocates_nothing() {
    let mut drive = Drive::new(40.0, &[other(1, 85.0, 0.0, 9.0), other(2, 20.0, 3.5, 9.0)]);
    for _ in 0..3000 {
        drive.step(None);
    }
    assert_eq!(drive.allocated, 0);
    assert!(drive.state.speed_mps > 5.0);
}

#[test]
fn a_wild_input_that_is_filtered_allocates_nothing() {
    let mut drive = Drive::new(40.0, &[other(1, 85.0, 0.0, 9.0)]);
    let mut filtered = 0;
    for step in 0..3000 {
        let sign = if (step / 40) % 2 == 0 { 1.0 } else { -1.0 };
        let output = drive.step(Some(ControlInput {
            tan_delta: 0.3 * sign,
            accel_mps2: 3.0,
        }));
        filtered += usize::from(output.binding.is_some());
    }
    assert_eq!(drive.allocated, 0);
    assert!(filtered > 2000, "{filtered}");
}

#[test]
fn a_cut_in_with_its_excuse_allocates_nothing() {
    let mut drive = Drive::new(300.0, &[other(3, 318.0, 3.5, 13.5)]);
    drive.step(None);
    drive.others[0].d_m = 0.8;
    let mut excused = 0;
    for _ in 0..2000 {
        drive.step(None);
        let excuse = drive.controller.excused().first().map(|it| it.excuse);
        excused += usize::from(excuse == Some(Excuse::CutIn));
    }
    assert_eq!(drive.allocated, 0);
    assert!(excused > 20, "{excused}");
}

#[test]
fn a_lane_change_allocates_nothing() {
    let others = [other(1, 360.0, 3.5, 14.0), other(2, 250.0, 3.5, 14.0)];
    let mut drive = Drive::new(300.0, &others);
    // The first one brings the storage for followers, the way back needs no more.
    let changes = [Action::ChangeLeft, Action::ChangeRight].map(|action| {
        drive.controller.set_action(action, drive.time_s);
        let (before, mut running) = (drive.allocated, 0);
        for _ in 0..900 {
            drive.step(None);
            let manoeuvre = drive.controller.manoeuvre();
            running += usize::from(matches!(manoeuvre, Manoeuvre::ChangeLane { .. }));
        }
        (drive.allocated - before, running)
    });
    assert_eq!(changes[1].0, 0);
    assert!(changes.iter().all(|change| change.1 > 200), "{changes:?}");
}

#[test]
fn an_announcement_that_is_refused_allocates_nothing() {
    let mut drive = Drive::new(300.0, &[other(1, 303.0, 3.5, 14.0)]);
    drive
        .controller
        .set_action(Action::ChangeLeft, drive.time_s);
    let mut announced = 0;
    for _ in 0..1500 {
        drive.step(None);
        let manoeuvre = drive.controller.manoeuvre();
        announced += usize::from(matches!(manoeuvre, Manoeuvre::Announced { .. }));
    }
    assert_eq!(drive.allocated, 0);
    assert!(announced > 1000, "{announced}");
}
