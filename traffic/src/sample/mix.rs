use covista_world::ObjectClass;
use nalgebra::Vector3;
use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::VehicleModel;

/// Which vehicles are on the road, and how many of each in a hundred.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mix {
    /// Small cars and estate cars.
    European,
    /// Saloons, sport utility vehicles and pickups.
    American,
}

const EUROPEAN: [(VehicleModel, u32); 12] = [
    (VehicleModel::Hatchback, 32),
    (VehicleModel::Wagon, 15),
    (VehicleModel::CityCar, 13),
    (VehicleModel::Sedan, 11),
    (VehicleModel::Minivan, 9),
    (VehicleModel::Suv, 6),
    (VehicleModel::TwoSeater, 4),
    (VehicleModel::Transporter, 4),
    (VehicleModel::Van, 3),
    (VehicleModel::Truck, 1),
    (VehicleModel::Bus, 1),
    (VehicleModel::Pickup, 1),
];

const AMERICAN: [(VehicleModel, u32); 11] = [
    (VehicleModel::Sedan, 31),
    (VehicleModel::Suv, 25),
    (VehicleModel::Pickup, 10),
    (VehicleModel::Hatchback, 8),
    (VehicleModel::Minivan, 6),
    (VehicleModel::Truck, 6),
    (VehicleModel::Van, 5),
    (VehicleModel::Wagon, 4),
    (VehicleModel::CityCar, 2),
    (VehicleModel::Transporter, 2),
    (VehicleModel::Bus, 1),
];

impl Mix {
    fn weights(self) -> &'static [(VehicleModel, u32)] {
        match self {
            Self::European => &EUROPEAN,
            Self::American => &AMERICAN,
        }
    }

    pub(super) fn draw_model(self, rng: &mut impl Rng) -> VehicleModel {
        let weights = self.weights();
        let mut ticket = rng.random_range(0..weights.iter().map(|(_, weight)| weight).sum());
        for &(model, weight) in weights {
            if ticket < weight {
                return model;
            }
            ticket -= weight;
        }
        VehicleModel::Sedan
    }
}

/// Length, width and height as multiples of the model's: longer ones are mostly wider and higher
/// too, and large vehicles differ the most.
pub(super) fn draw_scale(model: VehicleModel, rng: &mut impl Rng) -> Vector3<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let common = 0.5 * normal();
    most_off(model).map(|most| {
        let own = common + 0.75_f64.sqrt() * normal();
        1.0 + most * (own / 2.0).clamp(-1.0, 1.0)
    })
}

/// How far a scale may be from 1.
fn most_off(model: VehicleModel) -> Vector3<f64> {
    match model.class() {
        ObjectClass::Truck => Vector3::new(0.15, 0.04, 0.10),
        _ => Vector3::new(0.08, 0.05, 0.06),
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn models_are_as_frequent_as_their_weights() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for mix in [Mix::European, Mix::American] {
            let drawn: Vec<_> = (0..20_000).map(|_| mix.draw_model(&mut rng)).collect();
            assert_eq!(
                mix.weights().iter().map(|(_, weight)| weight).sum::<u32>(),
                100
            );
            for &(model, weight) in mix.weights() {
                let share = drawn.iter().filter(|&&other| other == model).count() as f64 / 200.0;
                // Four deviations of the binomial.
                let deviation = (f64::from(weight) * (100.0 - f64::from(weight)) / 2e4).sqrt();
                assert!(
                    (share - f64::from(weight)).abs() < 4.0 * deviation,
                    "{model:?} {share}"
                );
            }
        }
    }

    #[test]
    fn scales_stay_in_bounds_and_go_together() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for model in [VehicleModel::Hatchback, VehicleModel::Truck] {
            let drawn: Vec<_> = (0..20_000)
                .map(|_| {
                    (draw_scale(model, &mut rng) - Vector3::repeat(1.0))
                        .component_div(&most_off(model))
                })
                .collect();
            let mean = |value: &dyn Fn(&Vector3<f64>) -> f64| {
                drawn.iter().map(value).sum::<f64>() / drawn.len() as f64
            };
            assert!(drawn.iter().all(|off| off.amax() <= 1.0 + 1e-9));
            assert!((0..3).all(|axis| mean(&|off| off[axis]).abs() < 0.02));
            assert!((0..3).all(|axis| mean(&|off| off[axis].powi(2)) > 0.2));
            let correlation = mean(&|off| off.x * off.z) / mean(&|off| off.x.powi(2));
            assert!((0.18..0.32).contains(&correlation), "{correlation}");
        }
    }
}
