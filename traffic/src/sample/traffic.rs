use covista_world::{BicycleState, Road, Se2Pose, VehicleDimensions};
use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, Normal};

use super::fleet::draw_paint;
use super::mix::{Mix, draw_scale};
use crate::{Footprint, SceneVehicle, VehicleId, VehicleModel};

const CLEARANCE_M: f64 = 0.3;

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

/// A lane that vehicles drive in.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrivenLane {
    /// Offset d of its centre.
    pub d_m: f64,
    /// Whether its traffic comes towards the ego.
    pub oncoming: bool,
    /// Whether one can change to the lane on the left, on the right of the reference line.
    pub neighbours: [bool; 2],
}

/// A vehicle before its paint: what it is, where, how fast.
pub(super) struct Slot {
    pub model: VehicleModel,
    pub scale: Vector3<f64>,
    pub pose: Se2Pose,
    pub speed_mps: f64,
}

impl Slot {
    /// A slot of a drawn size, posed by its dimensions.
    pub fn new(
        rng: &mut impl Rng,
        model: VehicleModel,
        speed_mps: f64,
        pose: impl FnOnce(VehicleDimensions) -> Se2Pose,
    ) -> Self {
        let mut slot = Self {
            model,
            scale: draw_scale(model, rng),
            pose: Se2Pose::default(),
            speed_mps,
        };
        slot.pose = pose(slot.dimensions());
        slot
    }

    pub fn dimensions(&self) -> VehicleDimensions {
        self.vehicle(VehicleId(0), [0; 3]).dimensions()
    }

    fn vehicle(&self, id: VehicleId, paint: [u8; 3]) -> SceneVehicle {
        SceneVehicle {
            id,
            model: self.model,
            paint,
            scale: self.scale,
            state: BicycleState {
                pose: self.pose,
                speed_mps: self.speed_mps,
            },
        }
    }
}

/// Adds a vehicle where it overlaps no other.
pub(super) fn add(rng: &mut impl Rng, vehicles: &mut Vec<SceneVehicle>, slot: &Slot) -> bool {
    let own = Footprint::new(slot.pose, slot.dimensions(), CLEARANCE_M);
    let free = vehicles
        .iter()
        .all(|other| !own.overlaps(&Footprint::new(other.state.pose, other.dimensions(), 0.0)));
    if free {
        let id = VehicleId(vehicles.len() as u32);
        vehicles.push(slot.vehicle(id, draw_paint(slot.model, rng)));
    }
    free
}

/// Where vehicles could be in the lanes, from the ego's surroundings outwards.
pub(super) fn draw_slots(
    rng: &mut impl Rng,
    road: &Road,
    lanes: &[DrivenLane],
    mix: Mix,
    [from_m, to_m]: [f64; 2],
) -> Vec<Slot> {
    let mut slots = Vec::new();
    for &lane in lanes {
        let flow = Flow::draw(rng);
        let mut free_m = from_m + rng.random_range(0.0..20.0);
        while free_m < to_m {
            let model = mix.draw_model(rng);
            let speed_mps = flow.speed_mps(rng);
            let (offset_m, psi_rad) = draw_offset(rng, road, lane, speed_mps);
            let slot = Slot::new(rng, model, speed_mps, |size| {
                let (turn, axle_m) = if lane.oncoming {
                    (std::f64::consts::PI, size.length_m - size.rear_overhang_m)
                } else {
                    (0.0, size.rear_overhang_m)
                };
                road.pose_from_frenet(free_m + axle_m, lane.d_m + offset_m, psi_rad + turn)
            });
            free_m += slot.dimensions().length_m + flow.gap_m(rng);
            slots.push(slot);
        }
    }
    slots
}

/// A little off the lane's centre, or in the middle of a lane change.
fn draw_offset(rng: &mut impl Rng, road: &Road, lane: DrivenLane, speed_mps: f64) -> (f64, f64) {
    let (mut offset_m, mut psi_rad) = (normal(rng, 0.25), normal(rng, 0.015));
    let to_left = rng.random_bool(0.5);
    if rng.random_bool(0.1) && speed_mps > 3.0 && lane.neighbours[usize::from(!to_left)] {
        let side = if to_left { 1.0 } else { -1.0 };
        let heading = if lane.oncoming { -side } else { side };
        let progress: f64 = rng.random_range(0.0..1.0);
        offset_m += side * progress * road.lane_width_m();
        psi_rad += heading * rng.random_range(0.03..0.12) * (1.0 - (2.0 * progress - 1.0).powi(2));
    }
    (offset_m, psi_rad)
}

/// A normal draw with this deviation, cut off at two and a half deviations.
pub(super) fn normal(rng: &mut impl Rng, deviation: f64) -> f64 {
    Normal::new(0.0, deviation).map_or(0.0, |normal| {
        normal.sample(rng).clamp(-2.5 * deviation, 2.5 * deviation)
    })
}
