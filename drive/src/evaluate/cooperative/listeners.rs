use std::collections::BTreeMap;

use covista_sharing::{Channel, ChannelSettings, Tracker, TrackerSettings};
use covista_traffic::VehicleId;
use covista_world::{StationId, Track};

use crate::{CavSnapshot, Snapshot};

/// A tracker for each CAV of a loop, beside the one that it drives by.
pub(super) struct Listeners {
    settings: TrackerSettings,
    trackers: BTreeMap<VehicleId, Tracker>,
    channel: Option<Channel>,
}

impl Listeners {
    /// Trackers that share over such a channel or, without one, not at all.
    pub fn new(channel: Option<ChannelSettings>, seed: u64) -> Self {
        Self {
            settings: TrackerSettings {
                pose_noise: channel.unwrap_or_default().pose_noise,
                ..TrackerSettings::default()
            },
            trackers: BTreeMap::new(),
            channel: channel.map(|settings| Channel::new(settings, seed)),
        }
    }

    /// Takes up what the CAVs perceive, and lets them talk.
    pub fn step(&mut self, snapshot: &Snapshot<'_>) {
        let time_s = snapshot.time_s;
        for vehicle in snapshot.traffic.vehicles() {
            let Some(cav) = snapshot.cavs.iter().find(|cav| cav.id == vehicle.id) else {
                continue;
            };
            let tracker = self.trackers.entry(cav.id).or_insert_with(|| {
                Tracker::new(station_of(cav.id), vehicle.dimensions(), self.settings)
            });
            if let Some(percepts) = cav.percepts {
                tracker.observe(time_s, cav.own.pose, cav.own.speed_mps, percepts);
            }
        }
        let Some(channel) = &mut self.channel else {
            return;
        };
        let messages = snapshot.cavs.iter().filter_map(|cav| {
            let tracker = self.trackers.get_mut(&cav.id)?;
            Some(tracker.message(time_s, &cav.own))
        });
        let delivery = channel.exchange(time_s, messages.collect());
        for (&id, tracker) in &mut self.trackers {
            if let Some(inbox) = delivery.inboxes.get(&station_of(id)) {
                tracker.receive(time_s, inbox.iter().map(AsRef::as_ref));
            }
        }
    }

    /// What `cav` knows.
    pub fn tracks(&self, cav: &CavSnapshot<'_>, time_s: f64) -> Vec<Track> {
        let tracker = self.trackers.get(&cav.id);
        tracker.map_or_else(Vec::new, |tracker| tracker.tracks(time_s))
    }
}

fn station_of(cav: VehicleId) -> StationId {
    StationId(cav.0)
}

#[cfg(test)]
mod tests {
    use covista_sharing::PoseNoise;
    use covista_traffic::Scenario;

    use super::*;
    use crate::{ControlSettings, RunConfig, Senses, run};

    /// What is compared of a track: what it announces lags by a control step.
    fn known(tracks: &[Track]) -> Vec<Track> {
        let unannounced = |track: &Track| Track {
            action: None,
            announced_s: None,
            ..track.clone()
        };
        tracks.iter().map(unannounced).collect()
    }

    #[test]
    fn over_the_loops_own_channel_they_know_what_the_cavs_drive_by() {
        let noisy = ChannelSettings {
            latency_s: 0.2,
            pose_noise: PoseNoise {
                position_std_m: 0.2,
                yaw_std_rad: 0.003,
            },
            ..ChannelSettings::default()
        };
        for channel in [ChannelSettings::default(), noisy] {
            let config = RunConfig {
                scenario: Scenario::builtin("obstacle-at-corner").expect("a scenario"),
                seed: 1000,
                sharing: true,
                channel,
                duration_s: 3.0,
                control: ControlSettings::default(),
            };
            let mut listeners = Listeners::new(Some(channel), config.seed);
            let mut ideal = Listeners::new(Some(ChannelSettings::default()), config.seed);
            let (mut frames, mut alike) = (0, 0);
            run(&config, &mut Senses::Truth, &mut |snapshot| {
                listeners.step(snapshot);
                ideal.step(snapshot);
                if let Some(focus) = &snapshot.focus {
                    let is_focus = |cav: &&CavSnapshot<'_>| station_of(cav.id) == focus.station;
                    let cav = snapshot.cavs.iter().find(is_focus).expect("the CAV");
                    let heard = known(&listeners.tracks(cav, snapshot.time_s));
                    assert_eq!(heard, known(&focus.tracks), "at {} s", snapshot.time_s);
                    frames += 1;
                    alike += usize::from(heard == known(&ideal.tracks(cav, snapshot.time_s)));
                }
                Ok(())
            })
            .expect("a run");
            assert_eq!(frames, 8);
            let is_ideal = channel == ChannelSettings::default();
            assert_eq!(alike, if is_ideal { frames } else { 0 });
        }
    }
}
