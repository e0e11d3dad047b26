use covista_world::ObjectClass;
use rand::Rng;

use crate::VehicleModel;

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

/// A car, of the kind that carries sensors.
pub(super) fn draw_car(rng: &mut impl Rng) -> VehicleModel {
    if rng.random_bool(0.6) {
        VehicleModel::Sedan
    } else {
        VehicleModel::Suv
    }
}

/// Any model: four in five are cars.
pub(crate) fn draw_model(rng: &mut impl Rng) -> VehicleModel {
    match rng.random_range(0..10) {
        0 => VehicleModel::Truck,
        1 => VehicleModel::Van,
        _ => draw_car(rng),
    }
}

/// A realistic paint: vans and trucks are mostly white.
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
