use std::array::from_fn;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{PAIRS, RingGame, Vehicle};

/// Speed is worth most, less while braking; who stands gains by waiting, not by wishing to go.
const TRAFFIC_REWARD: [f64; PAIRS] = [0.2, 0.0, 0.7, 1.0];

impl RingGame {
    /// `n` vehicles in dense traffic, each drawn from `seed` with a driver of its own: who goes
    /// moves unless the one ahead blocks the way, and is pressed on by one that closes up behind.
    pub fn traffic(n: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Self {
            vehicles: (0..n).map(|_| driver(&mut rng)).collect(),
            reward: TRAFFIC_REWARD,
        }
    }

    /// `n` vehicles that pass on a signal as fast as the assumption allows, and keep it: one that
    /// moves goes on, and so does one whose neighbour ahead goes; one goes that moves or sees the
    /// one ahead move. Going is worth 1.
    pub fn relay(n: usize) -> Self {
        let vehicle = Vehicle {
            moves: from_fn(|_| from_fn(|own| from_fn(|ahead| certain(own >= 2 || ahead % 2 == 1)))),
            goes: from_fn(|_| from_fn(|own| from_fn(|ahead| certain(own == 1 || ahead == 1)))),
        };
        Self {
            vehicles: vec![vehicle; n],
            reward: [0.0, 1.0, 0.0, 1.0],
        }
    }
}

fn certain(is: bool) -> f64 {
    f64::from(u8::from(is))
}

fn driver(rng: &mut ChaCha8Rng) -> Vehicle {
    let mut within = |low: f64, high: f64| rng.random_range(low..high);
    // Whether it can move if nobody hinders it: waiting and going, from a stand and on the move.
    let alone = [
        within(0.0, 0.1),
        within(0.7, 0.95),
        within(0.2, 0.5),
        within(0.9, 1.0),
    ];
    // What is left of the way: the one ahead stands, starts, brakes, drives on.
    let open = [
        within(0.0, 0.15),
        within(0.4, 0.8),
        within(0.3, 0.6),
        within(0.9, 1.0),
    ];
    let pressed = [0.0, within(0.0, 0.1), 0.0, within(0.05, 0.3)];
    let goes = from_fn(|behind| {
        from_fn(|own| {
            from_fn(|ahead| {
                let wish = [[0.3, 0.7], [0.5, 0.95]][own][ahead];
                let haste = if behind == 1 { 0.1 } else { -0.1 };
                (wish + haste * within(0.0, 1.0) + within(-0.1, 0.1)).clamp(0.05, 0.95)
            })
        })
    });
    Vehicle {
        moves: from_fn(|behind| {
            from_fn(|own| {
                from_fn(|ahead| {
                    let by_itself: f64 = alone[own] * open[ahead];
                    by_itself + pressed[behind] * (1.0 - by_itself)
                })
            })
        }),
        goes,
    }
}
