use std::fmt;

use covista_traffic::VehicleKind;
use covista_world::{Action, FilterOutcome, LaneIndex};

/// The columns of a trace.
pub const TRACE_HEADER: &str = "run,t_s,id,kind,x_m,y_m,yaw_rad,s_m,d_m,lane,v_mps,a_mps2,length_m,width_m,action,mapped_action,outcome,h_m,h0_m,excused";

/// The truth of one vehicle at one time: one row of the trace. Position is that of the rear axle.
///
/// Its `Display` is the row without a line break.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TraceRow {
    /// `sharing` or `alone`.
    pub run: &'static str,
    /// Time in seconds.
    pub t_s: f64,
    /// Vehicle.
    pub id: u32,
    /// What drives it.
    pub kind: VehicleKind,
    /// World x in metres.
    pub x_m: f64,
    /// World y in metres.
    pub y_m: f64,
    /// World heading in radians.
    pub yaw_rad: f64,
    /// Along the road in metres.
    pub s_m: f64,
    /// Left of the reference line in metres.
    pub d_m: f64,
    /// Lane of the body's centre.
    pub lane: Option<LaneIndex>,
    /// Speed in m/s.
    pub v_mps: f64,
    /// Acceleration in m/s^2.
    pub a_mps2: f64,
    /// Body length in metres.
    pub length_m: f64,
    /// Body width in metres.
    pub width_m: f64,
    /// The action the policy valued highest, of a CAV.
    pub action: Option<Action>,
    /// The action after the safe action mapping, of a CAV.
    pub mapped_action: Option<Action>,
    /// What became of the nominal input, of a CAV.
    pub outcome: Option<FilterOutcome>,
    /// True distance barrier in metres.
    pub h_m: Option<f64>,
    /// True collision barrier in metres.
    pub h0_m: Option<f64>,
    /// Distance between reference points to the vehicle ahead in metres; not a column of the CSV.
    pub headway_m: Option<f64>,
    /// The excuse while h is negative.
    pub excused: &'static str,
}

impl fmt::Display for TraceRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            VehicleKind::Cav => "cav",
            VehicleKind::Human => "human",
            VehicleKind::Obstacle => "obstacle",
        };
        write!(
            f,
            "{},{:.2},{},{kind},{:.4},{:.4},{:.6},{:.4},{:.4},{},{:.4},{:.4},{:.3},{:.3},{},{},{},{},{},{}",
            self.run,
            self.t_s,
            self.id,
            self.x_m,
            self.y_m,
            self.yaw_rad,
            self.s_m,
            self.d_m,
            cell(self.lane.map(LaneIndex::get)),
            self.v_mps,
            self.a_mps2,
            self.length_m,
            self.width_m,
            cell(self.action.map(action_name)),
            cell(self.mapped_action.map(action_name)),
            cell(self.outcome.map(outcome_name)),
            cell(self.h_m.map(|h| format!("{h:.4}"))),
            cell(self.h0_m.map(|h| format!("{h:.4}"))),
            self.excused,
        )
    }
}

fn cell(value: Option<impl fmt::Display>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

fn action_name(action: Action) -> &'static str {
    match action {
        Action::KeepLane => "keep_lane",
        Action::ChangeLeft => "change_left",
        Action::ChangeRight => "change_right",
        Action::EmergencyStop => "emergency_stop",
    }
}

fn outcome_name(outcome: FilterOutcome) -> &'static str {
    match outcome {
        FilterOutcome::Nominal => "nominal",
        FilterOutcome::Filtered => "filtered",
        FilterOutcome::Relaxed => "relaxed",
        FilterOutcome::Backup => "backup",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_as_many_cells_as_the_header() {
        let row = TraceRow {
            run: "alone",
            t_s: 0.1,
            id: 3,
            kind: VehicleKind::Human,
            x_m: 1.0,
            y_m: 2.0,
            yaw_rad: 0.0,
            s_m: 1.0,
            d_m: 0.0,
            lane: LaneIndex::new(1),
            v_mps: 14.0,
            a_mps2: 0.0,
            length_m: 4.7,
            width_m: 1.8,
            action: None,
            mapped_action: None,
            outcome: None,
            h_m: None,
            h0_m: None,
            headway_m: None,
            excused: "",
        };
        assert_eq!(
            row.to_string().split(',').count(),
            TRACE_HEADER.split(',').count()
        );
    }
}
