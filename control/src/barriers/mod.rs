//! One file for each barrier. Each states h, what h becomes, and the interval that this leaves to
//! one component of u.

pub mod affine;
pub mod bounds;
pub mod curve_speed;
pub mod front;
pub mod lateral;
pub mod rear;
pub mod sight;

use covista_world::{BarrierKind, ControlInput};

use crate::memory::Excuse;

/// A barrier h at one state x.
pub trait Barrier {
    /// Its name.
    fn kind(&self) -> BarrierKind;

    /// h(x): in metres, but in m/s for the curve speed.
    fn h(&self) -> f64;

    /// The smallest h(x+) under u that noise, error and the others' worst behaviour allow.
    fn h_next(&self, u: ControlInput) -> f64;

    /// What h(x+) must reach.
    fn target(&self) -> f64;

    /// The inputs with h(x+) at its target, as an interval of one component of u.
    fn row(&self) -> Row;
}

/// The component of u that a row bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Input {
    /// u_1 = tan(delta).
    TanDelta,
    /// u_2 = a.
    Accel,
}

/// One row of the QP: an interval for one component of u.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The barrier.
    pub kind: BarrierKind,
    /// The neighbour that it is about, by its id.
    pub neighbour: Option<u32>,
    /// What it bounds.
    pub input: Input,
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// h(x) of the barrier: metres, but m/s for the curve speed.
    pub h: f64,
    /// h_0(x) of the collision level, in metres; infinite where there is none.
    pub h0_m: f64,
    /// Why h may be negative.
    pub excuse: Option<Excuse>,
}

impl Row {
    /// A row `u <= upper`.
    pub fn at_most(kind: BarrierKind, input: Input, upper: f64, h: f64) -> Self {
        Self {
            kind,
            neighbour: None,
            input,
            lower: f64::NEG_INFINITY,
            upper,
            h,
            h0_m: f64::INFINITY,
            excuse: None,
        }
    }

    /// A row `u >= lower`.
    pub fn at_least(kind: BarrierKind, input: Input, lower: f64, h: f64) -> Self {
        Self {
            lower,
            upper: f64::INFINITY,
            ..Self::at_most(kind, input, f64::INFINITY, h)
        }
    }

    /// Whether `u` meets the row.
    pub fn admits(&self, u: ControlInput) -> bool {
        (self.lower..=self.upper).contains(&self.component(u))
    }

    /// How far `u` is from meeting the row: in m/s^2, a full lock counting as ten of them.
    pub fn violation(&self, u: ControlInput) -> f64 {
        let scale = match self.input {
            Input::TanDelta => 10.0,
            Input::Accel => 1.0,
        };
        let value = self.component(u);
        scale * (value - self.upper).max(self.lower - value).max(0.0)
    }

    fn component(&self, u: ControlInput) -> f64 {
        match self.input {
            Input::TanDelta => u.tan_delta,
            Input::Accel => u.accel_mps2,
        }
    }
}

/// What h(x+) must reach: (1 - eta) h(x), or h(x) itself where it is negative.
pub fn target(h: f64, eta: f64) -> f64 {
    if h >= 0.0 { (1.0 - eta) * h } else { h }
}

/// h below zero by no more than this is rounding.
pub const ROUNDING_M: f64 = 1e-6;
