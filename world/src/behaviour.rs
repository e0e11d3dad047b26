use serde::{Deserialize, Serialize};

/// A behaviour: the paper's action set, and the emergency stop it falls back to (Alg. 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// KL.
    KeepLane,
    /// CL.
    ChangeLeft,
    /// CR.
    ChangeRight,
    /// ES: hardest safe braking within the lane.
    EmergencyStop,
}

impl Action {
    /// The paper's action set A.
    pub const ALL: [Self; 3] = [Self::KeepLane, Self::ChangeLeft, Self::ChangeRight];

    /// Whether it is a lane change.
    pub fn is_lane_change(self) -> bool {
        matches!(self, Self::ChangeLeft | Self::ChangeRight)
    }
}

/// The barriers of docs/safety.md, named as in the paper (Section V-A).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BarrierKind {
    /// A vehicle ahead in the current lane (fc).
    FrontCurrent,
    /// A vehicle ahead in the target lane (ft).
    FrontTarget,
    /// A vehicle behind in the target lane (bt).
    RearTarget,
    /// The end of the lane ahead that is confirmed free.
    Sight,
    /// The upper lateral bound (y, max: left).
    LateralMax,
    /// The lower lateral bound (y, min: right).
    LateralMin,
    /// The speed for the curvature ahead.
    CurveSpeed,
    /// There is no such lane, or a manoeuvre that excludes the action is running.
    Manoeuvre,
    /// A CAV with precedence announced the same gap.
    Arbitration,
    /// An affine barrier that a user added, by its place in the list.
    Affine(u16),
}

/// The answer to "is this action safe?" (Alg. 1, line 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ActionVerdict {
    /// The CBF-QP is feasible with no slack.
    Safe,
    /// It is not; the row that stands against it.
    Unsafe(BarrierKind),
}

/// What became of `u_nominal`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterOutcome {
    /// It satisfied every row and is applied as it was.
    Nominal,
    /// The QP moved it into the safe set.
    Filtered,
    /// No input satisfied every row; slack was used.
    Relaxed,
    /// The solver failed or an input was not finite: hardest braking.
    Backup,
}
