//! Scenario files: their fields here, reading, checking and building in the submodules.

mod build;
mod check;
mod load;

use covista_world::{LaneIndex, RoadSegment};
use serde::Deserialize;

use crate::VehicleModel;

pub(crate) use build::Start;

/// Who moves a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehicleKind {
    /// A connected and automated vehicle: moved by the control input it is given.
    Cav,
    /// A human driver.
    Human,
    /// Nobody: it stands.
    #[serde(skip)]
    Obstacle,
}

/// A scenario file: the road, what stands beside it, who drives on it.
///
/// Positions `s_m` and `d_m` are Frenet coordinates of the road; those of vehicles are of the rear
/// axle. Spreads are the half widths of uniform draws per seed.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Where it was read from: a path or a built-in name.
    #[serde(skip)]
    pub origin: String,
    /// Its name.
    pub name: String,
    /// What happens, in a sentence or two.
    pub description: String,
    /// How long a run lasts.
    pub duration_s: f64,
    /// Time between two frames of a CAV's sensors.
    pub perception_period_s: f64,
    /// Width of a lane.
    pub lane_width_m: f64,
    /// The reference line, from the origin along x.
    pub road: Vec<RoadSegment>,
    /// Concrete walls.
    #[serde(default)]
    pub walls: Vec<WallEntry>,
    /// Barriers and guard rails.
    #[serde(default)]
    pub barriers: Vec<BarrierEntry>,
    /// Rows of poles.
    #[serde(default)]
    pub poles: Vec<PolesEntry>,
    /// Buildings.
    #[serde(default)]
    pub buildings: Vec<BuildingEntry>,
    /// Trees.
    #[serde(default)]
    pub trees: Vec<TreeEntry>,
    /// Vehicles that drive.
    pub vehicles: Vec<DrivenEntry>,
    /// Vehicles that stand for good.
    #[serde(default)]
    pub obstacles: Vec<ObstacleEntry>,
    /// Light and surface.
    pub look: LookEntry,
}

/// `[[walls]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WallEntry {
    /// Where it starts.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// Offset of its face.
    pub d_m: f64,
    /// Height.
    pub height_m: f64,
    /// Thickness.
    pub thickness_m: f64,
}

/// The kinds of barriers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoadsideBarrier {
    /// Concrete of New Jersey shape.
    Jersey,
    /// Steel rail on posts.
    GuardRail,
}

/// `[[barriers]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BarrierEntry {
    /// Its kind.
    pub kind: RoadsideBarrier,
    /// Where it starts.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// Offset of its face.
    pub d_m: f64,
}

/// `[[poles]]`: a row of them.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolesEntry {
    /// Where the first stands.
    pub from_m: f64,
    /// Where the row ends.
    pub to_m: f64,
    /// From one to the next.
    pub spacing_m: f64,
    /// Offset of their middles.
    pub d_m: f64,
    /// Height.
    pub height_m: f64,
    /// Radius.
    pub radius_m: f64,
}

/// `[[buildings]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BuildingEntry {
    /// Where its middle is.
    pub s_m: f64,
    /// Offset of its middle.
    pub d_m: f64,
    /// Along the road.
    pub length_m: f64,
    /// Across the road.
    pub depth_m: f64,
    /// Height.
    pub height_m: f64,
    /// Colour of the plaster, red, green, blue.
    pub color: [u8; 3],
}

/// `[[trees]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TreeEntry {
    /// Where it stands.
    pub s_m: f64,
    /// Offset of its trunk.
    pub d_m: f64,
    /// Height.
    pub height_m: f64,
    /// Radius of the crown.
    pub crown_radius_m: f64,
}

/// `[[vehicles]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrivenEntry {
    /// Who drives: `cav` or `human`.
    pub kind: VehicleKind,
    /// Its model; without it a CAV is a sedan and a human's vehicle is drawn per seed.
    pub model: Option<VehicleModel>,
    /// Its lane: 0 is the leftmost.
    pub lane: LaneIndex,
    /// Where it starts.
    pub s_m: f64,
    /// Spread of where it starts.
    #[serde(default)]
    pub s_spread_m: f64,
    /// Its speed at the start.
    pub speed_mps: f64,
    /// Spread of its speed at the start.
    #[serde(default)]
    pub speed_spread_mps: f64,
    /// The speed it would like to drive.
    pub desired_speed_mps: f64,
}

/// `[[obstacles]]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObstacleEntry {
    /// Its model; without it drawn per seed.
    pub model: Option<VehicleModel>,
    /// Its lane: 0 is the leftmost.
    pub lane: LaneIndex,
    /// Where it stands.
    pub s_m: f64,
    /// Spread of where it stands.
    #[serde(default)]
    pub s_spread_m: f64,
}

/// `[look]`
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LookEntry {
    /// The sun above the horizon.
    pub sun_elevation_deg: f64,
    /// The sun counter-clockwise from the road's first direction.
    pub sun_azimuth_deg: f64,
    /// Share of direct sunlight.
    pub direct_light: f64,
    /// Share of lane paint that is worn off.
    pub paint_wear: f64,
    /// Brightness of the asphalt.
    pub asphalt_albedo: f64,
    /// Extinction per metre.
    pub haze_per_m: f64,
}
