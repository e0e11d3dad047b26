//! The networks under the clock: turn by turn, so that whatever else the machine does meets all
//! of them alike.

use covista_perception::{
    BenchFrame, BenchNetwork, BenchTimes, OnnxRuntime, PerceiveError, Perceiver, Precision,
    Provider, SessionSettings, time_perceiver,
};
use std::path::Path;

use super::peer::{Peer, PeerStage};
use crate::bench::turns::Turns;

/// Frames of a turn that count.
pub(super) const TURN_FRAMES: usize = 10;
/// Frames before them that don't: weights and threads come back from other networks' turns.
pub(super) const WARM_UP_FRAMES: usize = 2;

/// A network on a provider, and what was measured of it.
pub(super) struct Contestant {
    pub(super) network: BenchNetwork,
    pub(super) provider: Provider,
    /// All stages of each frame, by turn.
    pub(super) frames: Vec<Vec<BenchTimes>>,
    pub(super) alone: Turns,
    /// Boxes or places of marks found, in the frames that count.
    pub(super) found: usize,
    pub(super) others: Vec<Other>,
}

/// The same network in another program.
pub(super) struct Other {
    /// Which of the peers.
    pub(super) peer: usize,
    /// Its number for this network.
    network: usize,
    pub(super) alone: Turns,
    pub(super) end_to_end: Turns,
    pub(super) found: usize,
}

/// Both networks of the closed loop side by side.
pub(super) struct Pair {
    perceiver: Perceiver,
    pub(super) provider: Provider,
    pub(super) precision: Precision,
    pub(super) turns: Turns,
}

impl Contestant {
    pub(super) fn open(
        runtime: &OnnxRuntime,
        models: &Path,
        id: &str,
        settings: SessionSettings,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            network: BenchNetwork::open(runtime, models, id, settings)?,
            provider: settings.provider,
            frames: Vec::new(),
            alone: Vec::new(),
            found: 0,
            others: Vec::new(),
        })
    }

    /// Its id on its model card.
    pub(super) fn id(&self) -> &str {
        &self.network.card().id
    }

    /// From input in memory to result, in seconds, by turn.
    pub(super) fn end_to_end(&self) -> Turns {
        self.stage(BenchTimes::end_to_end)
    }

    /// One stage on the way, in seconds, by turn.
    pub(super) fn stage(&self, of: fn(&BenchTimes) -> std::time::Duration) -> Turns {
        let turn =
            |turn: &Vec<BenchTimes>| turn.iter().map(|times| of(times).as_secs_f64()).collect();
        self.frames.iter().map(turn).collect()
    }

    /// Lets `peers[peer]` run the network, too, under its `network`-th name.
    pub(super) fn add_other(&mut self, peer: usize, network: usize) {
        self.others.push(Other {
            peer,
            network,
            alone: Vec::new(),
            end_to_end: Vec::new(),
            found: 0,
        });
    }

    /// One turn of each way to run it, on the frames `turn` of `frames`.
    fn take_turn(
        &mut self,
        frames: &[BenchFrame],
        turn: &[usize],
        peers: &mut [Peer],
    ) -> anyhow::Result<()> {
        let mut whole = Vec::with_capacity(turn.len());
        for (place, &frame) in turn.iter().enumerate() {
            let (times, found) = self.network.time_frame(&frames[frame])?;
            if place >= WARM_UP_FRAMES {
                whole.push(times);
                self.found += found;
            }
        }
        self.frames.push(whole);
        let alone: Result<Vec<f64>, PerceiveError> = turn
            .iter()
            .map(|&frame| Ok(self.network.time_network(&frames[frame])?.as_secs_f64()))
            .collect();
        self.alone.push(alone?.split_off(WARM_UP_FRAMES));
        for other in &mut self.others {
            let peer = &mut peers[other.peer];
            let (alone, _) = peer.time(other.network, PeerStage::Network, turn, WARM_UP_FRAMES)?;
            let (whole, found) =
                peer.time(other.network, PeerStage::EndToEnd, turn, WARM_UP_FRAMES)?;
            other.alone.push(alone);
            other.end_to_end.push(whole);
            other.found += found;
        }
        Ok(())
    }
}

impl Pair {
    pub(super) fn open(
        runtime: &OnnxRuntime,
        models: &Path,
        settings: SessionSettings,
        precision: Precision,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            perceiver: Perceiver::new(runtime, models, settings)?,
            provider: settings.provider,
            precision,
            turns: Vec::new(),
        })
    }

    fn take_turn(&mut self, frames: &[BenchFrame], turn: &[usize]) -> anyhow::Result<()> {
        let times: Result<Vec<f64>, PerceiveError> = turn
            .iter()
            .map(|&frame| Ok(time_perceiver(&mut self.perceiver, &frames[frame])?.as_secs_f64()))
            .collect();
        self.turns.push(times?.split_off(WARM_UP_FRAMES));
        Ok(())
    }
}

/// Who takes turns.
#[derive(Default)]
pub(super) struct Contest {
    pub(super) contestants: Vec<Contestant>,
    pub(super) pairs: Vec<Pair>,
    pub(super) peers: Vec<Peer>,
}

impl Contest {
    /// Turns of everybody in every round, until each has `repetitions` frames that count; tells
    /// the share that is done.
    pub(super) fn hold(
        &mut self,
        frames: &[BenchFrame],
        repetitions: usize,
        progress: &dyn Fn(usize, usize),
    ) -> anyhow::Result<()> {
        let rounds = rounds(repetitions, frames.len());
        let total = rounds.len() * (self.contestants.len() + self.pairs.len());
        let mut done = 0;
        progress(done, total);
        for turn in &rounds {
            for contestant in &mut self.contestants {
                contestant.take_turn(frames, turn, &mut self.peers)?;
                done += 1;
                progress(done, total);
            }
            for pair in &mut self.pairs {
                pair.take_turn(frames, turn)?;
                done += 1;
                progress(done, total);
            }
        }
        Ok(())
    }
}

/// The frames of each round's turn, those that don't count first; the ones that count go through
/// all of `frames` again and again.
fn rounds(repetitions: usize, frames: usize) -> Vec<Vec<usize>> {
    let counted: Vec<usize> = (0..repetitions).collect();
    let turn = |counted: &[usize]| {
        let first = counted.first().copied().unwrap_or(0);
        let warm_up = (0..WARM_UP_FRAMES).map(|before| first + TURN_FRAMES + before);
        let turn = warm_up.chain(counted.iter().copied());
        turn.map(|place| place % frames.max(1)).collect()
    };
    counted.chunks(TURN_FRAMES).map(turn).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_go_through_all_frames_and_count_what_was_asked_for() {
        let turns = rounds(25, 20);
        assert_eq!(turns.len(), 3);
        let counted: Vec<_> = turns
            .iter()
            .flat_map(|turn| &turn[WARM_UP_FRAMES..])
            .collect();
        assert_eq!(counted.len(), 25);
        assert!((0..20).all(|frame| counted.contains(&&frame)));
        assert_eq!(rounds(3, 1), [[0; WARM_UP_FRAMES + 3].to_vec()]);
    }
}
