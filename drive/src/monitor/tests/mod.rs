mod causes;
mod followers;
mod strict;

use covista_traffic::VehicleKind;
use covista_world::{
    LaneIndex, ObjectClass, ObjectState, RoadSegment, STEP_S, Se2Pose, Sighting, StationId,
    VehicleDimensions, bicycle_step,
};

use super::*;

const SEDAN: VehicleDimensions = VehicleDimensions {
    length_m: 4.7,
    width_m: 1.8,
    height_m: 1.45,
    wheelbase_m: 2.51,
    rear_overhang_m: 1.0,
};
const EGO: VehicleId = VehicleId(1);
const OTHER: VehicleId = VehicleId(2);

fn road() -> Road {
    let segment = RoadSegment::Straight { length_m: 2000.0 };
    Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road")
}

fn lane(index: u8) -> LaneIndex {
    LaneIndex::new(index).expect("a lane")
}

/// A vehicle of a scene: it drives straight on, or is set elsewhere.
#[derive(Clone, Copy)]
struct Body {
    kind: VehicleKind,
    state: BicycleState,
    accel_mps2: f64,
}

impl Body {
    /// At offset `d_m`, with its rear axle at `s_m`.
    fn new(kind: VehicleKind, s_m: f64, d_m: f64, speed_mps: f64) -> Self {
        Self {
            kind,
            state: BicycleState {
                pose: Se2Pose::new(s_m, d_m, 0.0),
                speed_mps,
            },
            accel_mps2: 0.0,
        }
    }

    fn input(&self) -> ControlInput {
        ControlInput {
            tan_delta: 0.0,
            accel_mps2: self.accel_mps2,
        }
    }

    fn step(&mut self) {
        self.state = bicycle_step(self.state, self.input(), SEDAN.wheelbase_m);
    }
}

/// What the CAV has a track of.
type Know = fn(Track, f64) -> Option<Track>;

/// The ego vehicle, a CAV, and one other on a straight road; the CAV keeps the middle lane.
struct Scene {
    monitor: Monitor,
    step: u32,
    ego: Body,
    other: Body,
    manoeuvre: Manoeuvre,
    visible: bool,
    /// Turns the true track of the other at this time into what the CAV knows.
    know: Know,
    sight: Option<SightLine>,
    /// The input that the CAV believes in, where it is not the one applied.
    claimed: Option<ControlInput>,
}

fn exactly(track: Track, _: f64) -> Option<Track> {
    Some(track)
}

fn nothing(_: Track, _: f64) -> Option<Track> {
    None
}

impl Scene {
    /// `ego_mps` fast, `h_m` outside of the set towards a human driver `other_mps` fast.
    fn new(ego_mps: f64, other_mps: f64, h_m: f64) -> Self {
        let settings = SafetySettings::default();
        let closing = crate::closing_distance_m(
            ego_mps,
            other_mps,
            settings.brake_mps2,
            settings.leader_brake_mps2,
        );
        let apart_m = settings.headway_safe_m + closing + h_m;
        Self {
            monitor: Monitor::new(settings),
            step: 0,
            ego: Body::new(VehicleKind::Cav, 100.0, 0.0, ego_mps),
            other: Body::new(VehicleKind::Human, 100.0 + apart_m, 0.0, other_mps),
            manoeuvre: Manoeuvre::KeepLane { lane: lane(1) },
            visible: true,
            know: exactly,
            sight: None,
            claimed: None,
        }
    }

    fn time_s(&self) -> f64 {
        f64::from(self.step) * STEP_S
    }

    fn vehicles(&self) -> [TrueVehicle; 2] {
        [(EGO, self.ego), (OTHER, self.other)].map(|(id, body)| {
            TrueVehicle::new(
                id,
                body.kind,
                SEDAN,
                body.state,
                body.state.pose.x_m,
                &road(),
            )
        })
    }

    fn observe(&mut self) {
        let (time_s, truth) = (self.time_s(), self.vehicles());
        self.monitor.sight(EGO, OTHER, self.visible, time_s);
        let tracks: Vec<Track> = (self.know)(track_of(&truth[1], time_s), time_s)
            .into_iter()
            .collect();
        let mut views = vec![CavView {
            id: EGO,
            tracks: &tracks,
            sight: self.sight.as_ref(),
            manoeuvre: self.manoeuvre,
            state: self.ego.state,
            wheelbase_m: SEDAN.wheelbase_m,
            input: Some(self.claimed.unwrap_or(self.ego.input())),
        }];
        let own = [track_of(&truth[0], time_s)];
        if self.other.kind == VehicleKind::Cav {
            views.push(CavView {
                id: OTHER,
                tracks: &own,
                sight: None,
                manoeuvre: Manoeuvre::KeepLane { lane: lane(1) },
                state: self.other.state,
                wheelbase_m: SEDAN.wheelbase_m,
                input: None,
            });
        }
        self.monitor.observe(time_s, &road(), &truth, &views, []);
    }

    /// Shows each of the next `seconds` to the monitor, and moves on.
    fn run(&mut self, seconds: f64) -> &mut Self {
        for _ in 0..(seconds / STEP_S).round() as u32 {
            self.observe();
            self.ego.step();
            self.other.step();
            self.step += 1;
        }
        self
    }

    fn h_m(&self) -> f64 {
        self.monitor.barriers_of(EGO).expect("a leader").h_m
    }

    fn causes(&self) -> Vec<Cause> {
        self.monitor.violations().keys().copied().collect()
    }
}

fn track_of(vehicle: &TrueVehicle, time_s: f64) -> Track {
    Track {
        id: vehicle.id.0,
        station: None,
        state: ObjectState {
            center: Se2Pose::new(vehicle.center.x, vehicle.center.y, 0.0),
            velocity_mps: vehicle.velocity,
            length_m: 4.7,
            width_m: 1.8,
            height_m: 1.45,
            class: ObjectClass::Car,
        },
        time_s,
        position_std_m: 0.05,
        velocity_std_mps: 0.05,
        confidence: 1.0,
        lane: None,
        action: None,
        announced_s: None,
        sightings: vec![Sighting {
            station: StationId(1),
            measured_s: time_s,
        }],
    }
}

#[test]
fn barriers_in_closed_form() {
    let mut scene = Scene::new(10.0, 10.0, 21.5);
    scene.observe();
    let barriers = scene.monitor.barriers_of(EGO).expect("a leader");
    // Reference points 40 m apart, equal speeds: nothing closes.
    assert!((barriers.headway_m - 40.0).abs() < 1e-9);
    assert!((barriers.h_m - (40.0 - 18.5)).abs() < 1e-9);
    assert!((barriers.h0_m - (40.0 - 4.7 - 2.0)).abs() < 1e-9);
    assert!(scene.monitor.violations().is_empty());
}

#[test]
fn on_a_curve_the_gap_is_that_of_the_lane() {
    let segment = RoadSegment::Arc {
        length_m: 400.0,
        curvature_per_m: 0.01,
    };
    let road = Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road");
    let at = |id: u32, s_m: f64, d_m: f64| {
        let state = BicycleState {
            pose: road.pose_from_frenet(s_m, d_m, 0.0),
            speed_mps: 10.0,
        };
        TrueVehicle::new(VehicleId(id), VehicleKind::Cav, SEDAN, state, s_m, &road)
    };
    for (index, d_m) in [(0, 3.5), (1, 0.0), (2, -3.5)] {
        let (behind, ahead) = (at(1, 100.0, d_m), at(2, 150.0, d_m));
        let lanes = behind
            .lanes(&road, 0.0)
            .shared_with(ahead.lanes(&road, 0.0));
        assert_eq!(lanes, Lanes::only(lane(index)));
        let gap_m = behind.gap_to_m(&ahead, lanes, &road);
        let along_m = ahead.s_range_m[0] - behind.s_range_m[1];
        assert!(
            (gap_m - along_m * (1.0 - 0.01 * d_m)).abs() < 1e-6,
            "{gap_m}"
        );
    }
}

#[test]
fn standing_for_five_seconds_is_stuck() {
    let mut scene = Scene::new(0.0, 0.0, 10.0);
    scene.run(4.9);
    assert_eq!(scene.monitor.stuck(), 0);
    scene.run(0.3);
    assert_eq!(scene.monitor.stuck(), 2);
}

#[test]
fn time_to_collision_is_counted_while_the_gap_closes() {
    let mut scene = Scene::new(20.0, 10.0, 30.0);
    scene.observe();
    let ttc = &scene.monitor.distributions().ttc_s;
    // The gap is 18.5 - 4.7 + 18.75 (and half a step) + 30 m, and closes at 10 m/s.
    let found = ttc.quantile(0.5).expect("one value");
    assert!((6.2..6.35).contains(&found), "{found}");
    let mut opening = Scene::new(10.0, 20.0, 30.0);
    opening.observe();
    assert_eq!(opening.monitor.distributions().ttc_s.count(), 0);
}
