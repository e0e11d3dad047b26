use covista_control::{Manoeuvre, SafetySettings};
use covista_traffic::VehicleKind;

use super::{Cause, MEMORY_S, TOLERANCE_M, barriers::Ahead, motion::Last};
use crate::truth::{Lanes, TrueVehicle};

/// When one vehicle has had another in sight.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct InSight {
    since_s: Option<f64>,
    lost_s: Option<f64>,
}

impl InSight {
    pub fn note(&mut self, visible: bool, time_s: f64, memory_s: f64) {
        if !visible {
            self.lost_s.get_or_insert(time_s);
            return;
        }
        if self.since_s(time_s, memory_s).is_none() {
            self.since_s = Some(time_s);
        }
        self.lost_s = None;
    }

    /// Since when it has been in sight, interruptions of up to `memory_s` left out; `None` while
    /// it is not.
    pub fn since_s(&self, time_s: f64, memory_s: f64) -> Option<f64> {
        let lost = self.lost_s.is_some_and(|lost_s| time_s - lost_s > memory_s);
        self.since_s.filter(|_| !lost)
    }
}

/// What is known of a CAV and another vehicle from the steps before.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pair {
    pub in_sight: InSight,
    /// Whether the other was ahead in a lane of the CAV.
    was_ahead: bool,
    /// Why h, less the promise's allowance, has been negative from the first on.
    excuse: Option<Cause>,
    /// The newest time at which the CAV's knowledge of the other broke an assumption.
    pub broken: Option<(Cause, f64)>,
    /// Whether h_0 >= 0.
    inside: bool,
    episode: Option<Cause>,
    /// The lane change after which the other follows the CAV.
    pub following: Option<super::followers::Following>,
}

/// A CAV meets a vehicle ahead.
#[derive(Clone, Copy)]
pub(super) struct Meeting<'a> {
    pub time_s: f64,
    /// Whether this is the first step of all.
    pub first: bool,
    pub settings: &'a SafetySettings,
    pub ego: &'a TrueVehicle,
    pub other: &'a TrueVehicle,
    pub manoeuvre: Manoeuvre,
    /// Lanes that both occupy.
    pub shared: Lanes,
    /// Lanes of the CAV at the last step.
    pub own_lanes_before: Lanes,
    /// Whether the CAV has a track of the other.
    pub known: bool,
    /// Whether the other stands, in truth or as the CAV knows it.
    pub stands: bool,
    /// Whether the CAV's own free sight broke off.
    pub sight_broke_off: bool,
    /// Whether it reaches past the other, over a vehicle that hides it.
    pub sight_reaches_past: bool,
    /// The other lost more speed than leaders may.
    pub leader_braking: Last,
    /// The CAV did not move as its input says.
    pub process_noise: Last,
}

impl Pair {
    /// The newest broken assumption on knowledge that may still explain what happens.
    pub fn broken_lately(&self, time_s: f64) -> Option<(Cause, f64)> {
        self.broken
            .filter(|(_, broke_s)| time_s - broke_s < MEMORY_S)
    }

    /// Whether the other is now ahead in a lane of the CAV and was not before.
    pub fn comes_in(&self, ahead: Option<&Ahead>) -> bool {
        ahead.is_some() && !self.was_ahead
    }

    /// Takes in one step; the cause of a violation that begins with it.
    pub fn step(&mut self, meeting: &Meeting<'_>, ahead: Option<&Ahead>) -> Option<Cause> {
        self.excuse = ahead
            .filter(|ahead| ahead.h_promised_m < 0.0)
            .and_then(|ahead| self.excuse.or_else(|| self.excuse_of(meeting, ahead)));
        let violated = ahead.filter(|ahead| ahead.h_m < -TOLERANCE_M);
        let goes_on = violated.zip(self.episode).filter(|(ahead, cause)| {
            // Going round a standing vehicle excuses the distance, never the collision level.
            *cause != Cause::Leaving || is_inside(ahead)
        });
        let begins = violated
            .filter(|_| goes_on.is_none())
            .map(|ahead| self.cause(meeting, ahead));
        self.episode = begins.or(goes_on.map(|(_, cause)| cause));
        self.was_ahead = ahead.is_some();
        begins
    }

    /// Takes in whether h_0 holds; whether it has just ceased to.
    pub fn leaves_collision_set(&mut self, ahead: Option<&Ahead>) -> bool {
        let inside = ahead.is_none_or(is_inside);
        std::mem::replace(&mut self.inside, inside) && !inside
    }

    /// Why h is negative, while it is.
    pub fn episode(&self) -> Option<Cause> {
        self.episode
    }

    /// Why h, less the promise's allowance, is negative at once.
    fn excuse_of(&self, meeting: &Meeting<'_>, ahead: &Ahead) -> Option<Cause> {
        let own_lane = meeting.shared.shared_with(meeting.own_lanes_before);
        let came_in = self.comes_in(Some(ahead)) && !own_lane.is_empty();
        if meeting.first {
            Some(Cause::Start)
        } else if came_in && meeting.other.kind == VehicleKind::Human {
            Some(Cause::CutIn)
        } else {
            self.is_revealed(meeting).then_some(Cause::Revealed)
        }
    }

    /// Whether the CAV could not know of the other, and need not have stopped short of it.
    fn is_revealed(&self, meeting: &Meeting<'_>) -> bool {
        let settings = meeting.settings;
        let in_sight_s = self
            .in_sight
            .since_s(meeting.time_s, settings.sight_memory_s)
            .map_or(0.0, |since_s| meeting.time_s - since_s);
        let hidden = in_sight_s <= 0.0;
        let fresh = in_sight_s < settings.perception_delay_s;
        let excused = meeting.sight_broke_off && fresh || meeting.sight_reaches_past && hidden;
        !meeting.known && excused
    }

    /// Why h becomes negative.
    fn cause(&self, meeting: &Meeting<'_>, ahead: &Ahead) -> Cause {
        let time_s = meeting.time_s;
        if let Some(excuse) = self.excuse {
            excuse
        } else if leaves(meeting, ahead) {
            Cause::Leaving
        } else if meeting.leader_braking.explains(time_s) {
            Cause::LeaderBraking
        } else if meeting.process_noise.explains(time_s) {
            Cause::ProcessNoise
        } else {
            let broken = self.broken_lately(time_s);
            broken.map_or(Cause::Unattributed, |(cause, _)| cause)
        }
    }
}

fn is_inside(ahead: &Ahead) -> bool {
    ahead.h0_m >= -TOLERANCE_M
}

/// What the speed noise of some steps may add.
const NEARLY_MPS: f64 = 0.1;

/// Whether the CAV is slow and about to leave its lane round a standing vehicle.
fn leaves(meeting: &Meeting<'_>, ahead: &Ahead) -> bool {
    let from = match meeting.manoeuvre {
        Manoeuvre::ChangeLane { from, .. } => Some(from),
        _ => None,
    };
    from.is_some_and(|from| meeting.shared.contains(from))
        && meeting.ego.speed_mps <= meeting.settings.leaving_speed_mps + NEARLY_MPS
        && meeting.stands
        && is_inside(ahead)
}
