//! A Markov game of vehicles on a ring, each coupled to its neighbours, small enough for its
//! global Q-functions to be computed exactly, and what is lost when they are truncated to a
//! neighbourhood (the paper's section "Truncated Q-function").

mod evaluation;
mod game;
mod games;
mod truncation;

pub use evaluation::{Evaluation, InvalidDiscount};
pub use game::{PAIRS, RingGame, Vehicle};
pub use truncation::{TruncationErrors, truncation_errors};
