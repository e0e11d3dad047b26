use covista_world::{BicycleState, FrenetPose, LANE_COUNT, LaneIndex};
use rand::{Rng, SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;

use super::{
    RingError, RingSettings, SAFE_DISTANCE_M,
    vehicle::{Mover, RingVehicle},
};
use crate::{
    LoopRoad, VehicleId, VehicleModel,
    human::{Habit, HumanDriver},
    idm::Idm,
    sample::{draw_model, draw_paint},
};

/// Room beyond P_safe to start in the set of the barriers (`docs/safety.md`), for vehicles of the
/// same speed v: `ROOM_M + ROOM_S v + ROOM_S2_PER_M v^2` has the bodies' circles, the noise, errors
/// of perception, and what the process noise costs the brakes.
const ROOM_M: f64 = 0.5;
const ROOM_S: f64 = 0.1;
const ROOM_S2_PER_M: f64 = 0.005;
/// Share of what a lane has left over that may go into that room.
const ROOM_SHARE: f64 = 0.75;
/// Start speed as a share of the speed that the mean gap allows.
const CALM_SHARE: f64 = 0.9;

/// A place to start from.
#[derive(Debug, Clone, Copy)]
struct Slot {
    lane: LaneIndex,
    /// Middle of the body in its lap.
    middle_m: f64,
}

/// Everybody at their start: all at the same speed, further apart than their safe distance.
pub(super) fn place_all(
    settings: &RingSettings,
    road: &LoopRoad,
) -> Result<Vec<RingVehicle>, RingError> {
    let (vehicles, period_m) = (settings.vehicles, road.period_m());
    let lane_holds = (period_m / (SAFE_DISTANCE_M + ROOM_M)).floor() as usize;
    let holds = lane_holds * usize::from(LANE_COUNT);
    if vehicles > holds {
        return Err(RingError::Full {
            vehicles,
            density: settings.density,
            period_m,
            holds,
        });
    }
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let fullest = vehicles.div_ceil(usize::from(LANE_COUNT));
    let speed_mps = start_speed_mps(settings, period_m / fullest as f64);
    let distance_m = start_distance_m(speed_mps);
    let slots = draw_slots(vehicles, period_m, distance_m, &mut rng);
    let place = |(index, slot)| {
        // A stream each: the CAVs' number changes nobody's start, model or wishes.
        rng.set_stream(index as u64 + 1);
        rng.set_word_pos(0);
        let is_cav = index < settings.cavs;
        place(index, is_cav, slot, speed_mps, settings, road, &mut rng)
    };
    Ok(slots.into_iter().enumerate().map(place).collect())
}

/// The speed at which a lane with this mean distance between vehicles runs, a little less than
/// that; and slow enough for everybody's safe distance.
fn start_speed_mps(settings: &RingSettings, mean_m: f64) -> f64 {
    let idm = Idm::treiber2000(settings.desired_speed_mps);
    let gap_m = mean_m - VehicleModel::Sedan.dimensions().length_m;
    let calm_mps = CALM_SHARE * idm.equilibrium_speed_mps(gap_m);
    let room_m = ROOM_SHARE * (mean_m - SAFE_DISTANCE_M);
    let root = (ROOM_S.powi(2) + 4.0 * ROOM_S2_PER_M * (room_m - ROOM_M)).max(0.0);
    let roomy_mps = (root.sqrt() - ROOM_S) / (2.0 * ROOM_S2_PER_M);
    calm_mps.min(roomy_mps).max(0.0)
}

/// Least distance of the bodies' centres at the start.
fn start_distance_m(speed_mps: f64) -> f64 {
    SAFE_DISTANCE_M + ROOM_M + ROOM_S * speed_mps + ROOM_S2_PER_M * speed_mps.powi(2)
}

/// Random places, `distance_m` apart in each lane, the lanes equally full, in random order.
fn draw_slots(vehicles: usize, period_m: f64, distance_m: f64, rng: &mut impl Rng) -> Vec<Slot> {
    let mut lanes: Vec<_> = LaneIndex::all().collect();
    lanes.shuffle(rng);
    let mut slots = Vec::with_capacity(vehicles);
    for (nth, lane) in lanes.into_iter().enumerate() {
        let count = (vehicles + usize::from(LANE_COUNT) - 1 - nth) / usize::from(LANE_COUNT);
        let spare_m = (period_m - count as f64 * distance_m).max(0.0);
        let from_m = rng.random_range(0.0..period_m);
        let mut shares: Vec<f64> = (0..count).map(|_| rng.random_range(0.0..1.0)).collect();
        shares.sort_unstable_by(f64::total_cmp);
        slots.extend(shares.iter().enumerate().map(|(i, share)| Slot {
            lane,
            middle_m: from_m + i as f64 * distance_m + share * spare_m,
        }));
    }
    slots.shuffle(rng);
    slots
}

fn place(
    index: usize,
    is_cav: bool,
    slot: Slot,
    speed_mps: f64,
    settings: &RingSettings,
    road: &LoopRoad,
    rng: &mut ChaCha8Rng,
) -> RingVehicle {
    let drawn = draw_model(rng);
    let idm = Idm::draw_within(
        settings.desired_speed_mps,
        settings.desired_speed_spread,
        settings.idm_spread,
        rng,
    );
    let model = if is_cav { VehicleModel::Sedan } else { drawn };
    let paint = draw_paint(model, rng);
    let dimensions = model.dimensions();
    let period_m = road.period_m();
    let s_m = (slot.middle_m - dimensions.center_ahead_of_axle_m()).rem_euclid(period_m);
    let bend = road.bend(s_m);
    let place = FrenetPose {
        s_m,
        d_m: road.road().lane_center_m(slot.lane),
        psi_rad: 0.0,
        curvature_per_m: bend.curvature_per_m,
    };
    let pose = road.road().pose_from_frenet(period_m + s_m, place.d_m, 0.0);
    RingVehicle {
        id: VehicleId(index as u32 + 1),
        model,
        paint,
        speed_mps,
        accel_mps2: 0.0,
        desired_speed_mps: idm.desired_speed_mps,
        dimensions,
        lap_from_m: period_m,
        place,
        turned_rad: bend.turned_rad,
        mover: if is_cav {
            Mover::Cav(BicycleState { pose, speed_mps })
        } else {
            Mover::Human(HumanDriver::new(
                idm,
                Habit::PASSES,
                slot.lane,
                dimensions.width_m,
            ))
        },
        leader: None,
    }
}
