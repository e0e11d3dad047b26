use std::collections::BTreeMap;

use covista_world::{CollectivePerceptionMessage, StationId};
use serde::{Deserialize, Serialize};

/// An ideal broadcast channel: everybody within range hears everything, at once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Communication range in metres, between the reference points of two vehicles.
    pub range_m: f64,
}

impl Default for Channel {
    fn default() -> Self {
        Self { range_m: 150.0 }
    }
}

/// What one round of broadcasts brought.
#[derive(Debug, Clone, PartialEq)]
pub struct Delivery<'a> {
    /// For each sender, what it hears of the others, in the order of the messages given.
    pub inboxes: BTreeMap<StationId, Vec<&'a CollectivePerceptionMessage>>,
    /// The communication graph: the pairs within range, the lower station first.
    pub links: Vec<(StationId, StationId)>,
    /// Bytes broadcast, each message counted once however many hear it.
    pub bytes_sent: usize,
}

impl Channel {
    /// Delivers each station's message to the others within range.
    pub fn deliver<'a>(&self, messages: &'a [CollectivePerceptionMessage]) -> Delivery<'a> {
        let mut delivery = Delivery {
            inboxes: messages.iter().map(|m| (m.station, Vec::new())).collect(),
            links: Vec::new(),
            bytes_sent: messages.iter().map(encoded_len).sum(),
        };
        for receiver in messages {
            for sender in messages.iter().filter(|m| m.station != receiver.station) {
                let distance_m = (sender.pose.position() - receiver.pose.position()).norm();
                if distance_m <= self.range_m {
                    if let Some(inbox) = delivery.inboxes.get_mut(&receiver.station) {
                        inbox.push(sender);
                    }
                    if receiver.station < sender.station {
                        delivery.links.push((receiver.station, sender.station));
                    }
                }
            }
        }
        delivery.links.sort_unstable();
        delivery
    }
}

/// Bytes of a message in a compact binary form of fixed fields.
///
/// Sender: station 4, time 6, x and y 4 each, heading, speed and acceleration 2 each, length,
/// width, height, wheelbase and overhang 2 each, lane 1, action 1, time announced 6, number of
/// objects 1. Each object: number 2, x and y 4 each, heading 2, velocity 2 + 2, length, width and
/// height 2 each, class 1, standard deviations 2 + 2, lane 1, age 2, confidence 1. Centimetres,
/// cm/s, 0.01 degrees, milliseconds. Thirty objects make 973 bytes; a CPM of ETSI TS 103 324 with
/// thirty took 938.
pub fn encoded_len(message: &CollectivePerceptionMessage) -> usize {
    const SENDER: usize = 4 + 6 + 2 * 4 + 3 * 2 + 5 * 2 + 1 + 1 + 6 + 1;
    const OBJECT: usize = 2 + 2 * 4 + 2 + 2 * 2 + 3 * 2 + 1 + 2 * 2 + 1 + 2 + 1;
    SENDER + OBJECT * message.objects.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use covista_world::{Action, LaneIndex, Se2Pose, VehicleDimensions};

    fn message(station: u32, x_m: f64) -> CollectivePerceptionMessage {
        CollectivePerceptionMessage {
            station: StationId(station),
            time_s: 0.0,
            pose: Se2Pose::new(x_m, 0.0, 0.0),
            speed_mps: 0.0,
            accel_mps2: 0.0,
            dimensions: VehicleDimensions {
                length_m: 4.6,
                width_m: 1.9,
                height_m: 1.5,
                wheelbase_m: 2.51,
                rear_overhang_m: 1.0,
            },
            lane: LaneIndex::LEFTMOST,
            action: Action::KeepLane,
            announced_s: 0.0,
            objects: Vec::new(),
        }
    }

    #[test]
    fn a_chain_hears_its_neighbours_only() {
        let messages = [message(3, 0.0), message(1, 150.0), message(2, 300.1)];
        let delivery = Channel::default().deliver(&messages);
        assert_eq!(delivery.links, [(StationId(1), StationId(3))]);
        assert_eq!(delivery.inboxes[&StationId(3)], [&messages[1]]);
        assert_eq!(delivery.inboxes[&StationId(1)], [&messages[0]]);
        assert!(delivery.inboxes[&StationId(2)].is_empty());
        assert_eq!(delivery.bytes_sent, 3 * 43);
    }

    #[test]
    fn who_does_not_know_where_it_is_is_in_nobodys_range() {
        let messages = [message(1, f64::NAN), message(2, 0.0)];
        assert!(Channel::default().deliver(&messages).links.is_empty());
    }
}
