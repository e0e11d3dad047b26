//! The fitted parameters, as a TOML file holds them.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use covista_world::ObjectClass;
use serde::{Deserialize, Serialize};

use super::Quantiles;

const BUILTIN_NAME: &str = "assets/perception/networks.toml";
const BUILTIN: &str = include_str!("../../../assets/perception/networks.toml");

/// What the networks do to vehicles that are there, and what they see where none is: the
/// parameters of the statistical error model, fitted by `covista eval errors`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorModel {
    /// The detector's range in the LIDAR frame in metres: least x and y, greatest x and y.
    pub range_m: [f64; 4],
    /// What it was fitted on.
    pub source: ErrorSource,
    /// How long an error lasts.
    pub lasting: Lasting,
    /// Vehicles, by class, visibility and distance.
    #[serde(rename = "vehicle")]
    pub vehicles: Vec<VehicleErrors>,
    /// The lane index of what is found.
    pub lanes: LaneErrors,
    /// Boxes where no vehicle is.
    pub false_boxes: FalseBoxes,
}

/// What an [`ErrorModel`] was fitted on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorSource {
    /// The command.
    pub command: String,
    /// Version of covista.
    pub version: String,
    /// Day of the fit, year-month-day.
    pub date: String,
    /// Seed of the data set.
    pub data_seed: u64,
    /// Its split.
    pub data_split: String,
    /// Its frames.
    pub frames: usize,
    /// The closed loop that the times of [`Lasting`] were measured in.
    pub closed_loop: String,
    /// SHA-256 of each network's file.
    pub networks: BTreeMap<String, String>,
}

/// Mean times in seconds after which an error is drawn anew: its autocorrelation is
/// exp(-lag / time).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lasting {
    /// Found or missed, and the score.
    pub found_s: f64,
    /// Centre, size and heading of the box.
    pub box_s: f64,
    /// Heading turned round, or the other class.
    pub flip_s: f64,
    /// The lane index.
    pub lane_s: f64,
    /// A false box.
    pub false_box_s: f64,
}

/// Errors on the vehicles of one class in one range of visibility and distance.
///
/// Box errors are found minus true. A direction along or across the vehicle is positive away from
/// the LIDAR.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleErrors {
    /// True class.
    pub class: ObjectClass,
    /// Share of the body in line of sight of the LIDAR.
    pub visibility: [f64; 2],
    /// Distance of the centre from the LIDAR in the plane, in metres.
    pub distance_m: [f64; 2],
    /// Vehicles that the row was fitted on, and how many of them were found.
    pub vehicles: usize,
    /// Those found.
    pub found: usize,
    /// Share that is found.
    pub recall: f64,
    /// Share of those found whose box points backwards.
    pub flipped: f64,
    /// Share of those found that are taken for the other class.
    pub other_class: f64,
    /// The centre's error along the vehicle.
    pub along_m: Quantiles,
    /// The centre's error across the vehicle.
    pub across_m: Quantiles,
    /// The centre's error upwards.
    pub up_m: Quantiles,
    /// The length's error.
    pub length_m: Quantiles,
    /// The width's error.
    pub width_m: Quantiles,
    /// The height's error.
    pub height_m: Quantiles,
    /// The heading's error, front and rear not told apart.
    pub yaw_rad: Quantiles,
    /// Scores of those found.
    pub score: Quantiles,
}

/// The lane index of vehicles that are found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneErrors {
    /// Share of the vehicles that err together with the others of their frame.
    pub shared: f64,
    /// Vehicles found beside the lanes that the share below was fitted on.
    pub beside: usize,
    /// Share of those that are given no lane, which is right.
    pub beside_none: f64,
    /// Vehicles in a lane, by place ahead.
    pub ahead: Vec<LaneShares>,
}

/// The lane index of vehicles in a lane at some distance ahead or behind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaneShares {
    /// x in the LIDAR frame in metres.
    pub ahead_m: [f64; 2],
    /// Vehicles that the row was fitted on.
    pub vehicles: usize,
    /// Share of those whose lane is right.
    pub right: f64,
    /// Share of those that are given no lane; the rest are given a wrong one.
    pub none: f64,
}

/// Boxes where no vehicle is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FalseBoxes {
    /// Boxes that this was fitted on.
    pub boxes: usize,
    /// Share of trucks.
    pub trucks: f64,
    /// Length.
    pub length_m: Quantiles,
    /// Width.
    pub width_m: Quantiles,
    /// Height.
    pub height_m: Quantiles,
    /// z of the centre in the LIDAR frame.
    pub center_z_m: Quantiles,
    /// Heading in the LIDAR frame.
    pub yaw_rad: Quantiles,
    /// Score.
    pub score: Quantiles,
    /// How many there are, by place.
    #[serde(rename = "place")]
    pub places: Vec<FalseBoxRate>,
}

/// How many false boxes there are in one part of the detector's range.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FalseBoxRate {
    /// Distance from the LIDAR in metres.
    pub distance_m: [f64; 2],
    /// To the side of the LIDAR's x axis, left or right, in metres.
    pub beside_m: [f64; 2],
    /// Area of the part.
    pub area_m2: f64,
    /// Boxes a frame.
    pub per_frame: f64,
}

/// Why a file of fitted errors cannot be used; each in one line.
#[derive(Debug, thiserror::Error)]
pub enum ErrorModelError {
    /// The file cannot be read.
    #[error(
        "cannot read the error model {}: {reason}; fit one with `covista eval errors --out FILE`",
        path.display()
    )]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        reason: std::io::Error,
    },
    /// The text is no TOML, or has a field that is unknown, missing or of the wrong type.
    #[error("error model {origin}, line {line}: {message}; correct it, or fit it anew")]
    Syntax {
        /// File or built-in name.
        origin: String,
        /// Line, from 1.
        line: usize,
        /// What the parser says, in one line.
        message: String,
    },
    /// A value makes no sense.
    #[error("error model {origin}: {field} must be {wanted}; correct it, or fit it anew")]
    Value {
        /// File or built-in name.
        origin: String,
        /// Which field, of which table.
        field: String,
        /// What it may be.
        wanted: &'static str,
    },
}

impl ErrorModel {
    /// The errors of the networks in `models/`.
    ///
    /// # Errors
    /// As [`ErrorModel::parse`]; a test makes sure that there are none.
    pub fn builtin() -> Result<Self, ErrorModelError> {
        Self::parse(BUILTIN, BUILTIN_NAME)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When it can't be read, has unknown or missing fields, or values that make no sense.
    pub fn load(path: &Path) -> Result<Self, ErrorModelError> {
        let text = std::fs::read_to_string(path).map_err(|reason| ErrorModelError::Read {
            path: path.to_owned(),
            reason,
        })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses the text of a file; `origin` names it in errors.
    ///
    /// # Errors
    /// As [`ErrorModel::load`].
    pub fn parse(text: &str, origin: &str) -> Result<Self, ErrorModelError> {
        let model: Self = toml::from_str(text).map_err(|error| ErrorModelError::Syntax {
            origin: origin.to_owned(),
            line: error.span().map_or(1, |span| line_of(text, span.start)),
            message: error.message().lines().collect::<Vec<_>>().join(", "),
        })?;
        model
            .check()
            .map_err(|(field, wanted)| ErrorModelError::Value {
                origin: origin.to_owned(),
                field,
                wanted,
            })?;
        Ok(model)
    }

    /// The text of a file that [`ErrorModel::parse`] reads.
    ///
    /// # Errors
    /// When it has a number that TOML can't hold.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }

    fn check(&self) -> Result<(), Wrong> {
        let [least_x, least_y, most_x, most_y] = self.range_m;
        let near = |value: f64| value.abs() <= 500.0;
        ensure(
            self.range_m.iter().all(|&value| near(value)) && least_x < most_x && least_y < most_y,
            "range_m",
            "least x and y and then greatest x and y, within 500 m",
        )?;
        let Lasting {
            found_s,
            box_s,
            flip_s,
            lane_s,
            false_box_s,
        } = self.lasting;
        for (field, time_s) in [
            ("found_s", found_s),
            ("box_s", box_s),
            ("flip_s", flip_s),
            ("lane_s", lane_s),
            ("false_box_s", false_box_s),
        ] {
            ensure(
                (0.0..=60.0).contains(&time_s),
                &format!("{field} of lasting"),
                "between 0 and 60 seconds",
            )?;
        }
        for class in [ObjectClass::Car, ObjectClass::Truck] {
            ensure(
                self.vehicles.iter().any(|row| row.class == class),
                "vehicle",
                "given at least once for each of the classes car and truck",
            )?;
        }
        for (index, row) in self.vehicles.iter().enumerate() {
            row.check()
                .map_err(|(field, wanted)| (format!("{field} of vehicle {}", index + 1), wanted))?;
        }
        self.lanes.check()?;
        self.false_boxes.check()
    }
}

/// A field, and what it should be.
type Wrong = (String, &'static str);

fn ensure(holds: bool, field: &str, wanted: &'static str) -> Result<(), Wrong> {
    if holds {
        Ok(())
    } else {
        Err((field.to_owned(), wanted))
    }
}

const SHARE: RangeInclusive<f64> = 0.0..=1.0;

fn shares(fields: &[(&str, f64)]) -> Result<(), Wrong> {
    fields.iter().try_for_each(|(field, share)| {
        ensure(SHARE.contains(share), field, "a share between 0 and 1")
    })
}

fn quantiles(fields: &[(&str, &Quantiles, RangeInclusive<f64>)]) -> Result<(), Wrong> {
    fields.iter().try_for_each(|(field, quantiles, allowed)| {
        ensure(
            quantiles.are_in(allowed.clone()),
            field,
            "nine numbers in ascending order, within what such a value can be",
        )
    })
}

fn interval([low, high]: [f64; 2], allowed: RangeInclusive<f64>) -> bool {
    low < high && allowed.contains(&low) && allowed.contains(&high)
}

impl VehicleErrors {
    fn check(&self) -> Result<(), Wrong> {
        ensure(
            interval(self.visibility, SHARE),
            "visibility",
            "two shares between 0 and 1 in ascending order",
        )?;
        ensure(
            interval(self.distance_m, 0.0..=1000.0),
            "distance_m",
            "two distances in ascending order",
        )?;
        shares(&[
            ("recall", self.recall),
            ("flipped", self.flipped),
            ("other_class", self.other_class),
        ])?;
        let metres = -20.0..=20.0;
        quantiles(&[
            ("along_m", &self.along_m, metres.clone()),
            ("across_m", &self.across_m, metres.clone()),
            ("up_m", &self.up_m, metres.clone()),
            ("length_m", &self.length_m, metres.clone()),
            ("width_m", &self.width_m, metres.clone()),
            ("height_m", &self.height_m, metres),
            ("yaw_rad", &self.yaw_rad, -FRAC_PI_2..=FRAC_PI_2),
            ("score", &self.score, SHARE),
        ])
    }
}

impl LaneErrors {
    fn check(&self) -> Result<(), Wrong> {
        shares(&[
            ("shared of lanes", self.shared),
            ("beside_none of lanes", self.beside_none),
        ])?;
        let wanted = "given at least once, with ahead_m in ascending order and right and none \
                      as shares whose sum is at most 1";
        let is_right = |row: &LaneShares| {
            interval(row.ahead_m, -1000.0..=1000.0)
                && [row.right, row.none, row.right + row.none]
                    .iter()
                    .all(|share| (0.0..=1.0 + 1e-9).contains(share))
        };
        ensure(
            !self.ahead.is_empty() && self.ahead.iter().all(is_right),
            "ahead of lanes",
            wanted,
        )
    }
}

impl FalseBoxes {
    fn check(&self) -> Result<(), Wrong> {
        shares(&[("trucks of false_boxes", self.trucks)])?;
        let size = 0.1..=30.0;
        quantiles(&[
            ("length_m of false_boxes", &self.length_m, size.clone()),
            ("width_m of false_boxes", &self.width_m, size.clone()),
            ("height_m of false_boxes", &self.height_m, size),
            ("center_z_m of false_boxes", &self.center_z_m, -20.0..=20.0),
            ("yaw_rad of false_boxes", &self.yaw_rad, -PI..=PI),
            ("score of false_boxes", &self.score, SHARE),
        ])?;
        let is_right = |row: &FalseBoxRate| {
            interval(row.distance_m, 0.0..=1000.0)
                && interval(row.beside_m, 0.0..=1000.0)
                && (1e-3..=1e6).contains(&row.area_m2)
                && (0.0..=1000.0).contains(&row.per_frame)
        };
        ensure(
            self.places.iter().all(is_right),
            "place of false_boxes",
            "rows with distance_m and beside_m in ascending order, area_m2 above and per_frame \
             at least 0",
        )
    }
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text
        .bytes()
        .take(offset)
        .filter(|&byte| byte == b'\n')
        .count()
}

#[cfg(test)]
mod tests;
