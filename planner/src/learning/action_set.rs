use covista_world::Action;
use serde::{Deserialize, Serialize};

/// Number of actions of the paper's set A: the actor chooses among these.
pub const CHOICES: usize = Action::ALL.len();
/// Number of actions that can be executed: A and the emergency stop, which the critic values too.
pub const ACTIONS: usize = CHOICES + 1;

/// The place of an action in a row of values: keep lane, change left, change right, emergency stop.
pub fn action_index(action: Action) -> usize {
    match action {
        Action::KeepLane => 0,
        Action::ChangeLeft => 1,
        Action::ChangeRight => 2,
        Action::EmergencyStop => 3,
    }
}

/// A subset of the paper's action set A, such as its safe part. The emergency stop is outside A.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ActionSet(u8);

impl ActionSet {
    /// No action: only the emergency stop is left.
    pub const EMPTY: Self = Self(0);
    /// A itself.
    pub const ALL: Self = Self(0b111);

    /// The set with `action` in it; the emergency stop changes nothing.
    #[must_use]
    pub fn with(self, action: Action) -> Self {
        Self((self.0 | 1 << action_index(action)) & Self::ALL.0)
    }

    /// Whether `action` is in it.
    pub fn contains(self, action: Action) -> bool {
        self.0 >> action_index(action) & 1 == 1
    }

    /// Whether nothing but the emergency stop is left.
    pub fn is_empty(self) -> bool {
        self == Self::EMPTY
    }

    /// The actions in both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Its actions, in the order of [`Action::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Action> {
        Action::ALL.into_iter().filter(move |&a| self.contains(a))
    }

    /// Number of its actions.
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    pub(super) fn bits(self) -> u8 {
        self.0
    }

    pub(super) fn from_bits(bits: u8) -> Self {
        Self(bits & Self::ALL.0)
    }
}

impl FromIterator<Action> for ActionSet {
    fn from_iter<I: IntoIterator<Item = Action>>(actions: I) -> Self {
        actions.into_iter().fold(Self::EMPTY, Self::with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Action::{ChangeLeft, ChangeRight, EmergencyStop, KeepLane};

    #[test]
    fn the_emergency_stop_is_never_a_member() {
        let set: ActionSet = [ChangeRight, EmergencyStop].into_iter().collect();
        assert_eq!(set.iter().collect::<Vec<_>>(), [ChangeRight]);
        assert!(!set.contains(EmergencyStop) && !set.contains(KeepLane));
        assert_eq!(ActionSet::from_bits(0xff), ActionSet::ALL);
        assert!(ActionSet::EMPTY.with(EmergencyStop).is_empty());
    }

    #[test]
    fn sets_meet() {
        let left: ActionSet = [KeepLane, ChangeLeft].into_iter().collect();
        let right: ActionSet = [KeepLane, ChangeRight].into_iter().collect();
        assert_eq!(left.and(right), ActionSet::EMPTY.with(KeepLane));
        assert_eq!((left.len(), ActionSet::ALL.len()), (2, CHOICES));
    }
}
