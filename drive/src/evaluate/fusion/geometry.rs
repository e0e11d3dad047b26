//! How far the other numbers of percepts are from those of the labels.

use std::f64::consts::FRAC_PI_2;

use serde::Serialize;

use super::figures::percent;

/// How far a percept's numbers are from those of the labels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Deviation {
    pub true_distance_m: f64,
    pub distance_m: f64,
    pub observation_angle_rad: f64,
    pub rotation_y_rad: f64,
}

/// Errors of the percepts of vehicles that were found and have a label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GeometryErrors {
    /// Nearest distance in the ground plane, in metres.
    pub from_m: f64,
    /// Farthest distance.
    pub to_m: f64,
    /// Vehicles.
    pub vehicles: usize,
    /// Median of the distance's error, its sign dropped.
    pub median_distance_m: Option<f64>,
    /// Its 95th percentile.
    pub p95_distance_m: Option<f64>,
    /// Of the observation angle's, for vehicles that are not reversed.
    pub median_observation_angle_deg: Option<f64>,
    /// Its 95th percentile.
    pub p95_observation_angle_deg: Option<f64>,
    /// Of the rotation's, for vehicles that are not reversed.
    pub median_rotation_y_deg: Option<f64>,
    /// Its 95th percentile.
    pub p95_rotation_y_deg: Option<f64>,
    /// Vehicles whose rotation is off by more than a right angle: front and rear mistaken, in
    /// percent.
    pub reversed: Option<f64>,
}

impl GeometryErrors {
    pub(super) fn new([from_m, to_m]: [f64; 2], deviations: &[Deviation]) -> Self {
        let near: Vec<&Deviation> = deviations
            .iter()
            .filter(|deviation| (from_m..to_m).contains(&deviation.true_distance_m))
            .collect();
        let (upright, reversed): (Vec<&Deviation>, Vec<&Deviation>) = near
            .iter()
            .partition(|deviation| deviation.rotation_y_rad.abs() <= FRAC_PI_2);
        let quantile = |among: &[&Deviation], of: fn(&Deviation) -> f64, share: f64| {
            let mut sizes: Vec<f64> = among.iter().map(|deviation| of(deviation).abs()).collect();
            sizes.sort_by(f64::total_cmp);
            let index = (share * sizes.len() as f64) as usize;
            sizes.get(index.min(sizes.len().saturating_sub(1))).copied()
        };
        let distance = |share| quantile(&near, |deviation| deviation.distance_m, share);
        let degrees =
            |of: fn(&Deviation) -> f64, share| quantile(&upright, of, share).map(f64::to_degrees);
        let observation = |share| degrees(|deviation| deviation.observation_angle_rad, share);
        let rotation = |share| degrees(|deviation| deviation.rotation_y_rad, share);
        Self {
            from_m,
            to_m,
            vehicles: near.len(),
            median_distance_m: distance(0.5),
            p95_distance_m: distance(0.95),
            median_observation_angle_deg: observation(0.5),
            p95_observation_angle_deg: observation(0.95),
            median_rotation_y_deg: rotation(0.5),
            p95_rotation_y_deg: rotation(0.95),
            reversed: percent(reversed.len(), near.len()),
        }
    }
}
