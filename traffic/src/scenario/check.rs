use std::ops::RangeInclusive;

use covista_world::{LANE_COUNT, LaneIndex, STEP_S};

use super::Scenario;
use crate::ScenarioError;

const ALONG_M: RangeInclusive<f64> = -1000.0..=100_000.0;
const ACROSS_M: RangeInclusive<f64> = -500.0..=500.0;
const SIZE_M: RangeInclusive<f64> = 0.01..=200.0;
const SPEED_MPS: RangeInclusive<f64> = 0.0..=60.0;
const SPREAD: RangeInclusive<f64> = 0.0..=50.0;

impl Scenario {
    /// Whether every number is one that can be driven with.
    pub(super) fn check(&self) -> Result<(), ScenarioError> {
        self.number("duration_s", self.duration_s, STEP_S..=100_000.0)?;
        self.number(
            "perception_period_s",
            self.perception_period_s,
            STEP_S..=10.0,
        )?;
        self.number("lane_width_m", self.lane_width_m, 2.5..=5.0)?;
        self.road()?;
        self.check_roadside()?;
        for (place, start) in self.starts().enumerate() {
            let number = |field: &str, value: f64, range: RangeInclusive<f64>| {
                self.number(&format!("vehicle {}: {field}", place + 1), value, range)
            };
            self.lane(place, start.lane)?;
            number("s_m", start.s_m, ALONG_M)?;
            number("s_spread_m", start.s_spread_m, SPREAD)?;
            number("speed_mps", start.speed_mps, SPEED_MPS)?;
            number("speed_spread_mps", start.speed_spread_mps, SPREAD)?;
            number("desired_speed_mps", start.desired_speed_mps, SPEED_MPS)?;
        }
        let look = &self.look;
        self.number("look.sun_elevation_deg", look.sun_elevation_deg, 1.0..=90.0)?;
        self.number("look.sun_azimuth_deg", look.sun_azimuth_deg, -360.0..=360.0)?;
        self.number("look.direct_light", look.direct_light, 0.0..=1.0)?;
        self.number("look.paint_wear", look.paint_wear, 0.0..=1.0)?;
        self.number("look.asphalt_albedo", look.asphalt_albedo, 0.05..=0.9)?;
        self.number("look.haze_per_m", look.haze_per_m, 0.0..=0.1)
    }

    fn check_roadside(&self) -> Result<(), ScenarioError> {
        for wall in &self.walls {
            self.stretch("walls", wall.from_m, wall.to_m, wall.d_m)?;
            self.number("walls.height_m", wall.height_m, SIZE_M)?;
            self.number("walls.thickness_m", wall.thickness_m, SIZE_M)?;
        }
        for barrier in &self.barriers {
            self.stretch("barriers", barrier.from_m, barrier.to_m, barrier.d_m)?;
        }
        for row in &self.poles {
            self.stretch("poles", row.from_m, row.to_m, row.d_m)?;
            self.number("poles.spacing_m", row.spacing_m, 1.0..=10_000.0)?;
            self.number("poles.height_m", row.height_m, SIZE_M)?;
            self.number("poles.radius_m", row.radius_m, SIZE_M)?;
        }
        for building in &self.buildings {
            self.number("buildings.s_m", building.s_m, ALONG_M)?;
            self.number("buildings.d_m", building.d_m, ACROSS_M)?;
            self.number("buildings.length_m", building.length_m, SIZE_M)?;
            self.number("buildings.depth_m", building.depth_m, SIZE_M)?;
            self.number("buildings.height_m", building.height_m, SIZE_M)?;
        }
        for tree in &self.trees {
            self.number("trees.s_m", tree.s_m, ALONG_M)?;
            self.number("trees.d_m", tree.d_m, ACROSS_M)?;
            self.number("trees.height_m", tree.height_m, SIZE_M)?;
            self.number("trees.crown_radius_m", tree.crown_radius_m, SIZE_M)?;
        }
        Ok(())
    }

    fn stretch(&self, what: &str, from_m: f64, to_m: f64, d_m: f64) -> Result<(), ScenarioError> {
        self.number(&format!("{what}.from_m"), from_m, ALONG_M)?;
        self.number(&format!("{what}.to_m"), to_m, from_m..=*ALONG_M.end())?;
        self.number(&format!("{what}.d_m"), d_m, ACROSS_M)
    }

    fn number(
        &self,
        field: &str,
        value: f64,
        range: RangeInclusive<f64>,
    ) -> Result<(), ScenarioError> {
        if range.contains(&value) {
            return Ok(());
        }
        Err(ScenarioError::Value {
            origin: self.origin.clone(),
            what: format!("{field} is {value}"),
            remedy: format!("choose a number from {} to {}", range.start(), range.end()),
        })
    }

    fn lane(&self, place: usize, lane: LaneIndex) -> Result<(), ScenarioError> {
        // A lane that was read from a file has not passed through `LaneIndex::new`.
        if lane.get() < LANE_COUNT {
            return Ok(());
        }
        Err(ScenarioError::Value {
            origin: self.origin.clone(),
            what: format!("vehicle {}: lane is {}", place + 1, lane.get()),
            remedy: "choose 0 (left), 1 or 2 (right)".to_owned(),
        })
    }
}
