use std::{
    collections::{BTreeMap, VecDeque},
    sync::Arc,
};

use covista_world::{CollectivePerceptionMessage, StationId};
use serde::{Deserialize, Serialize};

use crate::PoseNoise;

/// Two times closer than this are the same.
const SAME_TIME_S: f64 = 1e-6;

/// How messages pass between vehicles. The default is ideal but for its range: at once, from
/// senders that know where they are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelSettings {
    /// Communication range in metres, between the reference points of two vehicles.
    pub range_m: f64,
    /// Time from broadcast to reception in seconds.
    pub latency_s: f64,
    /// By how much senders are wrong about their poses.
    pub pose_noise: PoseNoise,
}

impl Default for ChannelSettings {
    fn default() -> Self {
        Self {
            range_m: 150.0,
            latency_s: 0.0,
            pose_noise: PoseNoise::default(),
        }
    }
}

/// A broadcast channel: everybody within range of the sender hears everything, all after the same
/// time.
#[derive(Debug, Clone)]
pub struct Channel {
    settings: ChannelSettings,
    seed: u64,
    /// Oldest first.
    in_flight: VecDeque<Broadcast>,
}

#[derive(Debug, Clone)]
struct Broadcast {
    sent_s: f64,
    message: Arc<CollectivePerceptionMessage>,
    receivers: Vec<StationId>,
}

/// What one round of broadcasts brought.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Delivery {
    /// For each station of the round, what has reached it since the last one, in the order of
    /// sending.
    pub inboxes: BTreeMap<StationId, Vec<Arc<CollectivePerceptionMessage>>>,
    /// The communication graph: the pairs within range, the lower station first.
    pub links: Vec<(StationId, StationId)>,
    /// Bytes broadcast, each message counted once however many hear it.
    pub bytes_sent: usize,
}

impl Channel {
    /// A channel with nothing under way; `seed` draws the senders' errors.
    pub fn new(settings: ChannelSettings, seed: u64) -> Self {
        Self {
            settings,
            seed,
            in_flight: VecDeque::new(),
        }
    }

    /// Takes up the message of each station, with the poses as they truly are, and delivers what
    /// has arrived by `now_s`. Whoever is within range when a message is sent hears it.
    pub fn exchange(&mut self, now_s: f64, messages: Vec<CollectivePerceptionMessage>) -> Delivery {
        let mut delivery = Delivery {
            inboxes: messages.iter().map(|m| (m.station, Vec::new())).collect(),
            links: self.links(&messages),
            bytes_sent: messages.iter().map(encoded_len).sum(),
        };
        for message in messages {
            let sender = message.station;
            let receivers = delivery.links.iter().filter_map(|&(a, b)| match sender {
                _ if sender == a => Some(b),
                _ if sender == b => Some(a),
                _ => None,
            });
            self.in_flight.push_back(Broadcast {
                sent_s: now_s,
                receivers: receivers.collect(),
                message: Arc::new(self.settings.pose_noise.misplaced(self.seed, message)),
            });
        }
        let under_way_s = self.settings.latency_s - SAME_TIME_S;
        while let Some(broadcast) =
            (self.in_flight).pop_front_if(|broadcast| now_s - broadcast.sent_s >= under_way_s)
        {
            for receiver in broadcast.receivers {
                if let Some(inbox) = delivery.inboxes.get_mut(&receiver) {
                    inbox.push(Arc::clone(&broadcast.message));
                }
            }
        }
        delivery
    }

    fn links(&self, messages: &[CollectivePerceptionMessage]) -> Vec<(StationId, StationId)> {
        let mut links = Vec::new();
        for a in messages {
            for b in messages.iter().filter(|b| a.station < b.station) {
                let distance_m = (b.pose.position() - a.pose.position()).norm();
                if distance_m <= self.settings.range_m {
                    links.push((a.station, b.station));
                }
            }
        }
        links.sort_unstable();
        links
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

    fn heard(delivery: &Delivery, station: u32) -> Vec<(u32, f64)> {
        let inbox = &delivery.inboxes[&StationId(station)];
        inbox.iter().map(|m| (m.station.0, m.time_s)).collect()
    }

    fn ideal() -> Channel {
        Channel::new(ChannelSettings::default(), 0)
    }

    #[test]
    fn a_chain_hears_its_neighbours_only() {
        let messages = vec![message(3, 0.0), message(1, 150.0), message(2, 300.1)];
        let delivery = ideal().exchange(0.0, messages.clone());
        assert_eq!(delivery.links, [(StationId(1), StationId(3))]);
        assert_eq!(*delivery.inboxes[&StationId(3)][0], messages[1]);
        assert_eq!(*delivery.inboxes[&StationId(1)][0], messages[0]);
        assert!(delivery.inboxes[&StationId(2)].is_empty());
        assert_eq!(delivery.bytes_sent, 3 * 43);
    }

    #[test]
    fn who_does_not_know_where_it_is_is_in_nobodys_range() {
        let messages = vec![message(1, f64::NAN), message(2, 0.0)];
        assert!(ideal().exchange(0.0, messages).links.is_empty());
    }

    #[test]
    fn a_message_arrives_after_the_latency_whole_and_once() {
        let mut channel = Channel::new(
            ChannelSettings {
                latency_s: 0.2,
                ..ChannelSettings::default()
            },
            0,
        );
        for tick in 0..30_u32 {
            let now_s = 0.1 * f64::from(tick);
            // The second drives out of range at 1 s: what was sent before still arrives.
            let x_m = if tick < 10 { 100.0 } else { 200.0 };
            let messages = [(1, 0.0), (2, x_m)].map(|(station, x_m)| CollectivePerceptionMessage {
                time_s: now_s,
                ..message(station, x_m)
            });
            let delivery = channel.exchange(now_s, messages.to_vec());
            let expected = if (2..12).contains(&tick) {
                vec![(1, 0.1 * f64::from(tick - 2))]
            } else {
                Vec::new()
            };
            assert_eq!(heard(&delivery, 2), expected, "tick {tick}");
            assert_eq!(delivery.links.len(), usize::from(tick < 10));
        }
    }

    #[test]
    fn range_is_between_true_places_and_the_error_in_what_is_said() {
        let settings = ChannelSettings {
            pose_noise: crate::PoseNoise {
                position_std_m: 100.0,
                yaw_std_rad: 0.0,
            },
            ..ChannelSettings::default()
        };
        let messages = vec![message(1, 0.0), message(2, 150.0)];
        let delivery = Channel::new(settings, 5).exchange(0.0, messages.clone());
        assert_eq!(delivery.links.len(), 1);
        let said = &delivery.inboxes[&StationId(2)][0];
        assert!((said.pose.position() - messages[0].pose.position()).norm() > 1.0);
        let again = Channel::new(settings, 5).exchange(0.0, messages);
        assert_eq!(delivery, again);
    }
}
