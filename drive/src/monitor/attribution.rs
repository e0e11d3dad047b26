use covista_control::{Manoeuvre, SafetySettings};
use covista_traffic::VehicleKind;

use super::{Cause, MEMORY_S, TOLERANCE_M, barriers::Ahead, motion::Last};
use crate::{
    excuse::{Excuse, Moment},
    truth::{Lanes, TrueVehicle},
};

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
    broke_off: bool,
    /// Lanes of the CAV's in which the CAV knew the other ahead of it.
    known_ahead_in: Option<Lanes>,
    /// All lanes of the other, and when it came into the newest of them.
    lanes: Lanes,
    pub entered_s: f64,
    excuse: Excuse,
    /// When it came in before the CAV.
    came_in_s: Option<f64>,
    /// What the excuse is.
    reason: Option<Cause>,
    /// The CAV goes round it, slowly.
    leaving: bool,
    /// The newest time at which the CAV's knowledge of the other broke an assumption.
    pub broken: Option<(Cause, f64)>,
    /// Whether h_0 >= 0.
    inside: bool,
    episode: Option<Cause>,
    /// The lane change after which the other follows the CAV.
    pub following: Option<super::followers::Following>,
}

/// A vehicle as the CAV knows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct KnownAhead {
    /// Lanes of the CAV's that it is known in, if it is known to be ahead there.
    pub ahead_in: Lanes,
    /// Whether one of them is no lane that is merely left.
    pub is_in_own: bool,
    pub measured_s: f64,
    /// h by the newest measurement, in the set's own definition.
    pub h_m: f64,
    /// h towards the worst that may be made of it.
    pub worst_h_m: f64,
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
    /// Lanes that the other is in and the CAV is in, enters or leaves.
    pub shared: Lanes,
    /// Lanes that the CAV was in, entered or left at the last step.
    pub own_lanes_before: Lanes,
    /// What the CAV has a track of, if it has any.
    pub known: Option<KnownAhead>,
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

    /// Takes in the lanes that the other is in.
    pub fn note_lanes(&mut self, lanes: Lanes, time_s: f64) {
        if !lanes.without(self.lanes).is_empty() {
            self.entered_s = time_s;
        }
        self.lanes = lanes;
    }

    /// Takes in one step; the cause of a violation that begins with it.
    /// `claimed` is the other where it is ahead in a lane that the CAV is in, enters or leaves, and
    /// `ahead` where it is in one that the CAV is in.
    pub fn step(
        &mut self,
        meeting: &Meeting<'_>,
        claimed: Option<&Ahead>,
        ahead: Option<&Ahead>,
    ) -> Option<Cause> {
        self.excuse(meeting, claimed);
        let is_slow = meeting.ego.speed_mps <= meeting.settings.leaving_speed_mps + NEARLY_MPS;
        let is_won_back = is_won_back(meeting, claimed);
        self.leaving = is_slow && !is_won_back && (self.leaving || leaves(meeting));
        let violated = ahead.filter(|ahead| ahead.h_m < -TOLERANCE_M);
        let goes_on = violated.zip(self.episode).filter(|(ahead, cause)| {
            // Going round a standing vehicle excuses the distance, never the collision level.
            *cause != Cause::Leaving || self.leaving && is_inside(ahead)
        });
        let begins = violated
            .filter(|_| goes_on.is_none())
            .map(|ahead| self.cause(meeting, ahead));
        self.episode = begins.or(goes_on.map(|(_, cause)| cause));
        self.was_ahead = claimed.is_some();
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

    /// Whether h < 0 was so at once.
    fn excuse(&mut self, meeting: &Meeting<'_>, ahead: Option<&Ahead>) {
        let settings = meeting.settings;
        let known_in = meeting.known.map(|known| known.ahead_in);
        let before_in = std::mem::replace(&mut self.known_ahead_in, known_in);
        let broke_off_before = self.broke_off;
        self.broke_off = self.is_lost_from_sight(meeting);
        let is_revealed = self.is_hidden(meeting) || self.broke_off && !broke_off_before;
        let known_ahead = known_in.filter(|lanes| !lanes.is_empty());
        if ahead.is_none() && known_ahead.is_none() {
            (self.excuse, self.reason, self.came_in_s) = (Excuse::default(), None, None);
            return;
        }
        // A CAV may not come in inside the set.
        let is_human = meeting.other.kind == VehicleKind::Human;
        let into_own = |lanes: Lanes| !lanes.shared_with(meeting.own_lanes_before).is_empty();
        let latest_s = settings.perception_delay_s + settings.knowledge_age_max_s;
        let h_m = ahead.map(|ahead| ahead.set_h_m);
        let comes_in =
            is_human && !meeting.first && self.comes_in(ahead) && into_own(meeting.shared);
        if comes_in {
            self.came_in_s = Some(meeting.time_s);
        }
        // From the lane that the CAV leaves into the one that it enters.
        let followed_s =
            (is_human && !meeting.first && known_ahead.is_some()).then_some(self.entered_s);
        let came_in_s = self.came_in_s.or(followed_s);
        let moment = Moment {
            comes_in,
            appears: meeting.first || ahead.is_some() && is_revealed,
            is_known_to_come_in: is_human
                && before_in
                    .zip(known_ahead)
                    .is_some_and(|(before, now)| into_own(now.without(before))),
            is_untold: !meeting.known.is_some_and(|known| known.is_in_own)
                && came_in_s.is_some_and(|since_s| {
                    let could_tell = |known: KnownAhead| known.measured_s >= since_s;
                    meeting.time_s <= since_s + latest_s && !meeting.known.is_some_and(could_tell)
                }),
            is_inside: h_m.is_some_and(|h_m| h_m < if meeting.first { -EDGE_M } else { EDGE_M }),
            is_inside_as_known: meeting.known.is_some_and(|known| known.h_m < EDGE_M),
            is_won_back: is_won_back(meeting, ahead),
        };
        let before = self.excuse;
        self.excuse = before.after(&moment);
        if !self.excuse.holds() {
            self.reason = None;
        } else if !before.holds() {
            self.reason = Some(if meeting.first {
                Cause::Start
            } else if moment.comes_in || moment.is_known_to_come_in || moment.is_untold {
                Cause::CutIn
            } else {
                Cause::Revealed
            });
        }
    }

    /// Whether the CAV can't know of the other, which is hidden behind another in the lane, or has
    /// just come into sight.
    fn is_hidden(&self, meeting: &Meeting<'_>) -> bool {
        meeting.known.is_none() && meeting.sight_reaches_past && self.in_sight_s(meeting) <= 0.0
    }

    /// Whether the other has not been in sight for long and the CAV's sight broke off inside the set.
    fn is_lost_from_sight(&self, meeting: &Meeting<'_>) -> bool {
        let is_fresh = self.in_sight_s(meeting) < meeting.settings.perception_delay_s;
        meeting.known.is_none() && meeting.sight_broke_off && is_fresh
    }

    fn in_sight_s(&self, meeting: &Meeting<'_>) -> f64 {
        (self.in_sight)
            .since_s(meeting.time_s, meeting.settings.sight_memory_s)
            .map_or(0.0, |since_s| meeting.time_s - since_s)
    }

    /// Why h becomes negative.
    fn cause(&self, meeting: &Meeting<'_>, ahead: &Ahead) -> Cause {
        let time_s = meeting.time_s;
        if let Some(reason) = self.reason {
            reason
        } else if self.leaving && is_inside(ahead) {
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

/// By how much h may differ from what the controller takes it for, on a curved road.
const EDGE_M: f64 = 0.05;
/// The same towards the worst of an estimate, for which the controller takes the road's sharpest
/// curvature within reach.
const WORST_EDGE_M: f64 = 0.5;

/// Whether h >= 0 towards the worst that the CAV must make of what it knows.
fn is_won_back(meeting: &Meeting<'_>, ahead: Option<&Ahead>) -> bool {
    let worst_h_m = match (meeting.known, ahead) {
        (Some(known), _) if !known.ahead_in.is_empty() => known.worst_h_m,
        (_, Some(ahead)) => ahead.set_h_m,
        _ => f64::INFINITY,
    };
    worst_h_m >= WORST_EDGE_M
}

/// Whether the CAV is slow and about to leave its lane round a standing vehicle.
fn leaves(meeting: &Meeting<'_>) -> bool {
    let from = match meeting.manoeuvre {
        Manoeuvre::ChangeLane { from, .. } | Manoeuvre::Abort { from, .. } => Some(from),
        _ => None,
    };
    from.is_some_and(|from| meeting.shared.contains(from)) && meeting.stands
}
