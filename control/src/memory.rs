use crate::Neighbour;
use crate::barriers::front::Front;
use crate::barriers::{Barrier, ROUNDING_M, Row};
use crate::lanes::LaneSet;

/// A front row with h < 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Excused {
    /// The neighbour's id.
    pub neighbour: u32,
    /// The assumption that broke.
    pub excuse: Excuse,
}

/// Why h < 0 towards a neighbour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Excuse {
    /// It came into the lane from beside.
    CutIn,
    /// It was not known before.
    Revealed,
    /// It stands, and the ego vehicle leaves the lane round it.
    Leaving,
    /// Its estimate was revised, or grew older. This excuses nothing: the row stays hard.
    Revised,
}

/// What was known of the neighbours in the step before, to tell why a barrier is broken.
#[derive(Debug, Clone, Default)]
pub struct Memory {
    /// By id.
    known: Vec<Known>,
    excused: Vec<Excused>,
}

#[derive(Debug, Clone, Copy)]
struct Known {
    id: u32,
    lanes: LaneSet,
    excuse: Option<Excuse>,
}

/// A level is surely broken when it is by more than what the bounds on the road's rates and on the
/// body's reach take from h.
const SURELY_M: f64 = 0.5;

impl Memory {
    /// Why h towards `neighbour` is negative, if it is: as before while it lasts. A vehicle that
    /// was not known before is excused where no member of its estimate is outside the set; one that
    /// comes in from beside where its measured gap is inside.
    pub fn judge(&self, front: &Front<'_>, neighbour: &Neighbour) -> Option<Excuse> {
        if front.h() >= -ROUNDING_M {
            return None;
        }
        if front.leaves_round() {
            return Some(Excuse::Leaving);
        }
        let before = self.find(neighbour.id);
        match before.and_then(|known| known.excuse) {
            None | Some(Excuse::Revised) => {}
            // It stays in the lane after all: what is surely missing is won back gently.
            Some(Excuse::Leaving) if front.best_h_m() < -SURELY_M => return Some(Excuse::Revealed),
            Some(Excuse::Leaving) => return Some(Excuse::Revised),
            lasting => return lasting,
        }
        let excuse = match before {
            None if front.best_h_m() < -SURELY_M => Excuse::Revealed,
            Some(known) if !known.lanes.contains(front.lane()) && front.measured_h_m() < 0.0 => {
                Excuse::CutIn
            }
            _ => Excuse::Revised,
        };
        Some(excuse)
    }

    /// Takes up the neighbours of this step and the excuses that their rows had.
    pub fn update(&mut self, neighbours: &[Neighbour], rows: &[Row]) {
        self.known.clear();
        self.excused.clear();
        let is_any_excused = rows.iter().any(|row| row.excuse.is_some());
        let rows = if is_any_excused { rows } else { &[] };
        for neighbour in neighbours {
            let excuse = rows
                .iter()
                .filter(|row| row.neighbour == Some(neighbour.id))
                .find_map(|row| row.excuse);
            self.known.push(Known {
                id: neighbour.id,
                lanes: neighbour.lanes,
                excuse,
            });
            self.excused.extend(excuse.map(|excuse| Excused {
                neighbour: neighbour.id,
                excuse,
            }));
        }
        self.known.sort_unstable_by_key(|known| known.id);
    }

    /// The front rows of the last step with h < 0.
    pub fn excused(&self) -> &[Excused] {
        &self.excused
    }

    fn find(&self, id: u32) -> Option<&Known> {
        let place = self.known.binary_search_by_key(&id, |known| known.id);
        place.ok().map(|place| &self.known[place])
    }
}
