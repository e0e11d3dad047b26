/// Which assumption of the promise broke when a CAV left its safe set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cause {
    /// The run began inside the set: h(x_0) < 0.
    Start,
    /// A vehicle entered the CAV's lane inside the set.
    CutIn,
    /// The vehicle ahead came into sight, or was uncovered by another, inside the set.
    Revealed,
    /// Excused: the CAV, slower than 5 m/s, leaves its lane round a stopped vehicle.
    Leaving,
    /// The CAV knew nothing of the vehicle although it had been in sight for long enough.
    MissedObject,
    /// Its knowledge of the vehicle was wrong by more than the bound.
    PerceptionError,
    /// Its knowledge of the vehicle was older than the bound.
    MessageAge,
    /// None of them: a defect of covista.
    Unattributed,
}

impl Cause {
    /// Its name in summaries and traces.
    pub fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::CutIn => "cut-in",
            Self::Revealed => "revealed",
            Self::Leaving => "leaving",
            Self::MissedObject => "missed-object",
            Self::PerceptionError => "perception-error",
            Self::MessageAge => "message-age",
            Self::Unattributed => "unattributed",
        }
    }

    /// What the trace's column `excused` says: the excuses that the promise itself names.
    pub fn excuse(self) -> &'static str {
        match self {
            Self::CutIn | Self::Revealed | Self::Leaving => self.name(),
            _ => "",
        }
    }
}
