use covista_world::{FrenetPoint, LaneIndex, Road, Se2Pose};
use nalgebra::Vector3;
use rand::Rng;

use super::{LookEntry, RoadsideBarrier, Scenario, VehicleKind};
use crate::{
    Body, ScenarioError, SceneLook, VehicleModel,
    scenery::{Stretch, building, guard_rail, jersey_barrier, pole, tree, wall},
};

/// Where and how a vehicle starts, before the seed's draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Start {
    pub kind: VehicleKind,
    pub model: Option<VehicleModel>,
    pub lane: LaneIndex,
    pub s_m: f64,
    pub s_spread_m: f64,
    pub speed_mps: f64,
    pub speed_spread_mps: f64,
    pub desired_speed_mps: f64,
}

impl Scenario {
    /// The road, from the origin along x.
    ///
    /// # Errors
    /// When a segment is unusable.
    pub fn road(&self) -> Result<Road, ScenarioError> {
        Road::new(Se2Pose::default(), &self.road, self.lane_width_m).map_err(|error| {
            ScenarioError::Value {
                origin: self.origin.clone(),
                what: error.to_string(),
                remedy: "correct its [[road]] segments".to_owned(),
            }
        })
    }

    /// All vehicles in the order of the file, obstacles last.
    pub(crate) fn starts(&self) -> impl Iterator<Item = Start> {
        let driven = self.vehicles.iter().map(|entry| Start {
            kind: entry.kind,
            model: entry.model,
            lane: entry.lane,
            s_m: entry.s_m,
            s_spread_m: entry.s_spread_m,
            speed_mps: entry.speed_mps,
            speed_spread_mps: entry.speed_spread_mps,
            desired_speed_mps: entry.desired_speed_mps,
        });
        let standing = self.obstacles.iter().map(|entry| Start {
            kind: VehicleKind::Obstacle,
            model: entry.model,
            lane: entry.lane,
            s_m: entry.s_m,
            s_spread_m: entry.s_spread_m,
            speed_mps: 0.0,
            speed_spread_mps: 0.0,
            desired_speed_mps: 0.0,
        });
        driven.chain(standing)
    }

    /// What stands beside the road; `rng` shapes the trees.
    pub(crate) fn scenery(&self, road: &Road, rng: &mut impl Rng) -> Vec<Body> {
        let stretch = |from_m, to_m, d_m| Stretch { from_m, to_m, d_m };
        let walls = self.walls.iter().map(|entry| {
            let along = stretch(entry.from_m, entry.to_m, entry.d_m);
            wall(road, along, entry.height_m, entry.thickness_m)
        });
        let barriers = self.barriers.iter().map(|entry| {
            let along = stretch(entry.from_m, entry.to_m, entry.d_m);
            match entry.kind {
                RoadsideBarrier::Jersey => jersey_barrier(road, along),
                RoadsideBarrier::GuardRail => guard_rail(road, along),
            }
        });
        let poles = self.poles.iter().flat_map(|row| {
            let last = ((row.to_m - row.from_m) / row.spacing_m) as u32;
            (0..=last).map(|index| {
                let foot = FrenetPoint {
                    s_m: row.from_m + f64::from(index) * row.spacing_m,
                    d_m: row.d_m,
                };
                pole(road, foot, row.height_m, row.radius_m)
            })
        });
        let buildings = self.buildings.iter().map(|entry| {
            let center = road.pose_from_frenet(entry.s_m, entry.d_m, 0.0);
            let size = [entry.length_m, entry.depth_m, entry.height_m];
            building(center, size, entry.color)
        });
        let trees = self.trees.iter().map(|entry| {
            let foot = road.from_frenet(FrenetPoint {
                s_m: entry.s_m,
                d_m: entry.d_m,
            });
            tree(foot, entry.height_m, entry.crown_radius_m, rng)
        });
        walls
            .chain(barriers)
            .chain(poles)
            .chain(buildings)
            .chain(trees)
            .collect()
    }
}

impl LookEntry {
    pub(crate) fn to_look(&self, texture_seed: u64) -> SceneLook {
        let elevation = self.sun_elevation_deg.to_radians();
        let azimuth = self.sun_azimuth_deg.to_radians();
        SceneLook {
            sun_direction: Vector3::new(
                elevation.cos() * azimuth.cos(),
                elevation.cos() * azimuth.sin(),
                elevation.sin(),
            ),
            direct_light: self.direct_light,
            paint_wear: self.paint_wear,
            asphalt_albedo: self.asphalt_albedo,
            haze_per_m: self.haze_per_m,
            wetness: 0.0,
            damage: 0.2,
            texture_seed,
        }
    }
}
