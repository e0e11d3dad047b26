use std::time::Instant;

use covista_world::STEP_S;

use super::{Ring, RingError, RingSettings};

/// Density of the timed traffic.
const DENSITY: f64 = 0.5;
const WARM_UP_STEPS: u64 = 2_000;
const PARTS: usize = 5;

/// How fast a ring of human drivers is stepped, on one core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RingTiming {
    /// Vehicles on the ring.
    pub vehicles: usize,
    /// Steps of 0.01 s of one vehicle in a second: the median of five parts of the run.
    pub vehicle_steps_per_s: f64,
    /// Simulated seconds in a second.
    pub times_real_time: f64,
}

/// Times a ring of `vehicles` human drivers over about `vehicle_steps` vehicle-steps.
///
/// # Errors
/// As [`Ring::new`].
pub fn time_ring(vehicles: usize, vehicle_steps: u64) -> Result<RingTiming, RingError> {
    let mut ring = Ring::new(RingSettings {
        vehicles,
        density: DENSITY,
        ..RingSettings::default()
    })?;
    let steps = vehicle_steps.div_ceil((vehicles * PARTS) as u64);
    let mut run = |steps: u64| -> Result<f64, RingError> {
        let from = Instant::now();
        for _ in 0..steps {
            ring.step(&[])?;
        }
        Ok(steps as f64 / from.elapsed().as_secs_f64())
    };
    run(WARM_UP_STEPS.min(steps))?;
    let mut rates = [0.0; PARTS];
    for rate in &mut rates {
        *rate = run(steps)?;
    }
    rates.sort_unstable_by(f64::total_cmp);
    let steps_per_s = rates[PARTS / 2];
    Ok(RingTiming {
        vehicles,
        vehicle_steps_per_s: steps_per_s * vehicles as f64,
        times_real_time: steps_per_s * STEP_S,
    })
}
