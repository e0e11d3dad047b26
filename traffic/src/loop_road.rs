use std::{f64::consts::FRAC_PI_2, sync::Arc};

use covista_world::{LANE_COUNT, Road, RoadSegment, Se2Pose};
use nalgebra::Vector2;

use crate::RingError;

/// No corner is tighter.
const RADIUS_MIN_M: f64 = 60.0;
/// At the inner edge of a corner the speed limit takes this acceleration across, with some
/// curvature to spare: within it no curve slows anybody down, no CAV either (`docs/safety.md`).
const LATERAL_ACCEL_MPS2: f64 = 4.0;
const SPARE_CURVATURE_PER_M: f64 = 0.003;
const CLOTHOID_M: f64 = 40.0;
/// A period has a corner to the left and one to the right for each of these.
const PAIR_OF_CORNERS_M: f64 = 1000.0;
/// Share of a short period that may be corners.
const CORNER_SHARE: f64 = 0.9;
const LANE_WIDTH_M: f64 = 3.5;
/// Road ahead of the last vehicle, to look at.
const AHEAD_M: f64 = 500.0;
const PERIOD_MIN_M: f64 = 80.0;
const PERIOD_MAX_M: f64 = 200_000.0;

/// A loop of three lanes, as an endless road whose shape repeats with its length.
///
/// In Frenet coordinates this is a loop: a vehicle at s has images at s plus any number of periods,
/// and whoever looks at it sees the one nearest to themselves. In the plane it does not bite its
/// tail, so that a position belongs to one lap only. Corners to the left and to the right take
/// turns; each is a clothoid, an arc and a clothoid.
#[derive(Debug, Clone, PartialEq)]
pub struct LoopRoad {
    road: Arc<Road>,
    period_m: f64,
    corner: Corner,
}

/// How a road runs at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bend {
    /// Curvature of the reference line in 1/m, positive to the left.
    pub curvature_per_m: f64,
    /// Angle by which it has turned since the beginning of a lap; at its end it is zero again.
    pub turned_rad: f64,
}

/// A corner in the middle of a stretch of road; its curvature over s is a trapezium.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Corner {
    /// From the middle of one corner to that of the next, which turns the other way.
    stretch_m: f64,
    clothoid_m: f64,
    arc_m: f64,
    sharpest_per_m: f64,
}

impl LoopRoad {
    /// A loop of `period_m` whose corners can be driven at `limit_mps`, unrolled for whoever
    /// starts in lap 1 and drives `way_m`.
    ///
    /// # Errors
    /// When the loop is shorter than 80 m or longer than 200 km.
    pub fn new(period_m: f64, limit_mps: f64, way_m: f64) -> Result<Self, RingError> {
        if !(PERIOD_MIN_M..=PERIOD_MAX_M).contains(&period_m) {
            return Err(RingError::Period {
                period_m,
                least_m: PERIOD_MIN_M,
                most_m: PERIOD_MAX_M,
            });
        }
        let pairs = (period_m / PAIR_OF_CORNERS_M).ceil();
        let corner = Corner::fitting(period_m / (2.0 * pairs), radius_m(limit_mps));
        let laps = 3.0 + ((way_m + AHEAD_M) / period_m).ceil();
        let pair = [1.0, -1.0].map(|side| corner.segments(side)).concat();
        let segments = pair.repeat((laps * pairs) as usize);
        let road = Road::new(Se2Pose::default(), &segments, LANE_WIDTH_M)?;
        Ok(Self {
            road: Arc::new(road),
            period_m,
            corner,
        })
    }

    /// The road, as many laps as were asked for.
    pub fn road(&self) -> &Arc<Road> {
        &self.road
    }

    /// The length of the loop in metres.
    pub fn period_m(&self) -> f64 {
        self.period_m
    }

    /// How the endless road runs at `s_m` >= 0.
    pub fn bend(&self, s_m: f64) -> Bend {
        let Corner { stretch_m, .. } = self.corner;
        // A cast truncates, and takes no call.
        let stretch = (s_m / stretch_m) as u64;
        let from_middle_m = s_m - (stretch as f64 + 0.5) * stretch_m;
        let left = self.corner.bend(from_middle_m);
        if stretch.is_multiple_of(2) {
            left
        } else {
            Bend {
                curvature_per_m: -left.curvature_per_m,
                turned_rad: self.corner.angle_rad() - left.turned_rad,
            }
        }
    }

    /// How far anybody may drive, in metres along the road: a lap before its end, so that images of
    /// those ahead are on the road, too.
    pub fn end_m(&self) -> f64 {
        self.road.length_m() - self.period_m
    }

    /// How far a lap leads in the plane, in metres: an image a lap farther along the road is moved by
    /// that, and not turned.
    pub fn lap_m(&self) -> Vector2<f64> {
        let place = |s_m| self.road.reference(s_m).0.position();
        place(self.period_m) - place(0.0)
    }

    /// The number of laps from `s_m` to its image nearest to `near_s_m`.
    pub fn laps_to(&self, s_m: f64, near_s_m: f64) -> f64 {
        ((near_s_m - s_m) / self.period_m).round()
    }
}

/// Radius of corners for a speed limit.
fn radius_m(limit_mps: f64) -> f64 {
    let sharpest = LATERAL_ACCEL_MPS2 / limit_mps.powi(2) - SPARE_CURVATURE_PER_M;
    let half_width_m = LANE_WIDTH_M * f64::from(LANE_COUNT) / 2.0;
    RADIUS_MIN_M.max(1.0 / sharpest + half_width_m)
}

impl Corner {
    /// A quarter of a turn where there is room, else a wiggle.
    fn fitting(stretch_m: f64, radius_m: f64) -> Self {
        let quarter_m = radius_m * FRAC_PI_2 + CLOTHOID_M;
        let length_m = quarter_m.min(CORNER_SHARE * stretch_m);
        let clothoid_m = CLOTHOID_M.min(length_m / 4.0);
        Self {
            stretch_m,
            clothoid_m,
            arc_m: length_m - 2.0 * clothoid_m,
            sharpest_per_m: 1.0 / radius_m,
        }
    }

    fn angle_rad(&self) -> f64 {
        (self.arc_m + self.clothoid_m) * self.sharpest_per_m
    }

    /// The bend to the left, so far beyond the middle of the corner.
    fn bend(&self, from_middle_m: f64) -> Bend {
        let way_m = from_middle_m.abs();
        let arc_m = way_m.min(self.arc_m / 2.0);
        let clothoid_m = (way_m - arc_m).min(self.clothoid_m);
        let left_share = 1.0 - clothoid_m / self.clothoid_m;
        let turned_m = arc_m + clothoid_m * (1.0 + left_share) / 2.0;
        Bend {
            curvature_per_m: left_share * self.sharpest_per_m,
            turned_rad: self.angle_rad() / 2.0
                + (turned_m * self.sharpest_per_m).copysign(from_middle_m),
        }
    }

    /// The stretch with the corner in its middle, to the left (1) or to the right (-1).
    fn segments(&self, side: f64) -> [RoadSegment; 5] {
        let sharpest = side * self.sharpest_per_m;
        let straight = RoadSegment::Straight {
            length_m: (self.stretch_m - self.arc_m) / 2.0 - self.clothoid_m,
        };
        let clothoid = |from_per_m, to_per_m| RoadSegment::Clothoid {
            length_m: self.clothoid_m,
            from_per_m,
            to_per_m,
        };
        let arc = RoadSegment::Arc {
            length_m: self.arc_m,
            curvature_per_m: sharpest,
        };
        [
            straight,
            clothoid(0.0, sharpest),
            arc,
            clothoid(sharpest, 0.0),
            straight,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_road_bends_as_the_loop_does_and_repeats() {
        for period_m in [80.0, 205.6, 308.3, 616.7, 1850.0, 5000.0] {
            let turns = LoopRoad::new(period_m, 20.0, 1000.0).expect("a loop");
            let road = turns.road();
            assert!(road.length_m() >= 1500.0 + period_m);
            for i in 0..2000 {
                let s_m = (road.length_m() - 1.0) * f64::from(i) / 2000.0;
                let bend = turns.bend(s_m);
                let again = turns.bend(s_m + 3.0 * period_m);
                for (found, expected) in [
                    (bend.curvature_per_m, road.curvature(s_m)),
                    (bend.turned_rad, road.turned_rad(s_m)),
                    (again.curvature_per_m, bend.curvature_per_m),
                    (again.turned_rad, bend.turned_rad),
                ] {
                    let error = (found - expected).abs();
                    assert!(error < 1e-9, "{period_m} {s_m} {error}");
                }
            }
            // Left and right take turns: after a lap the road leads where it led before.
            assert!(road.turn_rad(period_m, 2.0 * period_m).abs() < 1e-9);
            let [here, there] = [0.3, 1.3].map(|laps| road.reference(laps * period_m).0);
            let apart = there.position() - here.position() - turns.lap_m();
            assert!(apart.norm() < 1e-6, "{period_m} {apart}");
        }
    }

    #[test]
    fn no_curve_slows_the_fastest_down() {
        for limit_mps in [15.0, 20.0, 30.0, 35.0] {
            let turns = LoopRoad::new(1850.0, limit_mps, 1000.0).expect("a loop");
            let inner_edge = 1.0 / (1.0 / turns.road().sharpest_per_m() - 1.5 * LANE_WIDTH_M);
            let fastest = (4.0_f64 / (inner_edge + 0.003)).sqrt();
            assert!(
                (limit_mps - 1e-9..1.2 * limit_mps).contains(&fastest),
                "{fastest}"
            );
        }
    }

    #[test]
    fn laps_do_not_meet_in_the_plane() {
        let turns = LoopRoad::new(1850.0, 20.0, 3000.0).expect("a loop");
        let road = turns.road();
        for i in 0..100 {
            let s_m = road.length_m() * f64::from(i) / 100.0;
            let found = road.to_frenet(road.reference(s_m).0.position());
            assert!((found.s_m - s_m).abs() < 1e-6, "{s_m} {found:?}");
        }
    }

    #[test]
    fn a_loop_too_short_or_too_long_is_refused() {
        for period_m in [79.0, 200_001.0, f64::NAN, f64::INFINITY] {
            let error = LoopRoad::new(period_m, 20.0, 100.0).expect_err("refused");
            assert!(error.to_string().contains("80 to 200000 m"), "{error}");
        }
    }
}
