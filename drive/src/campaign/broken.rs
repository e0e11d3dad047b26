use super::scenario::Family;

/// An assumption of the promise that a campaign breaks on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Broken {
    /// Leaders brake with 12 m/s^2.
    LeaderBraking,
    /// The plant's noise is five times its bounds.
    ProcessNoise,
    /// Estimates err by three times their bounds.
    PerceptionError,
    /// The newest measurement is three times as old as it may be.
    MessageAge,
    /// The vehicle ahead is known to nobody, and the own line of sight looks through it.
    MissedObject,
    /// A vehicle comes into the lane inside the set.
    CutIn,
    /// A vehicle that nobody told of is uncovered inside the set.
    Revealed,
    /// The follower accelerates harder and for longer than assumed.
    FollowerAcceleration,
    /// The follower brakes less than assumed.
    FollowerBraking,
}

impl Broken {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::LeaderBraking,
        Self::ProcessNoise,
        Self::PerceptionError,
        Self::MessageAge,
        Self::MissedObject,
        Self::CutIn,
        Self::Revealed,
        Self::FollowerAcceleration,
        Self::FollowerBraking,
    ];

    /// Its name in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::FollowerAcceleration => "follower-acceleration",
            Self::FollowerBraking => "follower-braking",
            _ => self.cause(),
        }
    }

    /// What the monitor calls it.
    pub fn cause(self) -> &'static str {
        match self {
            Self::LeaderBraking => "leader-braking",
            Self::ProcessNoise => "process-noise",
            Self::PerceptionError => "perception-error",
            Self::MessageAge => "message-age",
            Self::MissedObject => "missed-object",
            Self::CutIn => "cut-in",
            Self::Revealed => "revealed",
            Self::FollowerAcceleration | Self::FollowerBraking => "follower-motion",
        }
    }

    /// Whether what it breaks is the gap to a follower.
    pub fn is_about_followers(self) -> bool {
        matches!(self, Self::FollowerAcceleration | Self::FollowerBraking)
    }

    /// The episodes in which it shows.
    pub(super) fn families(self) -> &'static [Family] {
        match self {
            Self::CutIn => &[Family::CutIn],
            Self::Revealed => &[Family::CutOut],
            Self::FollowerAcceleration | Self::FollowerBraking => &[Family::LaneChange],
            Self::MissedObject => &[Family::Leaders, Family::Standing],
            Self::LeaderBraking | Self::ProcessNoise | Self::PerceptionError | Self::MessageAge => {
                &[Family::Leaders]
            }
        }
    }
}
