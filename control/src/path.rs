use covista_world::{FrenetPoint, Road};

/// The lateral course d(s): a quintic over a stretch of road, constant beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LateralPath {
    start_s_m: f64,
    length_m: f64,
    /// Coefficients of the powers of (s - start) / length.
    coefficients: [f64; 6],
}

/// The path at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Offset d in metres.
    pub d_m: f64,
    /// Heading relative to the road.
    pub psi_rad: f64,
    /// Curvature in the world in 1/m.
    pub curvature_per_m: f64,
}

/// Spacing of the flat outputs from which the endogenous transformation takes derivatives.
const DIFFERENCE_M: f64 = 0.25;

impl LateralPath {
    /// d = `d_m` everywhere.
    pub fn constant(d_m: f64) -> Self {
        Self {
            start_s_m: 0.0,
            length_m: 1.0,
            coefficients: [d_m, 0.0, 0.0, 0.0, 0.0, 0.0],
        }
    }

    /// From d = `from_m` with slope `slope` = dd/ds at `start_s_m` to d = `to_m` along the road
    /// after `length_m`, with no second derivative at either end.
    pub fn quintic(start_s_m: f64, length_m: f64, from_m: f64, slope: f64, to_m: f64) -> Self {
        let rise = to_m - from_m;
        let first = slope * length_m;
        Self {
            start_s_m,
            length_m,
            coefficients: [
                from_m,
                first,
                0.0,
                10.0 * rise - 6.0 * first,
                -15.0 * rise + 8.0 * first,
                6.0 * rise - 3.0 * first,
            ],
        }
    }

    /// Offset d at `s_m`.
    pub fn d_m(&self, s_m: f64) -> f64 {
        let tau = ((s_m - self.start_s_m) / self.length_m).clamp(0.0, 1.0);
        self.coefficients
            .iter()
            .rev()
            .fold(0.0, |sum, coefficient| sum * tau + coefficient)
    }

    /// Where d(s) becomes constant.
    pub fn end_s_m(&self) -> f64 {
        self.start_s_m + self.length_m
    }

    /// The path at `s_m`, by the paper's endogenous transformation (Section V-A) of the flat
    /// outputs sigma = [p_x, p_y]: curvature
    /// `(sigma_1' sigma_2'' - sigma_2' sigma_1'') / |sigma'|^3`, which is the same whatever
    /// parameter the derivatives are by; here it is s, so that it holds at standstill.
    pub fn at(&self, road: &Road, s_m: f64) -> PathPoint {
        let sigma = |s_m: f64| {
            road.from_frenet(FrenetPoint {
                s_m,
                d_m: self.d_m(s_m),
            })
        };
        let (before, here, after) = (
            sigma(s_m - DIFFERENCE_M),
            sigma(s_m),
            sigma(s_m + DIFFERENCE_M),
        );
        let first = (after - before) / (2.0 * DIFFERENCE_M);
        let second = (after - 2.0 * here + before) / (DIFFERENCE_M * DIFFERENCE_M);
        let (reference, _) = road.reference(s_m);
        let along = reference.inverse_transform(reference.position() + first);
        PathPoint {
            d_m: self.d_m(s_m),
            psi_rad: along.y.atan2(along.x),
            curvature_per_m: first.perp(&second) / first.norm().powi(3).max(1e-9),
        }
    }
}

#[cfg(test)]
mod tests {
    use covista_world::{RoadSegment, Se2Pose};

    use super::*;

    fn arc() -> Road {
        let segment = RoadSegment::Arc {
            length_m: 200.0,
            curvature_per_m: 0.0125,
        };
        Road::new(Se2Pose::default(), &[segment], 3.5).expect("a road")
    }

    #[test]
    fn a_parallel_of_an_arc_has_the_radius_less_the_offset() {
        let point = LateralPath::constant(3.5).at(&arc(), 80.0);
        assert!(
            (point.curvature_per_m - 1.0 / 76.5).abs() < 1e-7,
            "{point:?}"
        );
        assert!(point.psi_rad.abs() < 1e-9);
    }

    #[test]
    fn a_quintic_meets_its_ends() {
        let path = LateralPath::quintic(10.0, 40.0, 3.4, 0.02, 0.0);
        assert!((path.d_m(10.0) - 3.4).abs() < 1e-12);
        assert!((path.d_m(10.001) - 3.4 - 2e-5).abs() < 1e-8);
        assert!(path.d_m(50.0).abs() < 1e-12 && path.d_m(90.0).abs() < 1e-12);
        let slope = (path.d_m(50.0) - path.d_m(49.999)) / 1e-3;
        assert!(slope.abs() < 1e-5);
    }
}
