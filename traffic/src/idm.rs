use rand::Rng;

use crate::BRAKING_MAX_MPS2;

/// The intelligent driver model of Treiber, Hennecke and Helbing (2000), with exponent 4.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Idm {
    /// Desired speed v0 in m/s.
    pub desired_speed_mps: f64,
    /// Safe time headway T in s.
    pub time_headway_s: f64,
    /// Maximum acceleration a in m/s^2.
    pub accel_max_mps2: f64,
    /// Comfortable deceleration b in m/s^2.
    pub comfortable_braking_mps2: f64,
    /// Jam distance s0 in m, bumper to bumper.
    pub jam_distance_m: f64,
}

/// What is ahead of a driver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ahead {
    /// Bumper to bumper distance in m.
    pub gap_m: f64,
    /// Speed of the leader in m/s.
    pub speed_mps: f64,
}

impl Idm {
    /// The parameters of Treiber 2000 with a desired speed of one's own.
    pub fn treiber2000(desired_speed_mps: f64) -> Self {
        Self {
            desired_speed_mps,
            time_headway_s: 1.6,
            accel_max_mps2: 0.73,
            comfortable_braking_mps2: 1.67,
            jam_distance_m: 2.0,
        }
    }

    /// A driver of their own: every parameter within 15 %, the desired speed within 4 %.
    pub fn draw(desired_speed_mps: f64, rng: &mut impl Rng) -> Self {
        Self::draw_within(desired_speed_mps, 0.04, 0.15, rng)
    }

    /// A driver of their own: the desired speed within the first of these shares of the mean,
    /// every other parameter within the second.
    pub fn draw_within(
        desired_speed_mps: f64,
        speed_spread: f64,
        spread: f64,
        rng: &mut impl Rng,
    ) -> Self {
        let mean = Self::treiber2000(desired_speed_mps);
        let mut draw = |value: f64, share: f64| {
            let shares = 1.0 - share..1.0 + share;
            if shares.is_empty() {
                value
            } else {
                value * rng.random_range(shares)
            }
        };
        Self {
            desired_speed_mps: draw(mean.desired_speed_mps, speed_spread),
            time_headway_s: draw(mean.time_headway_s, spread),
            accel_max_mps2: draw(mean.accel_max_mps2, spread),
            comfortable_braking_mps2: draw(mean.comfortable_braking_mps2, spread),
            jam_distance_m: draw(mean.jam_distance_m, spread),
        }
    }

    /// Acceleration at `speed_mps`, bounded to what the brakes give.
    pub fn acceleration(&self, speed_mps: f64, ahead: Option<Ahead>) -> f64 {
        let free = 1.0 - (speed_mps / self.desired_speed_mps).powi(4);
        let interaction = ahead.map_or(0.0, |leader| {
            let desired_gap_m = self.desired_gap_m(speed_mps, speed_mps - leader.speed_mps);
            (desired_gap_m / leader.gap_m.max(0.1)).powi(2)
        });
        (self.accel_max_mps2 * (free - interaction)).clamp(-BRAKING_MAX_MPS2, self.accel_max_mps2)
    }

    /// The speed at which a driver follows a leader of the same speed at this gap: the root of
    /// gap = (s0 + v T) / sqrt(1 - (v / v0)^4), from below.
    pub fn equilibrium_speed_mps(&self, gap_m: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.desired_speed_mps);
        for _ in 0..60 {
            let speed_mps = 0.5 * (low + high);
            let free = 1.0 - (speed_mps / self.desired_speed_mps).powi(4);
            if self.desired_gap_m(speed_mps, 0.0) < gap_m * free.sqrt() {
                low = speed_mps;
            } else {
                high = speed_mps;
            }
        }
        low
    }

    /// The gap s* a driver wants at this speed and closing speed.
    pub fn desired_gap_m(&self, speed_mps: f64, closing_mps: f64) -> f64 {
        let brake = 2.0 * (self.accel_max_mps2 * self.comfortable_braking_mps2).sqrt();
        let dynamic = speed_mps * self.time_headway_s + speed_mps * closing_mps / brake;
        self.jam_distance_m + dynamic.max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_equilibrium_gap_is_treibers() {
        let idm = Idm::treiber2000(15.0);
        let speed_mps: f64 = 10.0;
        // s_e(v) = (s0 + v T) / sqrt(1 - (v / v0)^4), Eq. 8 of the paper of 2000 without s1.
        let gap_m = (2.0 + 10.0 * 1.6) / (1.0 - (speed_mps / 15.0).powi(4)).sqrt();
        let accel = idm.acceleration(speed_mps, Some(Ahead { gap_m, speed_mps }));
        assert!(accel.abs() < 1e-12, "{accel}");
        assert!(idm.acceleration(15.0, None).abs() < 1e-12);
        assert!((idm.acceleration(0.0, None) - 0.73).abs() < 1e-12);
    }

    #[test]
    fn braking_is_bounded() {
        let idm = Idm::treiber2000(15.0);
        let wall = Ahead {
            gap_m: -1.0,
            speed_mps: 0.0,
        };
        let accel = idm.acceleration(30.0, Some(wall));
        assert!((accel + BRAKING_MAX_MPS2).abs() < 1e-12);
    }
}
