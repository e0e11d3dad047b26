//! One turn of a LIDAR in a scene: pulses, what they meet, and what the receiver makes of it.

use std::f32::consts::{PI, TAU};

use covista_traffic::Material;
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use super::draws::Draws;
use super::strip::{Ground, RoadStrip, spot};
use super::surface::Surface;
use super::{Lidar, Motion, PointLabel};
use crate::Viewpoint;
use crate::caster::{Hit, Sighting};

/// Spread of the strength of a return from pulse to pulse, and of its reported reflectance.
const FLICKER: f32 = 0.25;
const GRAIN: f32 = 0.02;
/// Up to this multiple of the weakest return the reported reflectance is zero, from the other one
/// on it is the surface's own.
const FAINT: f32 = 8.0;
const CLEAR: f32 = 16.0;
/// Reflectances up to this are reported as zero, and all others less by it.
const DARK: f32 = 0.06;
/// Shares of pulses that a pane reflects, and that pass it.
const GLASS_REFLECTED: f32 = 0.12;
const GLASS_PASSED: f32 = 0.5;
/// Share of the pulses in a cabin that its seats send back, and how deep these lie behind a pane.
const SEATS: f32 = 0.45;
const CABIN_M: [f32; 2] = [0.2, 1.0];
const SEAT_ALBEDO: f32 = 0.1;
/// Surfaces that a pulse may pass: panes and gaps between leaves.
const MOST_PASSED: usize = 4;
/// No pulse goes deeper than this into a crown.
const DEEPEST_M: f32 = 1.5;
/// Height of grass.
const GRASS_M: f32 = 0.05;

/// A beam of one specimen, calibrated.
struct TurnBeam {
    /// Where it points at azimuth zero.
    direction: Vector3<f32>,
    /// Factor on the strength of its returns.
    sensitivity: f32,
    /// Added to its reported reflectances.
    bias: f32,
    /// Added to its ranges.
    range_bias_m: f32,
}

/// Beams that leave the device at one height.
struct Bank {
    height_m: f32,
    beams: Vec<TurnBeam>,
}

/// What came back of a pulse.
struct Return {
    distance_m: f32,
    /// Light that comes back, before it thins out with the square of the distance.
    intensity: f32,
    /// What the sensor reports where it is near enough.
    reflectance: f32,
    label: PointLabel,
}

/// The points of some columns.
#[derive(Default)]
pub(super) struct Columns {
    pub(super) points: Vec<[f32; 4]>,
    pub(super) labels: Vec<PointLabel>,
}

/// One turn of a LIDAR in a scene.
pub(super) struct Turn<'a> {
    lidar: &'a Lidar,
    view: &'a Viewpoint<'a>,
    strip: RoadStrip,
    banks: Vec<Bank>,
    world_from_lidar: Matrix3<f32>,
    origin: Vector3<f32>,
    velocity_mps: Vector3<f32>,
    own_velocity_mps: Vector3<f32>,
    wetness: f32,
    seed: u64,
}

/// One column of a turn.
struct Firing {
    number: u32,
    dt_s: f32,
    lidar_from_column: Matrix3<f32>,
    world_from_column: Matrix3<f32>,
    origin: Vector3<f32>,
}

impl<'a> Turn<'a> {
    pub(super) fn new(lidar: &'a Lidar, view: &'a Viewpoint<'a>, seed: u64) -> Self {
        let pose = view.world_from_lidar();
        let velocity_mps = view.scene.placed(view.ego) * Vector3::x() * view.ego.state.speed_mps;
        let world_from_lidar = pose.rotation.to_rotation_matrix();
        Self {
            lidar,
            view,
            strip: RoadStrip::new(view.scene, pose.translation.vector.xy(), lidar.range_m),
            banks: banks(lidar),
            world_from_lidar: world_from_lidar.matrix().cast(),
            origin: pose.translation.vector.cast(),
            velocity_mps: velocity_mps.cast(),
            own_velocity_mps: (world_from_lidar.inverse() * velocity_mps).cast(),
            wetness: view.scene.look.wetness.clamp(0.0, 1.0) as f32,
            seed,
        }
    }

    /// Fires these columns. The first one of a turn points backwards, the middle one ahead.
    pub(super) fn fire(&self, columns: std::ops::Range<u32>) -> Columns {
        let beams: usize = self.banks.iter().map(|bank| bank.beams.len()).sum();
        let room = beams * columns.len();
        let mut found = Columns {
            points: Vec::with_capacity(room),
            labels: Vec::with_capacity(room),
        };
        let mut directions = Vec::with_capacity(beams);
        for column in columns {
            self.fire_column(column, &mut directions, &mut found);
        }
        found
    }

    fn fire_column(&self, column: u32, directions: &mut Vec<Vector3<f32>>, found: &mut Columns) {
        let firing = self.firing(column);
        let undone_m = match self.lidar.motion {
            Motion::Undone => self.own_velocity_mps * firing.dt_s,
            Motion::Frozen | Motion::Rolling => Vector3::zeros(),
        };
        let (max_m, own) = (self.lidar.range_m as f32, Some(self.view.ego.id));
        let (mut number, mut near) = (0, self.strip.middle());
        for bank in &self.banks {
            let height = Vector3::z() * bank.height_m;
            let origin = firing.origin + self.world_from_lidar * height;
            directions.clear();
            let turned = bank
                .beams
                .iter()
                .map(|beam| firing.world_from_column * beam.direction);
            directions.extend(turned);
            let sightings =
                self.view
                    .rays
                    .cast_fan(&Point3::from(origin), directions, max_m, own, firing.dt_s);
            for ((beam, direction), sighting) in bank.beams.iter().zip(&*directions).zip(sightings)
            {
                let pulse = Pulse {
                    turn: self,
                    origin,
                    direction: *direction,
                    dt_s: firing.dt_s,
                };
                let mut draws = Draws::new(self.seed, firing.number, number);
                number += 1;
                let Some(back) = pulse.follow(sighting, &mut near, &mut draws) else {
                    continue;
                };
                let Some(reflectance) = self.receive(&back, beam, &mut draws) else {
                    continue;
                };
                let noise_m = self.lidar.range_std_m as f32 * draws.bell();
                let range_m = back.distance_m + beam.range_bias_m + noise_m;
                let point = firing.lidar_from_column * beam.direction * range_m + height + undone_m;
                found.points.push([point.x, point.y, point.z, reflectance]);
                found.labels.push(back.label);
            }
        }
    }

    fn firing(&self, number: u32) -> Firing {
        let turned = number as f32 / self.lidar.columns as f32;
        let azimuth = if self.lidar.clockwise {
            PI - TAU * turned
        } else {
            TAU * turned - PI
        };
        let dt_s = match self.lidar.motion {
            Motion::Frozen => 0.0,
            Motion::Rolling | Motion::Undone => (turned - 0.5) / self.lidar.rotation_hz as f32,
        };
        let lidar_from_column =
            Rotation3::from_axis_angle(&Vector3::z_axis(), azimuth).into_inner();
        Firing {
            number,
            dt_s,
            lidar_from_column,
            world_from_column: self.world_from_lidar * lidar_from_column,
            origin: self.origin + self.velocity_mps * dt_s,
        }
    }

    /// The reflectance that the sensor reports, where the return is no noise to it.
    fn receive(&self, back: &Return, beam: &TurnBeam, draws: &mut Draws) -> Option<f32> {
        let gain = beam.sensitivity * (1.0 + FLICKER * draws.bell());
        let signal = gain * back.intensity / (back.distance_m * back.distance_m);
        let strength = signal / self.lidar.weakest_return as f32;
        let lost = draws.uniform() < self.lidar.lost_share as f32;
        if lost || back.distance_m < self.lidar.blank_m as f32 || strength < 1.0 {
            return None;
        }
        let clear = ((strength - FAINT) / (CLEAR - FAINT)).clamp(0.0, 1.0);
        let reflectance = (back.reflectance - DARK + beam.bias + GRAIN * draws.bell()) * clear;
        let step = self.lidar.reflectance_step as f32;
        Some(if reflectance <= 0.0 {
            0.0
        } else if step > 0.0 {
            (((reflectance / step + 0.5) as u32) as f32 * step).min(BRIGHTEST)
        } else {
            reflectance.min(BRIGHTEST)
        })
    }
}

/// The brightest reflectance that is reported.
const BRIGHTEST: f32 = 0.99;

/// A pulse on its way.
struct Pulse<'a> {
    turn: &'a Turn<'a>,
    origin: Vector3<f32>,
    direction: Vector3<f32>,
    dt_s: f32,
}

impl Pulse<'_> {
    /// What comes back first, through panes and leaves where the pulse passes them.
    fn follow(&self, seen: Sighting, near: &mut usize, draws: &mut Draws) -> Option<Return> {
        let end_m = seen.ground_m.unwrap_or(self.turn.lidar.range_m as f32);
        let (mut hit, mut passed_m, mut transmission) = (seen.hit, 0.0, 1.0);
        for _ in 0..MOST_PASSED {
            let Some(met) = hit else {
                let distance_m = seen.ground_m?;
                return Some(self.off_ground(distance_m, transmission, near, draws));
            };
            let distance_m = passed_m + met.distance_m;
            if met.material == Material::Glass {
                let fate = draws.uniform();
                if fate < GLASS_REFLECTED {
                    return Some(self.off_surface(&met, distance_m, transmission, draws));
                }
                if fate > GLASS_REFLECTED + GLASS_PASSED {
                    return None;
                }
                transmission *= 0.7;
                let seat = self.off_cabin(&met, distance_m, transmission, draws);
                if seat.is_some() {
                    return seat;
                }
            } else if draws.uniform() >= Surface::of(met.material).gaps {
                return Some(self.off_surface(&met, distance_m, transmission, draws));
            }
            passed_m = distance_m + 0.01;
            let from = Point3::from(self.origin + self.direction * passed_m);
            let own = Some(self.turn.view.ego.id);
            let reach_m = end_m - passed_m;
            let rays = self.turn.view.rays;
            hit = rays.cast_at(&from, &self.direction, reach_m, own, self.dt_s);
        }
        None
    }

    fn off_surface(
        &self,
        hit: &Hit,
        distance_m: f32,
        transmission: f32,
        draws: &mut Draws,
    ) -> Return {
        let surface = Surface::of(hit.material);
        let facing = surface.facing(-hit.normal.dot(&self.direction));
        let deeper_m = if surface.depth_m > 0.0 {
            // Exponential: each layer of leaves takes its share.
            (-surface.depth_m * (1.0 - draws.uniform()).ln()).min(DEEPEST_M)
        } else {
            0.0
        };
        Return {
            distance_m: distance_m + deeper_m,
            intensity: transmission * surface.albedo * facing,
            reflectance: surface.albedo * facing,
            label: PointLabel::Object(hit.object),
        }
    }

    /// What a seat sends back, unless the pulse misses it or has left the cabin before.
    fn off_cabin(
        &self,
        pane: &Hit,
        distance_m: f32,
        transmission: f32,
        draws: &mut Draws,
    ) -> Option<Return> {
        if draws.uniform() > SEATS {
            return None;
        }
        let [near_m, far_m] = CABIN_M;
        let deeper_m = near_m + (far_m - near_m) * draws.uniform();
        let seat = Point3::from(self.origin + self.direction * (distance_m + deeper_m));
        // Looking back from outside of the cabin its far wall is seen, from inside it is not.
        let rays = self.turn.view.rays;
        let outside = rays.cast_at(&seat, &-self.direction, deeper_m, None, self.dt_s);
        outside.is_none().then_some(Return {
            distance_m: distance_m + deeper_m,
            intensity: transmission * SEAT_ALBEDO,
            reflectance: SEAT_ALBEDO,
            label: PointLabel::Object(pane.object),
        })
    }

    fn off_ground(
        &self,
        distance_m: f32,
        transmission: f32,
        near: &mut usize,
        draws: &mut Draws,
    ) -> Return {
        let turn = self.turn;
        let at = spot(&self.origin, &self.direction, distance_m);
        let ground = turn.strip.at(at, near);
        let surface = Surface::of_ground(ground, turn.wetness);
        let sink = -self.direction.z;
        let nearer_m = match ground {
            Ground::Grass => (GRASS_M * draws.uniform() / sink.max(1e-3)).min(0.5),
            Ground::Asphalt(_) | Ground::Paint(_) => 0.0,
        };
        Return {
            distance_m: distance_m - nearer_m,
            intensity: transmission * surface.albedo * surface.facing(sink),
            reflectance: surface.albedo,
            label: PointLabel::Ground,
        }
    }
}

/// The beams of the specimen, each a little off its table, by the heights they leave at.
fn banks(lidar: &Lidar) -> Vec<Bank> {
    let mut banks: Vec<Bank> = Vec::new();
    for (number, beam) in lidar.beams.iter().enumerate() {
        let mut draws = Draws::new(lidar.specimen, u32::MAX, number as u32);
        let stray_rad = beam.elevation_std_rad * f64::from(draws.bell());
        let (up, across) = (beam.elevation_rad + stray_rad).sin_cos();
        let (left, ahead) = beam.azimuth_rad.sin_cos();
        let turn_beam = TurnBeam {
            direction: Vector3::new(across * ahead, across * left, up).cast(),
            sensitivity: (lidar.sensitivity_std as f32 * draws.bell()).exp(),
            bias: lidar.reflectance_std as f32 * draws.bell(),
            range_bias_m: lidar.range_bias_std_m as f32 * draws.bell(),
        };
        let height_m = beam.height_m as f32;
        match banks.last_mut() {
            Some(bank) if bank.height_m.to_bits() == height_m.to_bits() => {
                bank.beams.push(turn_beam);
            }
            _ => banks.push(Bank {
                height_m,
                beams: vec![turn_beam],
            }),
        }
    }
    banks
}
