use covista_world::{Action, LaneIndex, Road};

/// What a CAV is about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Manoeuvre {
    /// Drives in `lane`.
    KeepLane {
        /// The lane.
        lane: LaneIndex,
    },
    /// Drives in `lane` and has announced a change to `to`.
    Announced {
        /// The lane it is in.
        lane: LaneIndex,
        /// The lane it wants.
        to: LaneIndex,
        /// When it announced, in seconds.
        since_s: f64,
    },
    /// Changes from `from` to `to`.
    ChangeLane {
        /// The lane it leaves.
        from: LaneIndex,
        /// The lane it enters.
        to: LaneIndex,
        /// When it announced, in seconds.
        announced_s: f64,
        /// When it began to move sideways, in seconds.
        started_s: f64,
    },
    /// Returns to `back` after a change to `from` was aborted.
    Abort {
        /// The lane of the aborted change.
        from: LaneIndex,
        /// The lane it came from.
        back: LaneIndex,
    },
}

impl Manoeuvre {
    /// The action that it amounts to, as announced to others.
    pub fn action(&self) -> Action {
        match *self {
            Self::KeepLane { .. } => Action::KeepLane,
            Self::Announced { lane: from, to, .. }
            | Self::ChangeLane { from, to, .. }
            | Self::Abort { from, back: to } => direction(from, to),
        }
    }

    /// The lane that it drives in or leaves.
    pub fn lane(&self) -> LaneIndex {
        match *self {
            Self::KeepLane { lane } | Self::Announced { lane, .. } => lane,
            Self::ChangeLane { from, .. } | Self::Abort { from, .. } => from,
        }
    }

    /// The lane in which it will end.
    pub fn destination(&self) -> LaneIndex {
        match *self {
            Self::KeepLane { lane } => lane,
            Self::Announced { to, .. } | Self::ChangeLane { to, .. } => to,
            Self::Abort { back, .. } => back,
        }
    }
}

fn direction(from: LaneIndex, to: LaneIndex) -> Action {
    if to < from {
        Action::ChangeLeft
    } else {
        Action::ChangeRight
    }
}

/// The lane next to `lane` that a lane change leads to.
pub(crate) fn lane_of(lane: LaneIndex, action: Action) -> Option<LaneIndex> {
    match action {
        Action::ChangeLeft => lane.left(),
        Action::ChangeRight => lane.right(),
        Action::KeepLane | Action::EmergencyStop => None,
    }
}

/// The lanes that a manoeuvre takes up, as the rows see them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Course {
    /// The lane that is kept or left; `None` once the body has left it.
    pub current: Option<LaneIndex>,
    /// The lane that is entered.
    pub target: Option<LaneIndex>,
    /// The lanes within which the body stays.
    pub strip: [LaneIndex; 2],
    /// When a change that runs was announced, in seconds.
    pub announced_s: Option<f64>,
}

impl Course {
    /// Keeping `lane`.
    pub fn keep(lane: LaneIndex) -> Self {
        Self {
            current: Some(lane),
            target: None,
            strip: [lane, lane],
            announced_s: None,
        }
    }

    /// Changing from `from` to `to`.
    pub fn change(from: LaneIndex, to: LaneIndex) -> Self {
        Self {
            current: Some(from),
            target: Some(to),
            strip: [from, to],
            announced_s: None,
        }
    }

    /// How far the rear axle may be from the centre of each of its lanes.
    pub fn off_center_m(&self, road: &Road) -> f64 {
        let lanes = if self.target.is_some() { 1.5 } else { 0.5 };
        lanes * road.lane_width_m()
    }
}
