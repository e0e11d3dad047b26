use covista_world::RoadError;

use crate::VehicleId;

/// Why a ring cannot be set up or driven on; each in one line that says what, where and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RingError {
    /// There is nobody on the road.
    #[error("a ring needs at least one vehicle; set vehicles to 1 or more")]
    NoVehicles,
    /// There are more CAVs than vehicles.
    #[error(
        "{cavs} CAVs among {vehicles} vehicles; set cavs to at most {vehicles}, the CAVs are counted in vehicles"
    )]
    TooManyCavs {
        /// CAVs asked for.
        cavs: usize,
        /// Vehicles asked for.
        vehicles: usize,
    },
    /// A number is not finite or makes no sense.
    #[error("{field} is {value}; set it to a number from {least} to {most}")]
    OutOfRange {
        /// The field of the settings.
        field: &'static str,
        /// Its value.
        value: f64,
        /// The least that is allowed.
        least: f64,
        /// The most that is allowed.
        most: f64,
    },
    /// The loop that vehicles and density ask for is too short or too long.
    #[error(
        "vehicles and density ask for a loop of {period_m:.1} m; change one of them so that it has {least_m} to {most_m} m (length = vehicles * 18.5 m / (3 * density))"
    )]
    Period {
        /// Its length.
        period_m: f64,
        /// The least that is allowed.
        least_m: f64,
        /// The most that is allowed.
        most_m: f64,
    },
    /// The vehicles do not fit on the road outside each other's safe distance.
    #[error(
        "the loop of {period_m:.1} m holds {holds} vehicles outside each other's safe distance, not {vehicles}; take fewer vehicles or a lower density than {density}"
    )]
    Full {
        /// Vehicles asked for.
        vehicles: usize,
        /// Density asked for.
        density: f64,
        /// Length of the loop.
        period_m: f64,
        /// How many it holds.
        holds: usize,
    },
    /// Not every CAV has one control input.
    #[error(
        "{given} control inputs for {cavs} CAVs; give one for each CAV, in the order of their ids"
    )]
    Inputs {
        /// Inputs given.
        given: usize,
        /// CAVs there are.
        cavs: usize,
    },
    /// A CAV has driven to the end of the unrolled road.
    #[error(
        "vehicle {} has driven {way_m:.0} m, to the end of the road; raise duration_s or end the episode sooner", .id.0
    )]
    RoadEnds {
        /// Which one.
        id: VehicleId,
        /// How far it came.
        way_m: f64,
    },
    /// The road cannot be built.
    #[error(transparent)]
    Road(#[from] RoadError),
}
