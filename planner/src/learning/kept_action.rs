use covista_world::Action;

use super::batch::write_one_hot;
use super::{ACTIONS, InputShares, action_index};

/// The byte of an action that is not told.
pub(super) const UNKNOWN: u8 = u8::MAX;
/// Bytes of the longest action.
pub(super) const MOST_BYTES: usize = 2;
/// Steps of a byte for one share: of 4 m/s^2, 0.03 m/s^2.
const STEPS: f32 = 127.0;

/// Numbers by which a critic reads a neighbour's control input: its shares, and whether it is told.
pub(super) const INPUT_FEATURES: usize = 3;

/// What an agent does, as the replay buffer keeps it.
pub(super) trait KeptAction: Copy {
    /// In bytes, of which an action of A takes one and a control input two.
    fn bytes(self) -> [u8; MOST_BYTES];
}

impl KeptAction for Action {
    fn bytes(self) -> [u8; MOST_BYTES] {
        [action_index(self) as u8, UNKNOWN]
    }
}

impl KeptAction for InputShares {
    fn bytes(self) -> [u8; MOST_BYTES] {
        self.map(|share| ((share.clamp(-1.0, 1.0) + 1.0) * STEPS).round() as u8)
    }
}

/// Bytes of an action that a critic reads by `features` numbers.
pub(super) fn bytes_of(features: usize) -> usize {
    if features == ACTIONS { 1 } else { MOST_BYTES }
}

/// The control input that was kept.
pub(super) fn restored(bytes: [u8; MOST_BYTES]) -> InputShares {
    bytes.map(|byte| f32::from(byte) / STEPS - 1.0)
}

/// Writes a neighbour's action as the critic reads it; all zero where it is not told.
pub(super) fn write_action(bytes: &[u8], to: &mut [f32]) {
    match *bytes {
        [steering, accel] if steering != UNKNOWN => {
            let [steering, accel] = restored([steering, accel]);
            to.copy_from_slice(&[steering, accel, 1.0]);
        }
        [place] => write_one_hot(place, to),
        _ => to.fill(0.0),
    }
}

#[cfg(test)]
#[allow(clippy::float_cmp)] // these numbers are exact
mod tests {
    use super::*;

    #[test]
    fn a_control_input_comes_back_but_for_its_last_digits() {
        for share in [-1.0_f32, -0.3, 0.0, 0.004, 0.71, 1.0] {
            let [steering, accel] = restored([share, -share].bytes());
            assert!(
                (steering - share).abs() <= 0.5 / STEPS,
                "{steering} for {share}"
            );
            assert!((steering + accel).abs() < 1e-6);
        }
        let mut read = [9.0; INPUT_FEATURES];
        let told: InputShares = [0.0, 1.0];
        write_action(&told.bytes(), &mut read);
        assert_eq!(read, [0.0, 1.0, 1.0]);
        write_action(&[UNKNOWN; MOST_BYTES], &mut read);
        assert_eq!(read, [0.0; INPUT_FEATURES]);
    }
}
