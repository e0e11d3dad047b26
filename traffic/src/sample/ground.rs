use std::f64::consts::TAU;

use covista_world::Road;
use nalgebra::Vector2;
use rand::Rng;

use super::course::Course;
use crate::Terrain;

const REACH_M: f64 = 160.0;
const SPACING_M: f64 = 4.0;
/// The road's embankments and cuts end where the landscape does as it likes, this far from it.
const BLEND_M: f64 = 45.0;
const CREST_RADIUS_MIN_M: f64 = 400.0;
const BANK_MAX: f64 = 0.06;
const CROWN: f64 = 0.02;

/// Hills, banking, embankments and bumps, one scene in three flat.
///
/// `paved_m` are the offsets d (right, left) between which the ground is built: carriageways,
/// shoulders, sidewalks.
pub(super) fn draw(
    rng: &mut impl Rng,
    course: &Course,
    paved_m: [f64; 2],
    grade_max: f64,
) -> Terrain {
    if rng.random_bool(1.0 / 3.0) {
        return Terrain::FLAT;
    }
    let ground = Ground::draw(rng, course, paved_m, grade_max);
    let center = course.road.reference(course.ego_s_m).0.position();
    Terrain::sampled(center, REACH_M, SPACING_M, |position| {
        ground.height_m(position)
    })
}

struct Ground<'a> {
    road: &'a Road,
    paved_m: [f64; 2],
    landscape: Landscape,
    bank: f64,
    crown: f64,
    /// Of the right side and the left one.
    slopes: [Slope; 2],
    off_road: Waves,
    on_road: Waves,
}

impl<'a> Ground<'a> {
    fn draw(rng: &mut impl Rng, course: &'a Course, paved_m: [f64; 2], grade_max: f64) -> Self {
        Self {
            road: &course.road,
            paved_m,
            landscape: Landscape::draw(rng, course, grade_max),
            bank: rng.random_range(0.0..BANK_MAX),
            crown: rng.random_range(0.0..CROWN),
            slopes: [Slope::draw(rng), Slope::draw(rng)],
            off_road: Waves::draw(rng, 4, 12.0..60.0, 0.4),
            on_road: Waves::draw(rng, 2, 15.0..40.0, 0.03),
        }
    }

    fn height_m(&self, position: Vector2<f64>) -> f64 {
        let at = self.road.to_frenet(position);
        let (reference, curvature_per_m) = self.road.reference(at.s_m);
        let [right_m, left_m] = self.paved_m;
        let d_m = at.d_m.clamp(right_m, left_m);
        let beyond_m = (at.d_m - d_m).abs();
        // In a bend the inner side lies lower; the bank is full from a radius of 100 m down.
        let bank = self.bank * (100.0 * curvature_per_m).clamp(-1.0, 1.0);
        let built_m =
            self.landscape.height_m(reference.position()) - bank * d_m - self.crown * d_m.abs()
                + self.on_road.height_m(position);
        let free_m = self.landscape.height_m(position);
        let slope = &self.slopes[usize::from(at.d_m > 0.0)];
        built_m
            + smooth(beyond_m / BLEND_M) * (free_m - built_m)
            + slope.rise_m(beyond_m)
            + smooth(beyond_m / 8.0) * self.off_road.height_m(position)
    }
}

/// 0 up to 0, 1 from 1 on, smooth between.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// What the country does at large: a tilt and two long waves.
struct Landscape {
    tilt: Vector2<f64>,
    waves: Waves,
    origin: Vector2<f64>,
    scale: f64,
}

impl Landscape {
    /// As steep as drawn, but no steeper along the road than `grade_max` and no crest sharper than
    /// the sharpest allowed.
    fn draw(rng: &mut impl Rng, course: &Course, grade_max: f64) -> Self {
        let swell_m = rng.random_range(0.0..80.0) * grade_max;
        let tilt = Vector2::new(1.0, 0.0) * rng.random_range(0.0..0.6 * grade_max);
        let mut landscape = Self {
            tilt: rotated(tilt, rng.random_range(0.0..TAU)),
            waves: Waves::draw(rng, 2, 150.0..600.0, swell_m),
            origin: course.road.reference(course.ego_s_m).0.position(),
            scale: 1.0,
        };
        const STEP_M: f64 = 5.0;
        let heights_m: Vec<f64> = (-40..=40)
            .map(|step| {
                let s_m = course.ego_s_m + STEP_M * f64::from(step);
                landscape.height_m(course.road.reference(s_m).0.position())
            })
            .collect();
        let worst = |measure: &dyn Fn(&[f64]) -> f64| {
            heights_m
                .windows(3)
                .map(measure)
                .fold(1e-9, |max: f64, x| max.max(x.abs()))
        };
        let grade = worst(&|z| (z[1] - z[0]) / STEP_M);
        let bend_per_m = worst(&|z| (z[0] - 2.0 * z[1] + z[2]) / (STEP_M * STEP_M));
        landscape.scale = (grade_max / grade)
            .min(1.0 / (CREST_RADIUS_MIN_M * bend_per_m))
            .min(1.0);
        landscape
    }

    fn height_m(&self, position: Vector2<f64>) -> f64 {
        let tilted_m = self.tilt.dot(&(position - self.origin));
        self.scale * (tilted_m + self.waves.height_m(position))
    }
}

fn rotated(vector: Vector2<f64>, angle_rad: f64) -> Vector2<f64> {
    nalgebra::Rotation2::new(angle_rad) * vector
}

/// Plane waves in random directions.
struct Waves {
    /// Wave vector, phase, amplitude.
    waves: Vec<(Vector2<f64>, f64, f64)>,
}

impl Waves {
    /// `count` waves whose amplitudes sum to at most `height_m`.
    fn draw(rng: &mut impl Rng, count: u32, length_m: std::ops::Range<f64>, height_m: f64) -> Self {
        let height_m = height_m * rng.random_range(0.1..1.0);
        let waves = (0..count)
            .map(|_| {
                let number = Vector2::new(TAU / rng.random_range(length_m.clone()), 0.0);
                let direction = rng.random_range(0.0..TAU);
                let phase = rng.random_range(0.0..TAU);
                (
                    rotated(number, direction),
                    phase,
                    height_m / f64::from(count),
                )
            })
            .collect();
        Self { waves }
    }

    fn height_m(&self, position: Vector2<f64>) -> f64 {
        self.waves
            .iter()
            .map(|(number, phase, height_m)| height_m * (number.dot(&position) + phase).sin())
            .sum()
    }
}

/// The profile beside the road: perhaps a ditch, then a slope up or down.
struct Slope {
    toe_m: f64,
    run_m: f64,
    rise_m: f64,
    ditch_m: f64,
}

impl Slope {
    fn draw(rng: &mut impl Rng) -> Self {
        Self {
            toe_m: rng.random_range(0.5..6.0),
            run_m: rng.random_range(6.0..25.0),
            rise_m: match rng.random_range(0..10) {
                0..3 => 0.0,
                3..7 => rng.random_range(0.5..4.0),
                _ => rng.random_range(-3.0..-0.5),
            },
            ditch_m: if rng.random_bool(0.3) {
                rng.random_range(0.2..0.7)
            } else {
                0.0
            },
        }
    }

    fn rise_m(&self, beyond_m: f64) -> f64 {
        let from_ditch = (beyond_m - self.toe_m - 4.0) / 4.0;
        let ditch = (1.0 - from_ditch * from_ditch).max(0.0);
        self.rise_m * smooth((beyond_m - self.toe_m) / self.run_m) - self.ditch_m * ditch
    }
}

#[cfg(test)]
mod tests {
    use covista_world::FrenetPoint;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn roads_stay_within_grade_crest_and_crossfall() {
        let mut hilly = 0;
        for seed in 0..40 {
            let rng = &mut ChaCha8Rng::seed_from_u64(seed);
            let course = Course::draw(rng, 3.3..3.7);
            let terrain = draw(rng, &course, [-8.0, 8.0], 0.06);
            let height = |s_m: f64, d_m: f64| {
                terrain.height_m(course.road.from_frenet(FrenetPoint { s_m, d_m }))
            };
            let mut steepest = 0.0_f64;
            for step in -12..=12 {
                let s_m = course.ego_s_m + 10.0 * f64::from(step);
                let z = [-20.0, 0.0, 20.0].map(|ds| height(s_m + ds, 0.0));
                let grade = (z[2] - z[0]) / 40.0;
                steepest = steepest.max(grade.abs());
                // 3 cm of bumps, and what bilinear cells of 4 m add to the smooth profile.
                assert!(grade.abs() < 0.06 + 0.01, "{seed}: {grade}");
                let bend_per_m = (z[0] - 2.0 * z[1] + z[2]) / 400.0;
                assert!(
                    bend_per_m.abs() < 1.0 / 400.0 + 5e-4,
                    "{seed}: {bend_per_m}"
                );
                let fall = (height(s_m, 5.0) - height(s_m, -5.0)) / 10.0;
                assert!(fall.abs() < BANK_MAX + 0.012, "{seed}: {fall}");
            }
            hilly += u32::from(steepest > 0.01);
        }
        assert!((12..36).contains(&hilly), "{hilly}");
    }
}
