use covista_world::{CollectivePerceptionMessage, Se2Pose, StationId, wrap_angle};
use nalgebra::{Rotation2, Vector2};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use serde::{Deserialize, Serialize};

/// By how much a station is wrong about its own pose: normal errors of mean zero, independent in
/// x, y and heading and from message to message, as in OpenCOOD.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseNoise {
    /// Standard deviation of the position, each axis, in metres.
    pub position_std_m: f64,
    /// Standard deviation of the heading in radians.
    pub yaw_std_rad: f64,
}

impl PoseNoise {
    /// Standard deviation, each axis, of where such a station places what is `distance_m` away
    /// from it: an upper bound, because the heading's error counts across the line of sight only.
    pub fn position_std_at_m(&self, distance_m: f64) -> f64 {
        self.position_std_m.hypot(self.yaw_std_rad * distance_m)
    }

    /// The message that the sender of `message` broadcasts when it takes its pose for the one that
    /// `seed`, station and time draw: everything in it moves with the sender, like a rigid body.
    pub(crate) fn misplaced(
        &self,
        seed: u64,
        mut message: CollectivePerceptionMessage,
    ) -> CollectivePerceptionMessage {
        if *self == Self::default() {
            return message;
        }
        let true_position = message.pose.position();
        let error = self.draw(seed, message.station, message.time_s);
        let rotation = Rotation2::new(error.yaw_rad);
        let misplaced = |pose: Se2Pose| {
            let position =
                true_position + error.position() + rotation * (pose.position() - true_position);
            let yaw_rad = wrap_angle(pose.yaw_rad + error.yaw_rad);
            Se2Pose::new(position.x, position.y, yaw_rad)
        };
        message.pose = misplaced(message.pose);
        for object in &mut message.objects {
            object.state.center = misplaced(object.state.center);
            object.state.velocity_mps = rotation * object.state.velocity_mps;
        }
        message
    }

    fn draw(&self, seed: u64, station: StationId, time_s: f64) -> Se2Pose {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(u64::from(station.0) << 32 ^ (time_s * 1e3).round() as u64);
        let [x, y, yaw]: [f64; 3] = std::array::from_fn(|_| rng.sample(StandardNormal));
        let offset = Vector2::new(x, y) * self.position_std_m;
        Se2Pose::new(offset.x, offset.y, yaw * self.yaw_std_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::VehicleDimensions;
    use covista_world::{Action, LaneIndex, ObjectClass, ObjectState, PerceivedObject};

    const NOISE: PoseNoise = PoseNoise {
        position_std_m: 0.2,
        yaw_std_rad: 0.0035,
    };
    const SEDAN: VehicleDimensions = VehicleDimensions {
        length_m: 4.6,
        width_m: 1.9,
        height_m: 1.5,
        wheelbase_m: 2.7,
        rear_overhang_m: 0.9,
    };

    /// A message of station 3 at (10, 20) that tells of an object 50 m away.
    fn message(time_s: f64) -> CollectivePerceptionMessage {
        CollectivePerceptionMessage {
            station: StationId(3),
            time_s,
            pose: Se2Pose::new(10.0, 20.0, 1.0),
            speed_mps: 14.0,
            accel_mps2: 0.0,
            dimensions: SEDAN,
            lane: LaneIndex::LEFTMOST,
            action: Action::KeepLane,
            announced_s: 0.0,
            objects: vec![PerceivedObject {
                object_id: 0,
                state: ObjectState {
                    center: Se2Pose::new(40.0, 60.0, -0.5),
                    velocity_mps: Vector2::new(3.0, 4.0),
                    length_m: 4.6,
                    width_m: 1.9,
                    height_m: 1.5,
                    class: ObjectClass::Car,
                },
                position_std_m: 0.3,
                velocity_std_mps: 1.0,
                lane: None,
                measured_s: time_s,
                confidence: 0.9,
            }],
        }
    }

    #[test]
    fn the_sender_and_what_it_sees_move_as_one() {
        for tick in 0..20 {
            let sent = message(0.1 * f64::from(tick));
            let said = NOISE.misplaced(7, sent.clone());
            let relative = |message: &CollectivePerceptionMessage| {
                let state = &message.objects[0].state;
                let place = message.pose.inverse_transform(state.center.position());
                let velocity = Rotation2::new(-message.pose.yaw_rad) * state.velocity_mps;
                let yaw_rad = wrap_angle(state.center.yaw_rad - message.pose.yaw_rad);
                [place.x, place.y, velocity.x, velocity.y, yaw_rad]
            };
            for (a, b) in relative(&sent).into_iter().zip(relative(&said)) {
                assert!((a - b).abs() < 1e-9);
            }
            assert_ne!(sent.pose, said.pose);
            assert!((said.pose.position() - sent.pose.position()).norm() < 1.2);
        }
    }

    #[test]
    fn the_errors_have_the_standard_deviation_asked_for() {
        let count = 4000;
        let mut squared = [0.0; 3];
        for tick in 0..count {
            let sent = message(0.1 * f64::from(tick));
            let said = NOISE.misplaced(1, sent.clone());
            let error = said.pose.position() - sent.pose.position();
            let errors = [error.x, error.y, said.pose.yaw_rad - sent.pose.yaw_rad];
            for (sum, error) in squared.iter_mut().zip(errors) {
                *sum += error * error;
            }
        }
        let std = squared.map(|sum| (sum / f64::from(count)).sqrt());
        for (std, asked) in std.into_iter().zip([0.2, 0.2, 0.0035]) {
            assert!((std / asked - 1.0).abs() < 0.05, "{std} {asked}");
        }
    }

    #[test]
    fn an_error_is_a_function_of_seed_station_and_time() {
        let other_station = CollectivePerceptionMessage {
            station: StationId(4),
            ..message(0.3)
        };
        let said = |seed, message| NOISE.misplaced(seed, message).pose;
        let first = said(1, message(0.3));
        assert_eq!(first, said(1, message(0.3)));
        assert_ne!(first, said(2, message(0.3)));
        assert_ne!(first, said(1, message(0.4)));
        assert_ne!(first, said(1, other_station));
    }

    #[test]
    fn without_noise_a_message_stays_as_it_is_and_adds_no_uncertainty() {
        let none = PoseNoise::default();
        assert_eq!(none.misplaced(1, message(0.1)), message(0.1));
        assert_eq!(
            0.3_f64.hypot(none.position_std_at_m(80.0)).to_bits(),
            0.3_f64.to_bits()
        );
        assert!((NOISE.position_std_at_m(100.0) - 0.403).abs() < 1e-3);
    }
}
