//! A carriageway of three to five lanes, perhaps with the opposite one behind a median.

use covista_world::{LANE_COUNT, LaneIndex};
use rand::Rng;

use super::{
    Draft,
    course::Course,
    fleet, ground,
    mix::Mix,
    roadside::{self, Verge},
    site::Site,
    traffic::{DrivenLane, Slot, add, draw_slots, normal},
};
use crate::{MarkStyle, PaintColor, RoadMarkings, SceneVehicle};

const GRADE_MAX: f64 = 0.06;
const TRAFFIC_M: [f64; 2] = [-85.0, 110.0];
const VEHICLES_MAX: usize = 45;

/// The lanes of both directions and what lies between and beside them.
struct Carriageways {
    ego_lane: LaneIndex,
    lanes_beyond: [u8; 2],
    /// Offsets d (right, left) of the own carriageway's edges.
    own_m: [f64; 2],
    /// From these edges to the end of the pavement, right and left.
    shoulders_m: [f64; 2],
    opposite: Option<Opposite>,
}

/// The carriageway of oncoming traffic, to the left of the median.
struct Opposite {
    /// Offset d of its edge at the median.
    near_m: f64,
    lanes: u8,
}

impl Carriageways {
    fn draw(rng: &mut impl Rng, course: &Course) -> Self {
        let lane_m = course.road.lane_width_m();
        let count = match rng.random_range(0..10) {
            0..5 => LANE_COUNT,
            5..8 => LANE_COUNT + 1,
            _ => LANE_COUNT + 2,
        };
        let ego = rng.random_range(0..count);
        // The three labelled lanes are centred on the ego's as far as the carriageway allows.
        let first = ego.saturating_sub(1).min(count - LANE_COUNT);
        let lanes_beyond = [first, count - LANE_COUNT - first];
        let edge_m = |beyond: u8| (f64::from(LANE_COUNT) / 2.0 + f64::from(beyond)) * lane_m;
        let own_m = [-edge_m(lanes_beyond[1]), edge_m(lanes_beyond[0])];
        let shoulders_m = [rng.random_range(0.8..3.8), rng.random_range(0.5..3.0)];
        let opposite = rng.random_bool(0.5).then(|| {
            let median_m = if rng.random_bool(0.6) {
                rng.random_range(1.2..3.0)
            } else {
                rng.random_range(5.0..15.0)
            };
            Opposite {
                near_m: own_m[1] + shoulders_m[1] + median_m,
                lanes: rng.random_range(2..=4),
            }
        });
        let room_m = 0.8 / course.road.sharpest_per_m().max(1e-9);
        Self {
            ego_lane: LaneIndex::new(ego - first).unwrap_or(LaneIndex::LEFTMOST),
            lanes_beyond,
            own_m,
            shoulders_m,
            opposite: opposite.filter(|opposite| opposite.far_m(lane_m) + 8.0 < room_m),
        }
    }

    fn paved_m(&self, lane_m: f64) -> [f64; 2] {
        let left_m = self
            .opposite
            .as_ref()
            .map_or(self.own_m[1] + self.shoulders_m[1], |opposite| {
                opposite.far_m(lane_m)
            });
        [self.own_m[0] - self.shoulders_m[0], left_m]
    }

    fn lanes(&self, lane_m: f64) -> Vec<DrivenLane> {
        let row = |count: u8, right_m: f64, oncoming: bool| {
            (0..count).map(move |index| DrivenLane {
                d_m: right_m + (f64::from(index) + 0.5) * lane_m,
                oncoming,
                neighbours: [index + 1 < count, index > 0],
            })
        };
        let own = LANE_COUNT + self.lanes_beyond[0] + self.lanes_beyond[1];
        let opposite = self
            .opposite
            .iter()
            .flat_map(|opposite| row(opposite.lanes, opposite.near_m + 1.0, true));
        row(own, self.own_m[0], false).chain(opposite).collect()
    }
}

impl Opposite {
    /// Offset d of the end of its pavement.
    fn far_m(&self, lane_m: f64) -> f64 {
        self.near_m + f64::from(self.lanes) * lane_m + 3.0
    }
}

pub(super) fn draw(rng: &mut impl Rng) -> Draft {
    let course = Course::draw(rng, 3.3..3.75);
    let lane_m = course.road.lane_width_m();
    let ways = Carriageways::draw(rng, &course);
    let paved_m = ways.paved_m(lane_m);
    let terrain = ground::draw(rng, &course, paved_m, GRADE_MAX);
    let vehicles = draw_vehicles(rng, &course, &ways);
    let mut site = Site {
        road: &course.road,
        terrain: &terrain,
        driven_m: [ways.own_m[0] - 0.3, ways.own_m[1] + 0.3],
        vehicles: &vehicles,
        bodies: Vec::new(),
    };
    if let Some(opposite) = &ways.opposite {
        let inner_m = [ways.own_m[1] + ways.shoulders_m[1], opposite.near_m];
        let outer_m = opposite.far_m(lane_m);
        roadside::draw_median(rng, &mut site, course.ego_s_m, inner_m, outer_m);
    }
    for (side, free_m) in [(1.0, paved_m[1]), (-1.0, -paved_m[0])] {
        let verge = Verge { side, free_m };
        roadside::draw_verge(rng, &mut site, course.ego_s_m, verge);
    }
    roadside::draw_overhead(rng, &mut site, course.ego_s_m, paved_m);
    Draft {
        markings: draw_markings(rng, &ways),
        scenery: site.bodies,
        terrain,
        vehicles,
        course,
    }
}

/// The ego, then others in random order until there are as many as drawn.
fn draw_vehicles(rng: &mut impl Rng, course: &Course, ways: &Carriageways) -> Vec<SceneVehicle> {
    let road = &course.road;
    let ego_d_m = road.lane_center_m(ways.ego_lane) + normal(rng, 0.25);
    let ego = Slot {
        model: fleet::draw_car(rng),
        scale: nalgebra::Vector3::repeat(1.0),
        pose: road.pose_from_frenet(course.ego_s_m, ego_d_m, normal(rng, 0.015)),
        speed_mps: rng.random_range(0.0..28.0),
    };
    let mut vehicles = Vec::new();
    add(rng, &mut vehicles, &ego);
    let lanes = ways.lanes(road.lane_width_m());
    let reach_m = TRAFFIC_M.map(|reach_m| course.ego_s_m + reach_m);
    let mix = if rng.random_bool(0.5) {
        Mix::European
    } else {
        Mix::American
    };
    let mut slots = draw_slots(rng, road, &lanes, mix, reach_m);
    let share = lanes.len() as f64 / f64::from(LANE_COUNT);
    let wanted = 1 + (f64::from(rng.random_range(3..=25)) * share) as usize;
    while vehicles.len() < wanted.min(VEHICLES_MAX) && !slots.is_empty() {
        let slot = slots.swap_remove(rng.random_range(0..slots.len()));
        add(rng, &mut vehicles, &slot);
    }
    vehicles
}

fn draw_markings(rng: &mut impl Rng, ways: &Carriageways) -> RoadMarkings {
    let lanes_beyond = ways.lanes_beyond;
    let [right_m, left_m] = ways.shoulders_m;
    let mut edge = |beyond: u8| match rng.random_range(0..20) {
        _ if beyond > 0 => MarkStyle::Dashed,
        0 => MarkStyle::Double,
        1 => MarkStyle::None,
        _ => MarkStyle::Solid,
    };
    let (left, right) = (edge(lanes_beyond[0]), edge(lanes_beyond[1]));
    let mut inner = || match rng.random_range(0..20) {
        0 => MarkStyle::Solid,
        _ => MarkStyle::Dashed,
    };
    let styles = [left, inner(), inner(), right];
    let mut colors = [PaintColor::White; 4];
    if lanes_beyond[0] == 0 && rng.random_bool(0.5) {
        colors[0] = PaintColor::Yellow;
    }
    let [dash_m, dash_period_m] = match rng.random_range(0..10) {
        0..5 => [3.66, 14.63],
        5 => [3.0, 12.0],
        6..8 => [3.0, 9.0],
        _ => [6.0, 18.0],
    };
    RoadMarkings {
        styles,
        colors,
        paint_width_m: rng.random_range(0.1..0.25),
        dash_m,
        dash_period_m,
        lanes_beyond,
        shoulders_m: [left_m, right_m],
    }
}
