use covista_control::SafetySettings;
use covista_traffic::VehicleKind;
use covista_world::{LaneIndex, Road};

use super::{Cause, closing::Closing, knowledge::Member};
use crate::truth::{Lanes, TrueVehicle, shortest_m};

/// The true barriers of one CAV at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueBarriers {
    /// Distance barrier h in metres, without any allowance for noise.
    pub h_m: f64,
    /// Collision barrier h_0 in metres.
    pub h0_m: f64,
    /// Distance between the bodies' centres in metres.
    pub headway_m: f64,
    /// Why h is negative, while it is.
    pub cause: Option<Cause>,
}

/// A vehicle ahead of a CAV, in lanes that both occupy.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ahead {
    pub h_m: f64,
    pub h0_m: f64,
    /// h in the set's own definition: less what the promise allows for noise and curvature, and for
    /// the bodies' headings.
    pub set_h_m: f64,
    pub headway_m: f64,
    /// Time to collision, while the gap closes.
    pub ttc_s: Option<f64>,
}

/// The barrier towards the end of the free sight.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    pub h_m: f64,
    /// h, less all that the promise allows for.
    pub h_promised_m: f64,
}

/// The gaps of one CAV at one time.
#[derive(Clone, Copy)]
pub(super) struct Gaps<'a> {
    pub ego: &'a TrueVehicle,
    pub road: &'a Road,
    pub settings: &'a SafetySettings,
    plain: Closing,
    promised: Closing,
}

impl<'a> Gaps<'a> {
    pub fn new(
        ego: &'a TrueVehicle,
        road: &'a Road,
        settings: &'a SafetySettings,
        changing: bool,
    ) -> Self {
        Self {
            ego,
            road,
            settings,
            plain: Closing::plain(settings.brake_mps2, settings.leader_brake_mps2),
            promised: Closing::promised(settings, road, changing),
        }
    }

    /// The barriers towards `other`, where it is ahead in one of `lanes`.
    pub fn ahead(&self, other: &TrueVehicle, lanes: Lanes) -> Option<Ahead> {
        if lanes.is_empty() || !self.ego.is_behind(other) {
            return None;
        }
        let gap_m = self.ego.gap_to_m(other, lanes, self.road);
        let (v, v_k) = (self.ego.speed_mps, other.along_mps());
        let half_lengths_m = 0.5 * (self.ego.dimensions.length_m + other.dimensions.length_m);
        let keep_m = self.keep_m(other.dimensions.length_m);
        let closing_m = self.plain.distance_m(v, v_k);
        let closing_mps = self.ego.along_mps() - v_k;
        let stretch = (1.0 - other.frenet.curvature_per_m * other.frenet.d_m).max(0.2);
        let body = Member {
            rear_s_m: other.middle_s_m() - other.half_diagonal_m() / stretch,
            along_mps: v_k,
            length_m: other.dimensions.length_m,
        };
        Some(Ahead {
            h_m: gap_m - keep_m - closing_m,
            h0_m: gap_m - self.settings.collision_margin_m - closing_m,
            set_h_m: self.set_h_m(&body, lanes),
            headway_m: gap_m + half_lengths_m,
            ttc_s: (closing_mps > 0.0).then(|| gap_m.max(0.0) / closing_mps),
        })
    }

    /// h in the set's own definition towards what a vehicle in one of `lanes` may be.
    pub fn set_h_m(&self, body: &Member, lanes: Lanes) -> f64 {
        let way_m = shortest_m([self.ego.frenet.s_m, body.rear_s_m], lanes, self.road);
        let closing_m = (self.promised).distance_m(self.ego.speed_mps, body.along_mps);
        way_m - self.front_reach_m() - self.keep_m(body.length_m) - closing_m
    }

    /// P_bumper, and never less than the margin of the collision level.
    fn keep_m(&self, length_m: f64) -> f64 {
        let half_lengths_m = 0.5 * (self.ego.dimensions.length_m + length_m);
        (self.settings.headway_safe_m - half_lengths_m).max(self.settings.collision_margin_m)
    }

    /// What the front may gain towards the vehicle ahead by turning, and by the road's curvature.
    fn turning_reach_m(&self) -> f64 {
        let dimensions = &self.ego.dimensions;
        self.front_reach_m() - (dimensions.length_m - dimensions.rear_overhang_m)
    }

    /// How far ahead of the rear axle the front may be, at any heading.
    fn front_reach_m(&self) -> f64 {
        let dimensions = &self.ego.dimensions;
        let front_m = dimensions.length_m - dimensions.rear_overhang_m;
        self.promised.behind_rate * front_m.hypot(dimensions.width_m / 2.0)
    }

    /// The sight barrier in `lane`, free up to road s `clear_s_m`.
    pub fn sight(&self, lane: LaneIndex, clear_s_m: f64) -> Sight {
        let front_m = self.ego.s_range_m[1];
        let turned_rad = self.road.turn_rad(front_m, clear_s_m);
        let free_m = clear_s_m - front_m - self.road.lane_center_m(lane) * turned_rad;
        let half_lengths_m =
            0.5 * (self.ego.dimensions.length_m + self.settings.shortest_vehicle_m);
        let budget_m = free_m - self.settings.headway_safe_m + half_lengths_m;
        let v = self.ego.speed_mps;
        Sight {
            h_m: budget_m - self.plain.distance_m(v, 0.0),
            h_promised_m: budget_m
                - self.settings.sight_error_m
                - self.turning_reach_m()
                - self.promised.distance_m(v, 0.0),
        }
    }

    /// The collision barrier towards `behind` in `lane`, in the shape of RSS: it may accelerate
    /// with a_b for its reaction time and then brakes with b_min (docs/safety.md).
    pub fn behind_before_reaction_m(&self, behind: &TrueVehicle, lane: LaneIndex) -> f64 {
        let settings = self.settings;
        let (v, accel) = (behind.speed_mps, settings.follower_accel_mps2);
        let rho = reaction_s(behind, settings);
        let reacted_m = (v + accel * rho / 2.0) * rho;
        let stopping_m = (v + rho * accel).powi(2) / (2.0 * settings.follower_brake_mps2);
        let own_m = self.ego.speed_mps.powi(2) / (2.0 * settings.brake_mps2);
        self.behind_gap_m(behind, lane) - (reacted_m + stopping_m - own_m).max(0.0)
    }

    /// The same once it has reacted: while it brakes with b_min this does not fall.
    pub fn behind_after_reaction_m(&self, behind: &TrueVehicle, lane: LaneIndex) -> f64 {
        let settings = self.settings;
        let closing = Closing::plain(settings.follower_brake_mps2, settings.brake_mps2);
        self.behind_gap_m(behind, lane) - closing.distance_m(behind.speed_mps, self.ego.along_mps())
    }

    fn behind_gap_m(&self, behind: &TrueVehicle, lane: LaneIndex) -> f64 {
        behind.gap_to_m(self.ego, Lanes::only(lane), self.road) - self.settings.collision_margin_m
    }
}

/// rho of a vehicle.
pub(super) fn reaction_s(vehicle: &TrueVehicle, settings: &SafetySettings) -> f64 {
    match vehicle.kind {
        VehicleKind::Cav => settings.reaction_cav_s,
        VehicleKind::Human | VehicleKind::Obstacle => settings.reaction_human_s,
    }
}
