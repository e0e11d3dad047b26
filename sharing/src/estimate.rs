use std::collections::VecDeque;

use covista_world::{ObjectClass, StationId, wrap_angle};
use nalgebra::{Matrix2, Rotation2, Vector2, Vector3};

use crate::{TrackerSettings, filter::KalmanFilter};

/// Measurements this much older than the newest can no longer be reordered.
const REORDER_S: f64 = 2.0;
/// Consecutive measurements consistent with standstill that make an object a standing one.
const STANDING_HITS: u32 = 2;
const STANDSTILL_STD_MPS: f64 = 0.2;
/// Below this standard deviation, each axis, a velocity is known at all.
const KNOWN_VELOCITY_STD_MPS: f64 = 2.0;
/// chi-squared, two degrees of freedom, 95 %.
const CONSISTENT: f64 = 5.99;
/// A standing object's position grows uncertain by this much a second.
const STANDING_DRIFT_M2PS: f64 = 0.01;
/// Above this speed an object's velocity tells its front from its rear.
const HEADING_SPEED_MPS: f64 = 3.0;

/// One station's measurement of one object, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Measurement {
    pub time_s: f64,
    pub station: StationId,
    pub position: Vector2<f64>,
    pub position_std_m: f64,
    pub yaw_rad: f64,
    /// Length, width, height.
    pub size_m: Vector3<f64>,
    pub class: ObjectClass,
    /// How sure the station is that it exists, in [0, 1].
    pub score: f64,
    /// The station's own estimate of the velocity and its standard deviation; it only starts a
    /// filter, for it is made of the same positions that are reported one by one.
    pub velocity: Option<(Vector2<f64>, f64)>,
}

/// What a sequence of measurements tells of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Belief {
    pub filter: KalmanFilter,
    pub yaw_rad: f64,
    pub size_m: Vector3<f64>,
    pub class: ObjectClass,
    standing_hits: u32,
}

impl Belief {
    fn start(z: &Measurement, settings: &TrackerSettings) -> Self {
        let rotation = Rotation2::new(z.yaw_rad);
        let unknown = Matrix2::from_diagonal(&Vector2::new(
            settings.unknown_speed_std_mps.powi(2),
            settings.unknown_drift_std_mps.powi(2),
        ));
        let (velocity, covariance) = match z.velocity {
            Some((velocity, std)) if std < settings.unknown_speed_std_mps => {
                (velocity, Matrix2::identity() * std.powi(2))
            }
            _ => (
                Vector2::zeros(),
                rotation.matrix() * unknown * rotation.matrix().transpose(),
            ),
        };
        let stands = z.velocity.is_some_and(|(velocity, std)| {
            velocity.norm() < settings.standing_speed_mps && std <= STANDSTILL_STD_MPS
        });
        Self {
            filter: KalmanFilter::new(z.time_s, z.position, z.position_std_m, velocity, covariance),
            yaw_rad: wrap_angle(z.yaw_rad),
            size_m: z.size_m,
            class: z.class,
            standing_hits: if stands { STANDING_HITS } else { 0 },
        }
    }

    fn updated(&self, z: &Measurement, settings: &TrackerSettings) -> Self {
        let mut filter = self
            .filter
            .predicted(z.time_s, settings.process_noise_m2ps3)
            .with_position(z.position, z.position_std_m);
        // Stations that measure at the same time tell nothing of the motion.
        let later = u32::from(z.time_s > self.filter.time_s);
        let standing_hits = if may_stand(&filter, settings) {
            self.standing_hits.saturating_add(later)
        } else {
            0
        };
        if standing_hits >= STANDING_HITS {
            filter = filter.at_standstill(STANDSTILL_STD_MPS);
        }
        Self {
            filter,
            yaw_rad: heading(self.yaw_rad, z.yaw_rad, filter.velocity()),
            size_m: self.size_m.lerp(&z.size_m, 0.3),
            class: z.class,
            standing_hits,
        }
    }

    /// Whether the object stood still when it was last measured.
    pub fn stands(&self) -> bool {
        self.standing_hits >= STANDING_HITS
    }

    /// The belief at `time_s`: an object that stood still is taken to stand still.
    pub fn predicted(&self, time_s: f64, settings: &TrackerSettings) -> Self {
        let mut filter = self.filter;
        if self.stands() {
            let grown = STANDING_DRIFT_M2PS * (time_s - filter.time_s).abs();
            filter.time_s = time_s;
            for axis in 0..2 {
                filter.covariance[(axis, axis)] += grown;
                filter.mean[axis + 2] = 0.0;
            }
        } else {
            filter = filter.predicted(time_s, settings.process_noise_m2ps3);
        }
        Self { filter, ..*self }
    }

    /// Of the more uncertain axis.
    pub fn velocity_std_mps(&self) -> f64 {
        self.filter
            .velocity_covariance()
            .symmetric_eigenvalues()
            .max()
            .max(0.0)
            .sqrt()
    }
}

/// Whether the velocity is known, small, and consistent with zero.
fn may_stand(filter: &KalmanFilter, settings: &TrackerSettings) -> bool {
    let velocity = filter.velocity();
    let covariance = filter.velocity_covariance();
    let Some(information) = covariance.try_inverse() else {
        return false;
    };
    covariance.trace() < 2.0 * KNOWN_VELOCITY_STD_MPS.powi(2)
        && velocity.norm() < settings.standing_speed_mps
        && velocity.dot(&(information * velocity)) < CONSISTENT
}

/// The old heading drawn towards the box's axis; the velocity decides which way is forward.
fn heading(old_rad: f64, box_rad: f64, velocity: Vector2<f64>) -> f64 {
    let forward_rad = if velocity.norm() > HEADING_SPEED_MPS {
        velocity.y.atan2(velocity.x)
    } else {
        old_rad
    };
    let towards = |angle_rad: f64, reference_rad: f64| {
        if wrap_angle(angle_rad - reference_rad).abs() > std::f64::consts::FRAC_PI_2 {
            angle_rad + std::f64::consts::PI
        } else {
            angle_rad
        }
    };
    let (old_rad, box_rad) = (towards(old_rad, forward_rad), towards(box_rad, forward_rad));
    wrap_angle(old_rad + 0.5 * wrap_angle(box_rad - old_rad))
}

/// The belief that a set of measurements gives, whatever the order they came in.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Estimate {
    /// What the measurements before the window told.
    base: Option<Belief>,
    /// Recent measurements by time and station, each with what it and all before it tell.
    window: VecDeque<(Measurement, Belief)>,
    belief: Belief,
}

impl Estimate {
    pub fn new(first: Measurement, settings: &TrackerSettings) -> Self {
        let belief = Belief::start(&first, settings);
        Self {
            base: None,
            belief,
            window: VecDeque::from([(first, belief)]),
        }
    }

    pub fn belief(&self) -> &Belief {
        &self.belief
    }

    pub fn newest(&self) -> Option<&Measurement> {
        self.window.back().map(|(z, _)| z)
    }

    /// Mean score of the recent measurements.
    pub fn mean_score(&self) -> f64 {
        let sum: f64 = self.window.iter().map(|(z, _)| z.score).sum();
        sum / self.window.len().max(1) as f64
    }

    /// Takes up a measurement; one that is known already, or too old to be put in its place,
    /// changes nothing.
    pub fn add(&mut self, z: Measurement, settings: &TrackerSettings) {
        let key = |z: &Measurement| (z.time_s, z.station);
        let place = (self.window).partition_point(|(other, _)| key(other) < key(&z));
        let known = (self.window.get(place)).is_some_and(|(other, _)| key(other) == key(&z));
        if known || self.base.is_some_and(|base| z.time_s < base.filter.time_s) {
            return;
        }
        self.window.insert(place, (z, self.belief));
        let before = place.checked_sub(1).map(|before| self.window[before].1);
        let mut belief = before.or(self.base);
        for (z, told) in self.window.range_mut(place..) {
            *told = extended(belief, z, settings);
            belief = Some(*told);
        }
        self.belief = belief.unwrap_or(self.belief);
        let newest_s = self.newest().map_or(z.time_s, |newest| newest.time_s);
        let settled =
            (self.window).partition_point(|(other, _)| other.time_s < newest_s - REORDER_S);
        if let Some((_, told)) = self.window.drain(..settled).next_back() {
            self.base = Some(told);
        }
    }

    /// Takes up the recent measurements of `other`.
    pub fn absorb(&mut self, other: &Self, settings: &TrackerSettings) {
        for &(z, _) in &other.window {
            self.add(z, settings);
        }
    }
}

fn extended(belief: Option<Belief>, z: &Measurement, settings: &TrackerSettings) -> Belief {
    match belief {
        Some(belief) => belief.updated(z, settings),
        None => Belief::start(z, settings),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal};

    fn at(time_s: f64, station: u32, x_m: f64, y_m: f64) -> Measurement {
        Measurement {
            time_s,
            station: StationId(station),
            position: Vector2::new(x_m, y_m),
            position_std_m: 0.3,
            yaw_rad: 0.0,
            size_m: Vector3::new(4.6, 1.9, 1.5),
            class: ObjectClass::Car,
            score: 0.7,
            velocity: None,
        }
    }

    #[test]
    fn velocity_error_is_what_the_covariance_says() {
        let settings = TrackerSettings::default();
        let noise = Normal::new(0.0, settings.position_std_m).expect("a distribution");
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let (mut squared, mut variance, mut count) = (0.0, 0.0, 0.0);
        for _ in 0..200 {
            let mut measure = |i: i32| {
                let t = 0.5 * f64::from(i);
                at(
                    t,
                    1,
                    14.0 * t + noise.sample(&mut rng),
                    noise.sample(&mut rng),
                )
            };
            let mut estimate = Estimate::new(measure(0), &settings);
            for i in 1..8 {
                estimate.add(measure(i), &settings);
            }
            let filter = estimate.belief().filter;
            squared += (filter.velocity().x - 14.0).powi(2);
            variance += filter.velocity_covariance()[(0, 0)];
            count += 1.0;
        }
        // The model allows for acceleration that this target has not: the error lies below.
        let (rmse, predicted) = ((squared / count).sqrt(), (variance / count).sqrt());
        assert!(rmse < predicted, "{rmse} {predicted}");
        assert!(rmse < 0.8, "{rmse}");
    }

    #[test]
    fn the_order_of_arrival_does_not_matter() {
        let settings = TrackerSettings::default();
        let measurements: Vec<_> = (0..7_u32)
            .map(|i| {
                let t = 0.25 * f64::from(i);
                at(
                    t,
                    i % 2,
                    14.0 * t + 0.1 * f64::from(i % 3),
                    0.05 * f64::from(i % 4),
                )
            })
            .collect();
        let estimate_in = |order: [usize; 7]| {
            let mut estimate = Estimate::new(measurements[order[0]], &settings);
            for &i in &order[1..] {
                estimate.add(measurements[i], &settings);
            }
            estimate
        };
        let sorted = estimate_in([0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(sorted, estimate_in([6, 2, 0, 5, 1, 4, 3]));
        assert_eq!(sorted, estimate_in([0, 2, 1, 4, 3, 6, 5]));
    }

    #[test]
    fn a_measurement_counts_once() {
        let settings = TrackerSettings::default();
        let mut estimate = Estimate::new(at(0.0, 1, 0.0, 0.0), &settings);
        estimate.add(at(0.5, 1, 7.0, 0.0), &settings);
        let before = estimate.clone();
        estimate.add(at(0.5, 1, 7.0, 0.0), &settings);
        assert_eq!(before, estimate);
    }

    #[test]
    fn standing_is_noticed_and_starting_too() {
        let settings = TrackerSettings::default();
        let mut estimate = Estimate::new(at(0.0, 1, 0.1, 0.0), &settings);
        for i in 1..4 {
            let jitter = 0.15 * f64::from(i % 2);
            estimate.add(at(0.5 * f64::from(i), 1, jitter, -jitter), &settings);
        }
        assert!(estimate.belief().stands());
        let later = estimate.belief().predicted(11.5, &settings);
        assert!(
            later.filter.position().norm() < 0.3
                && later.filter.position_covariance()[(0, 0)] < 0.36
        );
        for i in 1..6 {
            let t = 0.5 * f64::from(i);
            estimate.add(at(1.5 + t, 1, t * t, 0.0), &settings);
        }
        assert!(!estimate.belief().stands());
        let speed = estimate.belief().filter.velocity().x;
        assert!((speed - 5.0).abs() < 1.2, "{speed}");
    }

    #[test]
    fn seen_by_several_at_once_is_not_seen_to_stand() {
        let settings = TrackerSettings::default();
        let mut estimate = Estimate::new(at(0.0, 1, 0.0, 0.0), &settings);
        for station in 2..6 {
            estimate.add(at(0.0, station, 0.1, 0.0), &settings);
        }
        assert!(!estimate.belief().stands());
        assert!(estimate.belief().velocity_std_mps() > 5.0);
    }

    #[test]
    fn a_box_turned_round_keeps_the_heading_of_its_motion() {
        let settings = TrackerSettings::default();
        let mut estimate = Estimate::new(
            Measurement {
                yaw_rad: std::f64::consts::PI,
                ..at(0.0, 1, 0.0, 0.0)
            },
            &settings,
        );
        estimate.add(at(0.5, 1, 7.0, 0.0), &settings);
        assert!(estimate.belief().yaw_rad.abs() < 1e-9);
    }
}
