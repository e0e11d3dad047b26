use covista_world::{Action, BicycleState, LaneIndex, Road, StationId, Track, VehicleDimensions};
use serde::{Deserialize, Serialize};

/// A vehicle this far beside its lane's centre shows which way it is going, in metres.
const CLEAR_OFFSET_M: f64 = 0.3;
/// A lane change announced longer ago than this and at a lane's centre is at its end.
const UNDER_WAY_S: f64 = 2.5;

/// Why no observation can be made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum InvalidObservation {
    /// An own number is unusable.
    #[error(
        "the own pose, speed, dimensions or desired speed is no finite number; check the state given to the planner"
    )]
    OwnState,
    /// A track's number is unusable.
    #[error("track {0} has a number that is not finite; check the tracker that made it")]
    Track(u32),
}

/// What the vehicle is about.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Manoeuvre {
    /// It keeps its lane.
    KeepingLane,
    /// It changes lane.
    ChangingLane {
        /// The lane that it leaves.
        from: LaneIndex,
        /// The next lane, that it enters.
        to: LaneIndex,
        /// Share of the way that is done, in [0, 1].
        progress: f64,
    },
}

/// The vehicle's own state and what it wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OwnMotion {
    /// State at the rear axle, in the world frame.
    pub state: BicycleState,
    /// Own dimensions.
    pub dimensions: VehicleDimensions,
    /// Own lane.
    pub lane: LaneIndex,
    /// The speed it would drive at on a free road, in m/s.
    pub desired_speed_mps: f64,
    /// What it is about.
    pub manoeuvre: Manoeuvre,
}

/// Another vehicle in road coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// The track's identity.
    pub id: u32,
    /// Its station, where it is a CAV.
    pub station: Option<StationId>,
    /// Its lane: by vision where known, else the one that holds its centre; `None` off the road.
    pub lane: Option<LaneIndex>,
    /// The lane that it announced to enter.
    pub entering: Option<LaneIndex>,
    /// Arc length of its centre along the road in metres.
    pub s_m: f64,
    /// Offset of its centre from the road's reference line in metres, positive to the left.
    pub d_m: f64,
    /// Speed along the road in m/s.
    pub speed_mps: f64,
    /// Standard deviation of the velocity in m/s: large for an object seen once.
    pub speed_std_mps: f64,
    /// Length in metres.
    pub length_m: f64,
    /// Width in metres.
    pub width_m: f64,
    /// Age of the newest measurement by anybody, in seconds.
    pub age_s: f64,
    /// The action that it announced, where it is a CAV.
    pub action: Option<Action>,
}

/// The situation as one vehicle knows it, in road coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Own lane.
    pub lane: LaneIndex,
    /// Arc length of the own body's centre along the road in metres.
    pub s_m: f64,
    /// Offset of the own body's centre from the reference line in metres, positive to the left.
    pub d_m: f64,
    /// Own heading against the road in radians.
    pub psi_rad: f64,
    /// Own speed in m/s.
    pub speed_mps: f64,
    /// Own length in metres.
    pub length_m: f64,
    /// The speed it would drive at on a free road, in m/s.
    pub desired_speed_mps: f64,
    /// Own manoeuvre.
    pub manoeuvre: Manoeuvre,
    /// Curvature of the road here in 1/m, positive to the left.
    pub curvature_per_m: f64,
    /// The other vehicles that are known, by identity.
    pub neighbours: Vec<Neighbour>,
}

impl Observation {
    /// Puts own state and tracks (own and shared, both carried on to the same time) on the road.
    ///
    /// # Errors
    /// When a number is not finite.
    pub fn new(road: &Road, own: &OwnMotion, tracks: &[Track]) -> Result<Self, InvalidObservation> {
        let numbers = [
            own.state.pose.x_m,
            own.state.pose.y_m,
            own.state.pose.yaw_rad,
            own.state.speed_mps,
            own.dimensions.length_m,
            own.dimensions.rear_overhang_m,
            own.desired_speed_mps,
        ];
        if !numbers.iter().all(|value| value.is_finite()) {
            return Err(InvalidObservation::OwnState);
        }
        let center = road.to_frenet_pose(own.dimensions.center_pose(own.state.pose));
        Ok(Self {
            lane: own.lane,
            s_m: center.s_m,
            d_m: center.d_m,
            psi_rad: center.psi_rad,
            speed_mps: own.state.speed_mps,
            length_m: own.dimensions.length_m,
            desired_speed_mps: own.desired_speed_mps,
            manoeuvre: own.manoeuvre,
            curvature_per_m: center.curvature_per_m,
            neighbours: tracks
                .iter()
                .map(|track| Neighbour::new(road, track))
                .collect::<Result<_, _>>()?,
        })
    }
}

impl Neighbour {
    fn new(road: &Road, track: &Track) -> Result<Self, InvalidObservation> {
        let state = &track.state;
        let numbers = [
            state.center.x_m,
            state.center.y_m,
            state.center.yaw_rad,
            state.velocity_mps.x,
            state.velocity_mps.y,
            state.length_m,
            state.width_m,
        ];
        if !numbers.iter().all(|value| value.is_finite()) {
            return Err(InvalidObservation::Track(track.id));
        }
        let center = road.to_frenet_pose(state.center);
        let along = road.reference(center.s_m).0.forward();
        let lane = track.lane.or_else(|| road.lane_at(center.d_m));
        let announced_ago_s = track
            .announced_s
            .map(|announced_s| track.time_s - announced_s);
        Ok(Self {
            id: track.id,
            station: track.station,
            lane,
            entering: lane.and_then(|lane| {
                let offset_m = center.d_m - road.lane_center_m(lane);
                entered_lane(lane, offset_m, track.action?, announced_ago_s?)
            }),
            s_m: center.s_m,
            d_m: center.d_m,
            speed_mps: along.dot(&state.velocity_mps),
            speed_std_mps: track.velocity_std_mps,
            length_m: state.length_m,
            width_m: state.width_m,
            age_s: track.time_s - track.measured_s(),
            action: track.action,
        })
    }
}

/// The lane that a vehicle in `lane`, `offset_m` to the left of its centre, enters with `action`:
/// the next one before it crosses the line, `lane` itself when it has crossed it.
fn entered_lane(
    lane: LaneIndex,
    offset_m: f64,
    action: Action,
    announced_ago_s: f64,
) -> Option<LaneIndex> {
    let (next, towards_next_m) = match action {
        Action::ChangeLeft => (lane.left(), offset_m),
        Action::ChangeRight => (lane.right(), -offset_m),
        Action::KeepLane | Action::EmergencyStop => return None,
    };
    let has_crossed = towards_next_m < -CLEAR_OFFSET_M
        || (towards_next_m < CLEAR_OFFSET_M && announced_ago_s > UNDER_WAY_S);
    if has_crossed { Some(lane) } else { next }
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::{ObjectClass, ObjectState, RoadSegment, Se2Pose, Sighting};

    fn lane(index: u8) -> LaneIndex {
        LaneIndex::new(index).expect("a lane")
    }

    fn corner() -> Road {
        let segments = [
            RoadSegment::Straight { length_m: 50.0 },
            RoadSegment::Arc {
                length_m: 100.0,
                curvature_per_m: 1.0 / 80.0,
            },
        ];
        Road::new(Se2Pose::new(7.0, -4.0, 0.4), &segments, 3.5).expect("a road")
    }

    fn own_at(road: &Road, s_m: f64, d_m: f64) -> OwnMotion {
        OwnMotion {
            state: BicycleState {
                pose: road.pose_from_frenet(s_m, d_m, 0.0),
                speed_mps: 14.0,
            },
            dimensions: VehicleDimensions {
                length_m: 4.6,
                width_m: 1.9,
                height_m: 1.5,
                wheelbase_m: 2.7,
                rear_overhang_m: 2.3,
            },
            lane: lane(0),
            desired_speed_mps: 14.0,
            manoeuvre: Manoeuvre::KeepingLane,
        }
    }

    fn track_at(road: &Road, s_m: f64, d_m: f64, speed_mps: f64) -> Track {
        let center = road.pose_from_frenet(s_m, d_m, 0.0);
        Track {
            id: 5,
            station: Some(StationId(9)),
            state: ObjectState {
                center,
                velocity_mps: center.forward() * speed_mps,
                length_m: 4.6,
                width_m: 1.9,
                height_m: 1.5,
                class: ObjectClass::Car,
            },
            time_s: 3.0,
            position_std_m: 0.2,
            velocity_std_mps: 0.5,
            confidence: 1.0,
            lane: None,
            action: None,
            announced_s: None,
            sightings: vec![Sighting {
                station: StationId(9),
                measured_s: 2.8,
            }],
        }
    }

    #[test]
    fn round_the_corner_all_is_along_the_road() {
        let road = corner();
        let tracks = [track_at(&road, 120.0, -3.4, 9.0)];
        let observation =
            Observation::new(&road, &own_at(&road, 40.0, 3.5), &tracks).expect("usable");
        let neighbour = observation.neighbours[0];
        assert!((observation.s_m - 40.0).abs() < 1e-6 && (observation.d_m - 3.5).abs() < 1e-6);
        assert!((neighbour.s_m - 120.0).abs() < 1e-6 && (neighbour.d_m + 3.4).abs() < 1e-6);
        assert!((neighbour.speed_mps - 9.0).abs() < 1e-6);
        assert!((neighbour.age_s - 0.2).abs() < 1e-9);
        assert_eq!(neighbour.lane, Some(lane(2)));
    }

    #[test]
    fn vision_goes_before_geometry() {
        let road = corner();
        let mut track = track_at(&road, 120.0, -1.9, 9.0);
        track.lane = LaneIndex::new(1);
        let own = own_at(&road, 40.0, 3.5);
        let seen = Observation::new(&road, &own, &[track]).expect("usable");
        assert_eq!(seen.neighbours[0].lane, Some(lane(1)));
    }

    #[test]
    fn the_lane_entered_does_not_move_on_with_the_vehicle() {
        let entered = |lane_index, offset_m, ago_s| {
            entered_lane(lane(lane_index), offset_m, Action::ChangeLeft, ago_s)
        };
        assert_eq!(entered(2, 0.0, 0.0), Some(lane(1)));
        assert_eq!(entered(2, 1.5, 2.0), Some(lane(1)));
        assert_eq!(entered(1, -1.5, 3.0), Some(lane(1)));
        assert_eq!(entered(1, -0.1, 4.5), Some(lane(1)));
        assert_eq!(entered(0, 0.0, 0.0), None);
        assert_eq!(entered_lane(lane(1), 0.0, Action::KeepLane, 0.0), None);
    }

    #[test]
    fn what_is_not_finite_is_named() {
        let road = corner();
        let mut own = own_at(&road, 40.0, 3.5);
        let mut track = track_at(&road, 120.0, 0.0, 9.0);
        track.state.center.x_m = f64::NAN;
        let error = Observation::new(&road, &own, &[track]).expect_err("refused");
        assert!(error.to_string().starts_with("track 5 has"));
        own.desired_speed_mps = f64::INFINITY;
        let error = Observation::new(&road, &own, &[]).expect_err("refused");
        assert_eq!(error, InvalidObservation::OwnState);
    }
}
