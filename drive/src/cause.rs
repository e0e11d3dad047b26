/// Which assumption of the promise broke when a CAV left its safe set.
///
/// A violation begins when h towards a vehicle ahead, on the truth and without any allowance, falls
/// below zero, and lasts until it is back. Its cause is found once, when it begins:
///
/// - `start`, `cut-in` and `revealed` excuse it only where h, less the promise's own allowance for
///   noise, curvature and the error of what the CAV knows of the vehicle, was already negative when
///   the run began, the vehicle entered the lane or it came into sight, and has been so ever since;
/// - every other cause is an observation that a bound of `SafetySettings` did not hold, for this
///   pair of vehicles, at the time or within the three seconds before: as long as braking to
///   standstill takes.
///
/// Where several hold, the excuses go first, then what vehicles did, in the order of this list, then
/// the newest that the CAV did not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cause {
    /// The run began inside the set: h(x_0) < 0.
    Start,
    /// A human driver came over the line, or past the CAV within its lane, inside the set.
    CutIn,
    /// The vehicle came into sight, or was uncovered by another, inside the set, and nobody had
    /// told of it; or the CAV's own sight broke off inside the set, less than
    /// `perception_delay_s` after the vehicle came into sight. Not where the free sight ended
    /// before it all the time: the sight row promises room to stop there.
    Revealed,
    /// Excused: the CAV, slower than `leaving_speed_mps`, leaves its lane round a stopped vehicle
    /// towards which the collision level holds.
    Leaving,
    /// The vehicle ahead lost more than b_l (`leader_brake_mps2`) of its speed along the lane, or
    /// drove backwards.
    LeaderBraking,
    /// The CAV did not move as its input and the bicycle model say, by more than W_p
    /// (`noise_position_m`), W_v (`noise_speed_mps`) or the lateral bounds.
    ProcessNoise,
    /// The one behind accelerated by more than a_b (`follower_accel_mps2`), or did not brake with
    /// b_min (`follower_brake_mps2`) where it had to, its reaction time after the lane change
    /// began. It explains a gap lost to a follower, never a violation of h.
    FollowerMotion,
    /// The CAV had no track of the vehicle, within `sight_range_m`, `perception_delay_s` after it
    /// came into sight.
    MissedObject,
    /// The track's newest measurement was older than `knowledge_age_max_s`.
    MessageAge,
    /// The vehicle was nearer, or its speed along the lane more dangerous, than
    /// `error_sigmas` standard deviations of its track allow, or it was in a lane of the CAV
    /// while its track was not.
    PerceptionError,
    /// A vehicle in sight was not known, and the lane said to be confirmed free to more than
    /// `sight_error_m` past its rear.
    SightError,
    /// None of them: a defect of covista.
    Unattributed,
}

impl Cause {
    /// How many there are.
    pub(crate) const COUNT: usize = Self::Unattributed as usize + 1;

    /// All of them, in order.
    pub(crate) const ALL: [Self; Self::COUNT] = [
        Self::Start,
        Self::CutIn,
        Self::Revealed,
        Self::Leaving,
        Self::LeaderBraking,
        Self::ProcessNoise,
        Self::FollowerMotion,
        Self::MissedObject,
        Self::MessageAge,
        Self::PerceptionError,
        Self::SightError,
        Self::Unattributed,
    ];

    /// Its name in summaries and traces.
    pub fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::CutIn => "cut-in",
            Self::Revealed => "revealed",
            Self::Leaving => "leaving",
            Self::LeaderBraking => "leader-braking",
            Self::ProcessNoise => "process-noise",
            Self::FollowerMotion => "follower-motion",
            Self::MissedObject => "missed-object",
            Self::MessageAge => "message-age",
            Self::PerceptionError => "perception-error",
            Self::SightError => "sight-error",
            Self::Unattributed => "unattributed",
        }
    }

    /// What the trace's column `excused` says: the excuses that the promise itself names.
    pub fn excuse(self) -> &'static str {
        match self {
            Self::Start | Self::CutIn | Self::Revealed | Self::Leaving => self.name(),
            _ => "",
        }
    }
}
