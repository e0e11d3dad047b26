use covista_world::{BicycleState, LaneIndex, ObjectClass, Road, Se2Pose};
use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, Normal};

use super::mix::{Mix, draw_scale};
use crate::{Footprint, SceneVehicle, VehicleId, VehicleModel};

/// The vehicle with the sensors.
pub(super) const EGO: VehicleId = VehicleId(0);
const AHEAD_M: f64 = 110.0;
const BEHIND_M: f64 = 85.0;
const CLEARANCE_M: f64 = 0.3;

/// (weight, colour) of car paints on European roads.
const PAINTS: [(u32, [u8; 3]); 11] = [
    (22, [232, 233, 234]),
    (12, [176, 180, 184]),
    (18, [98, 102, 106]),
    (20, [22, 22, 24]),
    (8, [36, 62, 120]),
    (4, [20, 28, 58]),
    (6, [150, 22, 26]),
    (3, [186, 172, 146]),
    (3, [36, 70, 52]),
    (2, [204, 120, 30]),
    (2, [214, 190, 60]),
];

/// How the traffic of a lane flows.
#[derive(Debug, Clone, Copy)]
enum Flow {
    Free,
    Dense,
    /// Standing, bumper to bumper.
    Queue,
    /// Free, with some vehicles that have stopped.
    Stops,
}

impl Flow {
    fn draw(rng: &mut impl Rng) -> Self {
        match rng.random_range(0..20) {
            0..10 => Self::Free,
            10..15 => Self::Dense,
            15..17 => Self::Queue,
            _ => Self::Stops,
        }
    }

    fn gap_m(self, rng: &mut impl Rng) -> f64 {
        match self {
            Self::Free | Self::Stops => rng.random_range(10.0..70.0),
            Self::Dense => rng.random_range(4.0..18.0),
            Self::Queue => rng.random_range(1.5..5.0),
        }
    }

    fn speed_mps(self, rng: &mut impl Rng) -> f64 {
        match self {
            Self::Free => rng.random_range(8.0..30.0),
            Self::Dense => rng.random_range(2.0..15.0),
            Self::Queue => 0.0,
            Self::Stops if rng.random_bool(0.4) => 0.0,
            Self::Stops => rng.random_range(5.0..20.0),
        }
    }
}

/// A car, of the kind that carries sensors.
fn draw_car(rng: &mut impl Rng) -> VehicleModel {
    if rng.random_bool(0.6) {
        VehicleModel::Sedan
    } else {
        VehicleModel::Suv
    }
}

/// A model of the simulated traffic: four in five are cars.
pub(crate) fn draw_model(rng: &mut impl Rng) -> VehicleModel {
    match rng.random_range(0..10) {
        0 => VehicleModel::Truck,
        1 => VehicleModel::Van,
        _ => draw_car(rng),
    }
}

/// A realistic paint: large vehicles are mostly white.
pub(crate) fn draw_paint(model: VehicleModel, rng: &mut impl Rng) -> [u8; 3] {
    let large = model.class() == ObjectClass::Truck;
    let base = if large && rng.random_bool(0.6) {
        PAINTS[0].1
    } else {
        let mut ticket = rng.random_range(0..PAINTS.iter().map(|(weight, _)| weight).sum());
        PAINTS
            .iter()
            .find(|(weight, _)| {
                let drawn = ticket < *weight;
                ticket = ticket.saturating_sub(*weight);
                drawn
            })
            .map_or([128; 3], |(_, color)| *color)
    };
    base.map(|channel| channel.saturating_add_signed(rng.random_range(-12..=12)))
}

/// The ego and 3 to 25 other vehicles around `ego_s_m`, none of which overlap.
pub(super) fn draw(rng: &mut impl Rng, road: &Road, ego_s_m: f64) -> Vec<SceneVehicle> {
    let ego_lane = draw_lane(rng);
    let ego_model = draw_car(rng);
    let ego = vehicle(ego_model, Vector3::repeat(1.0), draw_paint(ego_model, rng));
    let mix = if rng.random_bool(0.5) {
        Mix::European
    } else {
        Mix::American
    };
    let mut slots = Vec::new();
    for lane in LaneIndex::all() {
        let flow = Flow::draw(rng);
        let (mut front_m, mut rear_m) = if lane == ego_lane {
            let size = ego.dimensions();
            let rear_m = ego_s_m - size.rear_overhang_m;
            (rear_m + size.length_m, rear_m)
        } else {
            let anywhere_m = ego_s_m + rng.random_range(-15.0..15.0);
            (anywhere_m, anywhere_m)
        };
        while front_m < ego_s_m + AHEAD_M {
            let vehicle = draw_vehicle(rng, mix);
            let size = vehicle.dimensions();
            front_m += flow.gap_m(rng);
            slots.push((
                lane,
                front_m + size.rear_overhang_m,
                vehicle,
                flow.speed_mps(rng),
            ));
            front_m += size.length_m;
        }
        while rear_m > ego_s_m - BEHIND_M {
            let vehicle = draw_vehicle(rng, mix);
            let size = vehicle.dimensions();
            rear_m -= flow.gap_m(rng) + size.length_m;
            slots.push((
                lane,
                rear_m + size.rear_overhang_m,
                vehicle,
                flow.speed_mps(rng),
            ));
        }
    }
    let mut vehicles = Vec::new();
    let ego_speed_mps = rng.random_range(0.0..28.0);
    place(
        rng,
        road,
        &mut vehicles,
        (ego_lane, ego_s_m, ego, ego_speed_mps),
    );
    let wanted = 1 + rng.random_range(3..=25);
    while vehicles.len() < wanted && !slots.is_empty() {
        let slot = slots.swap_remove(rng.random_range(0..slots.len()));
        place(rng, road, &mut vehicles, slot);
    }
    vehicles
}

/// A vehicle that is not yet on the road.
fn draw_vehicle(rng: &mut impl Rng, mix: Mix) -> SceneVehicle {
    let model = mix.draw_model(rng);
    vehicle(model, draw_scale(model, rng), draw_paint(model, rng))
}

fn vehicle(model: VehicleModel, scale: Vector3<f64>, paint: [u8; 3]) -> SceneVehicle {
    SceneVehicle {
        id: EGO,
        model,
        paint,
        scale,
        state: BicycleState {
            pose: Se2Pose::default(),
            speed_mps: 0.0,
        },
    }
}

fn draw_lane(rng: &mut impl Rng) -> LaneIndex {
    LaneIndex::new(rng.random_range(0..covista_world::LANE_COUNT)).unwrap_or(LaneIndex::LEFTMOST)
}

/// Puts a vehicle on the road where it overlaps no other: a little off its lane's centre, or in
/// the middle of a lane change.
fn place(
    rng: &mut impl Rng,
    road: &Road,
    vehicles: &mut Vec<SceneVehicle>,
    (lane, s_m, vehicle, speed_mps): (LaneIndex, f64, SceneVehicle, f64),
) {
    let (mut offset_m, mut psi_rad) = (normal(rng, 0.25), normal(rng, 0.015));
    let neighbours = [lane.left().map(|_| 1.0), lane.right().map(|_| -1.0)];
    let changing = rng.random_bool(0.1) && speed_mps > 3.0;
    if let (true, Some(side)) = (changing, neighbours[rng.random_range(0..2)]) {
        let progress: f64 = rng.random_range(0.0..1.0);
        offset_m += side * progress * road.lane_width_m();
        psi_rad += side * rng.random_range(0.03..0.12) * (1.0 - (2.0 * progress - 1.0).powi(2));
    }
    let pose = road.pose_from_frenet(s_m, road.lane_center_m(lane) + offset_m, psi_rad);
    let own = Footprint::new(pose, vehicle.dimensions(), CLEARANCE_M);
    let free = vehicles
        .iter()
        .all(|other| !own.overlaps(&Footprint::new(other.state.pose, other.dimensions(), 0.0)));
    if free {
        vehicles.push(SceneVehicle {
            id: VehicleId(vehicles.len() as u32),
            state: BicycleState { pose, speed_mps },
            ..vehicle
        });
    }
}

/// A normal draw with this deviation, cut off at two and a half deviations.
fn normal(rng: &mut impl Rng, deviation: f64) -> f64 {
    Normal::new(0.0, deviation).map_or(0.0, |normal| {
        normal.sample(rng).clamp(-2.5 * deviation, 2.5 * deviation)
    })
}
