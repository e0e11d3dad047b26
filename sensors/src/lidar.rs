//! A rotating LIDAR: one ray per beam and column, a return where enough light comes back.

mod draws;
mod strip;
mod surface;
mod table;
#[cfg(test)]
mod tests;
mod turn;

use std::collections::HashMap;

use covista_traffic::VehicleId;
use covista_world::PointCloud;
use rayon::prelude::*;

use crate::{ObjectRef, Viewpoint};

pub use table::LidarError;
use turn::Turn;

/// Columns that one thread fires in a row.
const RUN: u32 = 64;

/// A rotating multi-beam LIDAR, as its beam table says; [`Lidar::builtin`] has some.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Lidar {
    /// Name of the device.
    pub name: String,
    /// Its beams.
    pub beams: Vec<Beam>,
    /// Firings in a turn.
    pub columns: u32,
    /// Turns a second.
    pub rotation_hz: f64,
    /// Whether it turns clockwise, seen from above.
    pub clockwise: bool,
    /// Maximum range in metres.
    pub range_m: f64,
    /// Standard deviation of the range in metres.
    pub range_std_m: f64,
    /// Spread of what the beams add to a range, in metres.
    pub range_bias_std_m: f64,
    /// Returns nearer than this are blanked, in metres.
    pub blank_m: f64,
    /// Weakest return, as reflectance per square metre of range, that the receiver tells from
    /// noise: 2e-5 sees asphalt to about 70 m and a dark car to about 40 m.
    pub weakest_return: f64,
    /// Share of pulses lost whatever they hit.
    pub lost_share: f64,
    /// Spread of the beams' sensitivities, as the logarithm's standard deviation.
    pub sensitivity_std: f64,
    /// Spread of what the beams add to a reflectance.
    pub reflectance_std: f64,
    /// Steps in which the reflectance is reported; 0 for none.
    pub reflectance_step: f64,
    /// How the scene moves during a turn.
    pub motion: Motion,
    /// Which specimen of the device: seeds how its beams differ from the table.
    pub specimen: u64,
}

/// A laser and its receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Elevation above the horizon in radians.
    pub elevation_rad: f64,
    /// Azimuth from that of its column in radians, counter-clockwise.
    pub azimuth_rad: f64,
    /// Height of its origin above that of the LIDAR frame in metres.
    pub height_m: f64,
    /// Standard deviation of a specimen's elevation in radians.
    pub elevation_std_rad: f64,
}

/// How the scene moves while the LIDAR turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Motion {
    /// Not at all: the whole turn is measured at the scene's time.
    #[default]
    Frozen,
    /// All vehicles go on straight ahead at their speed. The beams point backwards half a turn
    /// before the scene's time, ahead at that time, and backwards again half a turn later. Points
    /// are given in the LIDAR frame of the moment they were measured at.
    ///
    /// The viewpoint's rays must be [`crate::RayScene::rolling`] over [`Lidar::half_turn_s`].
    Rolling,
    /// As [`Self::Rolling`], with the points moved into the LIDAR frame of the scene's time: the
    /// ego's own motion is undone.
    Undone,
}

/// What a point was measured on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PointLabel {
    /// The ground.
    Ground,
    /// A vehicle or a body of the scenery.
    Object(ObjectRef),
}

/// A sweep that knows what each of its points was measured on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelledCloud {
    /// The points.
    pub cloud: PointCloud,
    /// What each is a point of, in the same order.
    pub objects: Vec<PointLabel>,
}

impl LabelledCloud {
    /// Points on each vehicle that has any.
    pub fn vehicle_points(&self) -> HashMap<VehicleId, usize> {
        let mut counts = HashMap::new();
        for label in &self.objects {
            if let PointLabel::Object(ObjectRef::Vehicle(id)) = label {
                *counts.entry(*id).or_default() += 1;
            }
        }
        counts
    }
}

impl Lidar {
    /// KITTI's Velodyne HDL-64E.
    pub fn hdl64e() -> Self {
        // The table is built in and read in the tests.
        Self::builtin("hdl-64e").unwrap_or_default()
    }

    /// Longest time in seconds from the scene's time to that of a pulse.
    pub fn half_turn_s(&self) -> f64 {
        match self.motion {
            Motion::Frozen => 0.0,
            Motion::Rolling | Motion::Undone => 0.5 / self.rotation_hz,
        }
    }

    /// One turn: the returns in the LIDAR frame, column by column.
    ///
    /// The same seed gives the same cloud whatever the number of threads.
    pub fn sweep(&self, view: &Viewpoint, seed: u64) -> PointCloud {
        self.sweep_labelled(view, seed).cloud
    }

    /// As [`Self::sweep`], with what each point was measured on.
    pub fn sweep_labelled(&self, view: &Viewpoint, seed: u64) -> LabelledCloud {
        let turn = Turn::new(self, view, seed);
        let runs: Vec<_> = (0..self.columns.div_ceil(RUN))
            .into_par_iter()
            .map(|run| turn.fire(run * RUN..((run + 1) * RUN).min(self.columns)))
            .collect();
        let count = runs.iter().map(|run| run.points.len()).sum();
        let mut points = Vec::with_capacity(count);
        let mut objects = Vec::with_capacity(count);
        for run in runs {
            points.extend(run.points);
            objects.extend(run.labels);
        }
        LabelledCloud {
            cloud: PointCloud { points },
            objects,
        }
    }
}
