//! Perception by its errors: what the networks would have found of the truth, drawn from
//! parameters that were fitted to them. No picture, no sweep, no network; some rays a vehicle tell
//! how much of it can be seen.

mod draw;
mod quantiles;
mod renewal;
mod table;
mod view;

pub use draw::{DrawnBox, Observer, SeenVehicle};
pub use quantiles::{QUANTILE_SHARES, Quantiles};
pub use table::{
    ErrorModel, ErrorModelError, ErrorSource, FalseBoxRate, FalseBoxes, LaneErrors, LaneShares,
    Lasting, VehicleErrors,
};
