//! A street between houses: parked cars, curbs, gardens, people.

use std::f64::consts::{FRAC_PI_2, PI};

use covista_world::{LaneIndex, Road};
use nalgebra::Vector3;
use rand::Rng;

use super::{
    Draft,
    course::Course,
    fleet, ground,
    mix::Mix,
    plots,
    plots::Plot,
    sidewalk,
    site::Site,
    traffic::{DrivenLane, Slot, add, draw_slots, normal},
};
use crate::{MarkStyle, RoadMarkings, SceneVehicle, VehicleModel};

const GRADE_MAX: f64 = 0.10;
const PARKED_M: [f64; 2] = [-45.0, 80.0];
const VEHICLES_MAX: usize = 60;
const BELOW_SIDEWALK_M: f64 = 0.5;

/// How cars are parked on one side.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Parking {
    None,
    /// Along the curb, in the outer lane.
    Lane,
    /// Half on a lowered sidewalk.
    Curb,
    /// Along the curb, in a strip beside the road.
    Strip,
    /// Side by side, at this angle to the road.
    Bays(f64),
}

/// One side of the street, in offsets |d| from the road's middle.
pub(super) struct Side {
    /// +1 the left one.
    pub side: f64,
    pub curb_m: f64,
    pub curb_height_m: f64,
    /// Width of the sidewalk.
    pub sidewalk_m: f64,
    parking: Parking,
}

impl Side {
    fn draw(rng: &mut impl Rng, side: f64, half_road_m: f64) -> Self {
        let parking = match rng.random_range(0..20) {
            0..8 => Parking::Lane,
            8..12 => Parking::Curb,
            12..14 => Parking::Strip,
            14..17 => Parking::Bays(match rng.random_range(0..3) {
                0 => rng.random_range(0.7..1.1),
                _ => FRAC_PI_2,
            }),
            _ => Parking::None,
        };
        let extra_m = match parking {
            Parking::None | Parking::Lane => rng.random_range(0.0..0.5),
            Parking::Curb => 0.0,
            Parking::Strip => rng.random_range(2.1..2.5),
            Parking::Bays(_) => rng.random_range(4.8..5.6),
        };
        let curb_height_m = match parking {
            Parking::Curb => rng.random_range(0.02..0.05),
            _ => rng.random_range(0.08..0.15),
        };
        Self {
            side,
            curb_m: half_road_m + extra_m,
            curb_height_m,
            sidewalk_m: rng.random_range(0.9..3.8),
            parking,
        }
    }

    /// Where the plots begin.
    pub fn front_m(&self) -> f64 {
        self.curb_m + self.sidewalk_m
    }

    /// A row of parked vehicles.
    fn draw_parked(
        &self,
        rng: &mut impl Rng,
        road: &Road,
        [from_m, to_m]: [f64; 2],
        slots: &mut Vec<Slot>,
    ) {
        let occupancy = rng.random_range(0.25..1.0);
        let against = rng.random_range(0.0..0.5);
        let mut s_m = from_m + rng.random_range(0.0..5.0);
        while s_m < to_m && self.parking != Parking::None {
            let model = Mix::European.draw_model(rng);
            let turned = rng.random_bool(if self.side > 0.0 {
                1.0 - against
            } else {
                against
            });
            let slot = self.draw_slot(rng, road, s_m, model, turned);
            let size = slot.dimensions();
            s_m += match self.parking {
                Parking::Bays(angle) => size.width_m / angle.sin() + rng.random_range(0.5..1.1),
                _ => size.length_m + rng.random_range(0.4..1.5),
            };
            if rng.random_bool(occupancy) {
                slots.push(slot);
            }
            if rng.random_bool(0.08) {
                s_m += rng.random_range(3.0..15.0);
            }
        }
    }

    /// A parked vehicle that begins at `s_m`, its front ahead or, `turned`, behind.
    fn draw_slot(
        &self,
        rng: &mut impl Rng,
        road: &Road,
        s_m: f64,
        model: VehicleModel,
        turned: bool,
    ) -> Slot {
        let askew = if rng.random_bool(0.2) { 0.12 } else { 0.02 };
        let jitter = normal(rng, askew);
        let gap_m = rng.random_range(0.1..0.45);
        let onto_m = rng.random_range(-0.2..0.6);
        Slot::new(rng, model, 0.0, |size| {
            let along_m = s_m + size.length_m / 2.0;
            let (s_m, d_m, yaw_rad) = match self.parking {
                Parking::Bays(angle) => {
                    let half_m = size.length_m / 2.0 * angle.sin();
                    let outwards = self.side * angle;
                    (s_m + size.width_m, self.curb_m - gap_m - half_m, outwards)
                }
                Parking::Curb => (along_m, self.curb_m + onto_m - size.width_m / 2.0, 0.0),
                _ => (along_m, self.curb_m - gap_m - size.width_m / 2.0, 0.0),
            };
            let turn = if turned { PI } else { 0.0 };
            let center = road.pose_from_frenet(s_m, self.side * d_m, yaw_rad + turn + jitter);
            let axle_m = size.rear_overhang_m - size.length_m / 2.0;
            center.compose(covista_world::Se2Pose::new(axle_m, 0.0, 0.0))
        })
    }
}

/// The lanes that are driven in, and those of oncoming traffic among them.
struct Driven {
    ego_lane: LaneIndex,
    oncoming: Option<LaneIndex>,
}

impl Driven {
    fn draw(rng: &mut impl Rng, [right, left]: [Parking; 2]) -> Self {
        let middle = LaneIndex::LEFTMOST.right();
        let on_the_right = right != Parking::Lane && rng.random_bool(0.4);
        let ego_lane = middle
            .filter(|_| !on_the_right)
            .unwrap_or(LaneIndex::RIGHTMOST);
        let oncoming = ego_lane
            .left()
            .filter(|lane| lane.left().is_some() || left != Parking::Lane);
        Self { ego_lane, oncoming }
    }

    /// Offsets d (right, left) of the band that is kept free of scenery.
    fn band_m(&self, road: &Road) -> [f64; 2] {
        let leftmost = self.oncoming.unwrap_or(self.ego_lane);
        [
            road.lane_bounds_m(self.ego_lane).0,
            road.lane_bounds_m(leftmost).1,
        ]
    }
}

pub(super) fn draw(rng: &mut impl Rng) -> Draft {
    let course = Course::draw(rng, 2.3..3.2);
    let half_road_m = course.road.mark_offset_m(0);
    let sides = [-1.0, 1.0].map(|side| Side::draw(rng, side, half_road_m));
    let driven = Driven::draw(rng, [sides[0].parking, sides[1].parking]);
    let paved_m = [-sides[0].front_m(), sides[1].front_m()];
    let terrain = ground::draw(rng, &course, paved_m, GRADE_MAX);
    let plots = sides.each_ref().map(|_| plots::draw(rng, course.ego_s_m));
    let vehicles = draw_vehicles(rng, &course, &driven, &sides, &plots);
    let mut site = Site {
        road: &course.road,
        terrain: &terrain,
        driven_m: driven.band_m(&course.road),
        vehicles: &vehicles,
        bodies: Vec::new(),
    };
    for (side, plots) in sides.iter().zip(&plots) {
        sidewalk::draw(rng, &mut site, course.ego_s_m, side);
        plots::furnish(rng, &mut site, side, plots);
    }
    Draft {
        markings: draw_markings(
            rng,
            &driven,
            [&sides[1], &sides[0]].map(|side| side.curb_m - half_road_m),
        ),
        scenery: site.bodies,
        terrain,
        vehicles,
        course,
    }
}

/// The ego, a few moving vehicles, parked ones along both sides and in driveways.
fn draw_vehicles(
    rng: &mut impl Rng,
    course: &Course,
    driven: &Driven,
    sides: &[Side; 2],
    plots: &[Vec<Plot>; 2],
) -> Vec<SceneVehicle> {
    let (road, mut vehicles) = (&course.road, Vec::new());
    let ego_d_m = road.lane_center_m(driven.ego_lane) + normal(rng, 0.1);
    let wander_rad = if rng.random_bool(0.2) { 0.08 } else { 0.02 };
    let ego = Slot {
        model: fleet::draw_car(rng),
        scale: Vector3::repeat(1.0),
        pose: road.pose_from_frenet(course.ego_s_m, ego_d_m, normal(rng, wander_rad)),
        speed_mps: rng.random_range(0.0..14.0),
    };
    add(rng, &mut vehicles, &ego);
    let mut parked = Vec::new();
    for (side, plots) in sides.iter().zip(plots) {
        let reach_m = PARKED_M.map(|reach_m| course.ego_s_m + reach_m);
        side.draw_parked(rng, road, reach_m, &mut parked);
        for plot in plots.iter().filter(|plot| plot.has_car) {
            parked.push(draw_driveway_car(rng, road, side, plot));
        }
    }
    let lane = |lane: LaneIndex, oncoming: bool| DrivenLane {
        d_m: road.lane_center_m(lane),
        oncoming,
        neighbours: [false; 2],
    };
    let own = lane(driven.ego_lane, false);
    let lanes: Vec<_> = std::iter::once(own)
        .chain(driven.oncoming.map(|other| lane(other, true)))
        .collect();
    let reach_m = PARKED_M.map(|reach_m| course.ego_s_m + reach_m);
    let mut moving = draw_slots(rng, road, &lanes, Mix::European, reach_m);
    for _ in 0..rng.random_range(0..5) {
        if !moving.is_empty() {
            let mut slot = moving.swap_remove(rng.random_range(0..moving.len()));
            slot.speed_mps = slot.speed_mps.min(15.0);
            add(rng, &mut vehicles, &slot);
        }
    }
    while vehicles.len() < VEHICLES_MAX && !parked.is_empty() {
        let slot = parked.swap_remove(rng.random_range(0..parked.len()));
        add(rng, &mut vehicles, &slot);
    }
    vehicles
}

/// A car in front of a garage, its nose or its tail to the street.
fn draw_driveway_car(rng: &mut impl Rng, road: &Road, side: &Side, plot: &Plot) -> Slot {
    let out_m = side.front_m() + rng.random_range(0.3..2.5);
    let yaw_rad = if rng.random_bool(0.5) {
        FRAC_PI_2
    } else {
        -FRAC_PI_2
    } + normal(rng, 0.05);
    let model = Mix::European.draw_model(rng);
    Slot::new(rng, model, 0.0, |size| {
        let d_m = side.side * (out_m + size.length_m / 2.0);
        let center = road.pose_from_frenet(plot.driveway_m(), d_m, yaw_rad);
        let axle_m = size.rear_overhang_m - size.length_m / 2.0;
        center.compose(covista_world::Se2Pose::new(axle_m, 0.0, 0.0))
    })
}

/// Mostly none; else a dashed line between the two directions, edge lines, or both.
///
/// The pavement goes on a little below the sidewalks, which begin `to_curb_m` (left, right) beyond
/// the outermost marks.
fn draw_markings(rng: &mut impl Rng, driven: &Driven, to_curb_m: [f64; 2]) -> RoadMarkings {
    use MarkStyle::{Dashed, None, Solid};
    let mut styles = [None; 4];
    let divides = usize::from(driven.ego_lane.get());
    let kind = rng.random_range(0..20);
    if matches!(kind, 11..18) {
        styles[divides] = Dashed;
    }
    if matches!(kind, 16..20) {
        styles[0] = Solid;
        styles[3] = Solid;
    }
    RoadMarkings {
        styles,
        paint_width_m: rng.random_range(0.1..0.15),
        dash_m: 3.0,
        dash_period_m: if rng.random_bool(0.5) { 9.0 } else { 12.0 },
        shoulders_m: to_curb_m.map(|shoulder_m| shoulder_m + BELOW_SIDEWALK_M),
        ..RoadMarkings::default()
    }
}
