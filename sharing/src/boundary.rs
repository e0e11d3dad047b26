use covista_world::{CollectivePerceptionMessage, Percept, Validate};

/// Clocks may differ by this much before a message is from the future.
const CLOCK_TOLERANCE_S: f64 = 0.05;

/// What came in and what was refused at the boundary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReceptionCounts {
    /// Messages taken up.
    pub accepted: u64,
    /// Messages with a number that is not finite or a body without size.
    pub invalid: u64,
    /// Messages, or objects in them, from after now.
    pub future: u64,
    /// Messages older than [`crate::TrackerSettings::oldest_message_s`].
    pub stale: u64,
    /// Own percepts with a number that is not finite or a body without size.
    pub invalid_percepts: u64,
}

/// Why a message is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    Invalid,
    Future,
    Stale,
}

/// What stands against `message` at `now_s`, if anything does.
pub(crate) fn refusal(
    message: &CollectivePerceptionMessage,
    now_s: f64,
    oldest_s: f64,
) -> Option<Refusal> {
    let newest_s = (message.objects.iter()).fold(message.time_s, |newest, object| {
        newest.max(object.measured_s)
    });
    if message.validate().is_err() || !has_usable_sizes(message) {
        Some(Refusal::Invalid)
    } else if newest_s > now_s + CLOCK_TOLERANCE_S {
        Some(Refusal::Future)
    } else if message.time_s < now_s - oldest_s {
        Some(Refusal::Stale)
    } else {
        None
    }
}

fn has_usable_sizes(message: &CollectivePerceptionMessage) -> bool {
    let own = &message.dimensions;
    are_positive(&[own.length_m, own.width_m, own.height_m, own.wheelbase_m])
        && own.rear_overhang_m.is_finite()
        && message.objects.iter().all(|object| {
            are_positive(&[
                object.state.length_m,
                object.state.width_m,
                object.state.height_m,
                object.position_std_m,
                object.velocity_std_mps,
            ])
        })
}

/// Whether a percept's box has a place, a size and a score.
pub(crate) fn is_usable(percept: &Percept) -> bool {
    let detection = &percept.detection;
    detection.center_m.iter().all(|value| value.is_finite())
        && are_positive(detection.size_m.as_slice())
        && detection.yaw_rad.is_finite()
        && detection.score.is_finite()
}

fn are_positive(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite() && *value > 0.0)
}
