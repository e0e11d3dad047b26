//! Beam tables: what a LIDAR is, as a TOML file says it.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::{Beam, Lidar, Motion};

const BUILTIN: [(&str, &str); 3] = [
    (
        "hdl-64e",
        include_str!("../../../assets/lidars/hdl-64e.toml"),
    ),
    (
        "vlp-32c",
        include_str!("../../../assets/lidars/vlp-32c.toml"),
    ),
    ("os1-64", include_str!("../../../assets/lidars/os1-64.toml")),
];

/// More beams or firings a turn than any device has.
const MOST_BEAMS: usize = 1024;
const MOST_COLUMNS: u32 = 36_000;

/// Why a beam table cannot be used; each in one line that says where, what and what to do.
#[derive(Debug, thiserror::Error)]
pub enum LidarError {
    /// The file cannot be read.
    #[error(
        "cannot read beam table {}: {reason}; check the path, or name a built-in LIDAR: {builtin}",
        path.display()
    )]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system says.
        reason: std::io::Error,
        /// Names of the built-in LIDARs.
        builtin: String,
    },
    /// There is no built-in LIDAR of this name.
    #[error(
        "there is no built-in LIDAR '{name}'; choose one of {builtin}, or give the path of a .toml file"
    )]
    UnknownName {
        /// The name asked for.
        name: String,
        /// Names of the built-in LIDARs.
        builtin: String,
    },
    /// The text is no TOML, or has a field that is unknown, missing or of the wrong type.
    #[error("beam table {origin}, line {line}: {message}; correct this line")]
    Syntax {
        /// File or built-in name.
        origin: String,
        /// Line, from 1.
        line: usize,
        /// What the parser says, in one line.
        message: String,
    },
    /// There is no beam.
    #[error(
        "beam table {origin} has no beams; give elevations_deg or uniform in at least one [[bank]]"
    )]
    NoBeams {
        /// File or built-in name.
        origin: String,
    },
    /// A beam points straight up or down, or beyond.
    #[error(
        "beam table {origin}: beam {beam} (from 1) has elevation {elevation_deg} degrees; it must lie between -90 and 90"
    )]
    Elevation {
        /// File or built-in name.
        origin: String,
        /// Which beam, from 1.
        beam: usize,
        /// Its elevation.
        elevation_deg: f64,
    },
    /// A value makes no sense.
    #[error("beam table {origin}: {field} is {value}; it must be {wanted}")]
    Value {
        /// File or built-in name.
        origin: String,
        /// Which field.
        field: &'static str,
        /// What it is.
        value: f64,
        /// What it may be.
        wanted: &'static str,
    },
    /// The beams of a bank are not said in one way.
    #[error("beam table {origin}, bank {bank} (from 1): {what}")]
    Bank {
        /// File or built-in name.
        origin: String,
        /// Which bank, from 1.
        bank: usize,
        /// What is wrong, and what to do.
        what: &'static str,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    name: String,
    columns: u32,
    rotation_hz: f64,
    #[serde(default)]
    clockwise: bool,
    range_m: f64,
    range_std_m: f64,
    #[serde(default)]
    range_bias_std_m: f64,
    blank_m: f64,
    weakest_return: f64,
    #[serde(default)]
    lost_share: f64,
    #[serde(default)]
    sensitivity_std: f64,
    #[serde(default)]
    reflectance_std: f64,
    #[serde(default)]
    reflectance_step: f64,
    #[serde(default, rename = "bank")]
    banks: Vec<Bank>,
}

/// Beams that leave the device at one height.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Bank {
    elevations_deg: Option<Vec<f64>>,
    uniform: Option<Uniform>,
    /// Counter-clockwise from the column's azimuth, one for each beam.
    azimuths_deg: Option<Vec<f64>>,
    /// How far the beams of a specimen stray from the table.
    #[serde(default)]
    elevation_std_deg: f64,
    /// Above the origin of the LIDAR frame.
    #[serde(default)]
    height_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Uniform {
    beams: usize,
    highest_deg: f64,
    lowest_deg: f64,
}

impl Lidar {
    /// Names of the built-in LIDARs.
    pub fn builtin_names() -> impl Iterator<Item = &'static str> {
        BUILTIN.into_iter().map(|(name, _)| name)
    }

    /// The built-in LIDAR of this name.
    ///
    /// # Errors
    /// When there is none.
    pub fn builtin(name: &str) -> Result<Self, LidarError> {
        let (_, text) = BUILTIN
            .iter()
            .find(|(known, _)| *known == name)
            .ok_or_else(|| LidarError::UnknownName {
                name: name.to_owned(),
                builtin: known_names(),
            })?;
        Self::parse(text, name)
    }

    /// Reads a beam table.
    ///
    /// # Errors
    /// When it cannot be read, has unknown or missing fields, or values that make no sense.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, LidarError> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|reason| LidarError::Read {
            path: path.to_owned(),
            reason,
            builtin: known_names(),
        })?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Parses the text of a beam table; `origin` names it in errors.
    ///
    /// # Errors
    /// As [`Lidar::load`].
    pub fn parse(text: &str, origin: &str) -> Result<Self, LidarError> {
        let table: Table = toml::from_str(text).map_err(|error| LidarError::Syntax {
            origin: origin.to_owned(),
            line: error.span().map_or(1, |span| line_of(text, span.start)),
            message: error.message().lines().collect::<Vec<_>>().join(", "),
        })?;
        table.check(origin)?;
        Ok(Self {
            beams: table.beams(origin)?,
            name: table.name,
            columns: table.columns,
            rotation_hz: table.rotation_hz,
            clockwise: table.clockwise,
            range_m: table.range_m,
            range_std_m: table.range_std_m,
            range_bias_std_m: table.range_bias_std_m,
            blank_m: table.blank_m,
            weakest_return: table.weakest_return,
            lost_share: table.lost_share,
            sensitivity_std: table.sensitivity_std,
            reflectance_std: table.reflectance_std,
            reflectance_step: table.reflectance_step,
            motion: Motion::default(),
            specimen: 0,
        })
    }
}

impl Table {
    fn check(&self, origin: &str) -> Result<(), LidarError> {
        let share = 0.0..=1.0;
        let fields = [
            (
                "columns",
                f64::from(self.columns),
                1.0..=f64::from(MOST_COLUMNS),
                "between 1 and 36000 firings a turn",
            ),
            (
                "rotation_hz",
                self.rotation_hz,
                0.1..=1e3,
                "between 0.1 and 1000 turns a second",
            ),
            ("range_m", self.range_m, 0.1..=1e4, "between 0.1 and 10000"),
            (
                "range_std_m",
                self.range_std_m,
                0.0..=10.0,
                "between 0 and 10",
            ),
            (
                "range_bias_std_m",
                self.range_bias_std_m,
                0.0..=10.0,
                "between 0 and 10",
            ),
            (
                "blank_m",
                self.blank_m,
                0.0..=self.range_m.max(0.0),
                "between 0 and range_m",
            ),
            (
                "weakest_return",
                self.weakest_return,
                share.clone(),
                "between 0 and 1",
            ),
            (
                "lost_share",
                self.lost_share,
                share.clone(),
                "between 0 and 1",
            ),
            (
                "sensitivity_std",
                self.sensitivity_std,
                share.clone(),
                "between 0 and 1",
            ),
            (
                "reflectance_std",
                self.reflectance_std,
                share.clone(),
                "between 0 and 1",
            ),
            (
                "reflectance_step",
                self.reflectance_step,
                share,
                "between 0 and 1",
            ),
        ];
        for (field, value, allowed, wanted) in fields {
            if !allowed.contains(&value) {
                return Err(LidarError::Value {
                    origin: origin.to_owned(),
                    field,
                    value,
                    wanted,
                });
            }
        }
        Ok(())
    }

    fn beams(&self, origin: &str) -> Result<Vec<Beam>, LidarError> {
        let mut beams = Vec::new();
        for (index, bank) in self.banks.iter().enumerate() {
            let found = bank.beams().map_err(|what| LidarError::Bank {
                origin: origin.to_owned(),
                bank: index + 1,
                what,
            })?;
            beams.extend(found);
        }
        if beams.is_empty() {
            return Err(LidarError::NoBeams {
                origin: origin.to_owned(),
            });
        }
        let outside = |beam: &&Beam| {
            let elevation_deg = beam.elevation_rad.to_degrees();
            !(elevation_deg > -90.0 && elevation_deg < 90.0)
        };
        if let Some(beam) = beams.iter().find(outside) {
            let number = beams.iter().position(|other| std::ptr::eq(other, beam));
            return Err(LidarError::Elevation {
                origin: origin.to_owned(),
                beam: number.map_or(0, |index| index + 1),
                elevation_deg: beam.elevation_rad.to_degrees(),
            });
        }
        Ok(beams)
    }
}

impl Bank {
    fn beams(&self) -> Result<Vec<Beam>, &'static str> {
        let elevations_deg = match (&self.elevations_deg, &self.uniform) {
            (Some(listed), None) => listed.clone(),
            (None, Some(uniform)) => uniform.elevations_deg()?,
            _ => return Err("give either elevations_deg or uniform"),
        };
        if elevations_deg.len() > MOST_BEAMS {
            return Err("has more than 1024 beams; remove some");
        }
        let azimuths_deg = match &self.azimuths_deg {
            Some(listed) => listed.clone(),
            None => vec![0.0; elevations_deg.len()],
        };
        if azimuths_deg.len() != elevations_deg.len() {
            return Err("azimuths_deg needs one value for each beam");
        }
        if azimuths_deg.iter().any(|azimuth| !azimuth.is_finite()) {
            return Err("azimuths_deg has a value that is no finite number; correct it");
        }
        if !((-10.0..=10.0).contains(&self.height_m)
            && (0.0..=10.0).contains(&self.elevation_std_deg))
        {
            return Err(
                "height_m must be between -10 and 10 and elevation_std_deg between 0 and 10",
            );
        }
        let beams = elevations_deg.iter().zip(azimuths_deg);
        Ok(beams
            .map(|(elevation_deg, azimuth_deg)| Beam {
                elevation_rad: elevation_deg.to_radians(),
                azimuth_rad: azimuth_deg.to_radians(),
                height_m: self.height_m,
                elevation_std_rad: self.elevation_std_deg.to_radians(),
            })
            .collect())
    }
}

impl Uniform {
    fn elevations_deg(&self) -> Result<Vec<f64>, &'static str> {
        if self.beams > MOST_BEAMS {
            return Err("has more than 1024 beams; remove some");
        }
        if !(self.highest_deg.is_finite() && self.lowest_deg.is_finite()) {
            return Err("highest_deg and lowest_deg must be finite numbers");
        }
        if self.highest_deg < self.lowest_deg {
            return Err("highest_deg must not lie below lowest_deg");
        }
        let step_deg =
            (self.highest_deg - self.lowest_deg) / self.beams.saturating_sub(1).max(1) as f64;
        Ok((0..self.beams)
            .map(|beam| self.highest_deg - beam as f64 * step_deg)
            .collect())
    }
}

fn known_names() -> String {
    Lidar::builtin_names().collect::<Vec<_>>().join(", ")
}

fn line_of(text: &str, offset: usize) -> usize {
    let before = text.bytes().take(offset);
    1 + before.filter(|&byte| byte == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHOLE: &str = "name = 'mine'\ncolumns = 100\nrotation_hz = 10.0\nrange_m = 50.0\n\
        range_std_m = 0.01\nblank_m = 0.5\nweakest_return = 1e-5\n";

    fn refusal(text: &str) -> String {
        let error = Lidar::parse(text, "my.toml").expect_err("refused");
        let message = error.to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    }

    #[test]
    fn a_table_of_ones_own_is_read() {
        let text =
            format!("{WHOLE}[[bank]]\nelevations_deg = [1.0, -2.0]\nazimuths_deg = [0.5, 0.0]\n");
        let lidar = Lidar::parse(&text, "my.toml").expect("a LIDAR");
        assert_eq!(lidar.beams.len(), 2);
        assert!((lidar.beams[0].azimuth_rad.to_degrees() - 0.5).abs() < 1e-12);
        assert_eq!((lidar.name.as_str(), lidar.columns), ("mine", 100));
    }

    #[test]
    fn what_is_wrong_is_said_in_one_line() {
        let cases = [
            (
                WHOLE.to_owned(),
                "beam table my.toml has no beams; give elevations_deg or uniform in at least one [[bank]]",
            ),
            (
                format!("{WHOLE}[[bank]]\nelevations_deg = []\n"),
                "has no beams",
            ),
            (
                format!("{WHOLE}[[bank]]\nelevations_deg = [0.0, 95.0]\n"),
                "beam 2 (from 1) has elevation 95 degrees; it must lie between -90 and 90",
            ),
            (
                format!("{WHOLE}[[bank]]\nelevations_deg = [nan]\n"),
                "beam 1 (from 1) has elevation NaN",
            ),
            (
                format!(
                    "{WHOLE}[[bank]]\nuniform = {{ beams = 4, highest_deg = inf, lowest_deg = 0 }}\n"
                ),
                "highest_deg and lowest_deg must be finite",
            ),
            (
                WHOLE.replace("columns = 100", "columns = 0"),
                "columns is 0; it must be between 1 and 36000",
            ),
            (
                WHOLE.replace("range_m = 50.0", "range_m = nan"),
                "range_m is NaN; it must be between 0.1 and 10000",
            ),
            (
                WHOLE.replace("blank_m = 0.5", "blank_m = 60"),
                "blank_m is 60; it must be between 0 and range_m",
            ),
            (
                WHOLE.replace("rotation_hz", "rotation"),
                "line 3: unknown field `rotation`",
            ),
            (WHOLE.replace("name = 'mine'\n", ""), "missing field `name`"),
            (
                format!("{WHOLE}[[bank]]\nheight_m = 1.0\n"),
                "bank 1 (from 1): give either elevations_deg or uniform",
            ),
            (
                format!("{WHOLE}[[bank]]\nelevations_deg = [1, 2]\nazimuths_deg = [1]\n"),
                "azimuths_deg needs one value for each beam",
            ),
            (
                format!(
                    "{WHOLE}[[bank]]\nuniform = {{ beams = 99999999, highest_deg = 1, lowest_deg = 0 }}\n"
                ),
                "more than 1024 beams",
            ),
        ];
        for (text, expected) in cases {
            let message = refusal(&text);
            assert!(message.contains(expected), "{message}\nlacks: {expected}");
        }
    }

    #[test]
    fn a_name_or_a_file_that_is_not_there_is_said() {
        let unknown = Lidar::builtin("hdl-32").expect_err("unknown").to_string();
        assert!(unknown.contains("'hdl-32'; choose one of hdl-64e, vlp-32c, os1-64"));
        let missing = Lidar::load("nowhere/my.toml")
            .expect_err("missing")
            .to_string();
        assert!(
            missing.starts_with("cannot read beam table nowhere/my.toml: "),
            "{missing}"
        );
        assert!(!missing.contains('\n'));
    }
}
