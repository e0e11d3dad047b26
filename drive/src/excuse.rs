/// Why h < 0 towards a vehicle is nobody's fault of the CAV's: it was so at once, as it came into
/// the lane or into sight.
///
/// - A vehicle that comes into sight is excused where h < 0 then, on the truth.
/// - One that comes into the lane, from beside or past the CAV, is excused where h < 0 then, on the
///   truth or as the CAV's newest measurement has it. Until a measurement tells of it, what it does
///   can't be heeded; it is judged when one does.
///
/// An excuse lasts until the worst that the CAV must make of its knowledge is back at h >= 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Excuse {
    /// It was inside the set at once.
    pub at_once: bool,
    /// It is in the lane, and no measurement has told of that yet.
    pub untold: bool,
}

/// What one step shows of a vehicle that is, or is known to be, ahead in a lane of the CAV's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Moment {
    /// It has just come into the lane, and the CAV had been there.
    pub comes_in: bool,
    /// It has just come into sight.
    pub appears: bool,
    /// It has just come into the lane as the CAV knows it.
    pub is_known_to_come_in: bool,
    /// Whether it has come in and no measurement tells that it is there, or need have told.
    pub is_untold: bool,
    /// Whether h < 0 on the truth.
    pub is_inside: bool,
    /// Whether h < 0 by the newest measurement.
    pub is_inside_as_known: bool,
    /// Whether h >= 0 towards the worst that may be made of the measurement.
    pub is_won_back: bool,
}

impl Excuse {
    /// Whether there is any.
    pub fn holds(self) -> bool {
        self.at_once || self.untold
    }

    /// The excuse after one more step.
    pub fn after(self, now: &Moment) -> Self {
        let begins = (now.comes_in || now.appears) && now.is_inside
            || now.is_known_to_come_in && now.is_inside_as_known;
        let is_told_late = self.untold && !now.is_untold;
        let is_late = is_told_late && (now.is_inside || now.is_inside_as_known);
        Self {
            at_once: begins || is_late || self.at_once && !now.is_won_back,
            untold: now.is_untold,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: Excuse = Excuse {
        at_once: false,
        untold: false,
    };
    const AT_ONCE: Excuse = Excuse {
        at_once: true,
        untold: false,
    };
    const UNTOLD: Excuse = Excuse {
        at_once: false,
        untold: true,
    };
    const NOTHING: Moment = Moment {
        comes_in: false,
        appears: false,
        is_known_to_come_in: false,
        is_untold: false,
        is_inside: false,
        is_inside_as_known: false,
        is_won_back: false,
    };

    #[test]
    fn h_below_zero_excuses_only_when_its_reason_comes() {
        let inside = Moment {
            is_inside: true,
            is_inside_as_known: true,
            ..NOTHING
        };
        assert_eq!(NONE.after(&inside), NONE);
        let reasons = [
            Moment {
                comes_in: true,
                ..inside
            },
            Moment {
                appears: true,
                ..inside
            },
            Moment {
                is_known_to_come_in: true,
                ..inside
            },
        ];
        for reason in reasons {
            assert_eq!(NONE.after(&reason), AT_ONCE);
            let outside = Moment {
                is_inside: false,
                is_inside_as_known: false,
                ..reason
            };
            assert_eq!(NONE.after(&outside), NONE);
        }
        // What the measurement says does not count for one that comes into sight.
        let appears = Moment {
            appears: true,
            is_inside_as_known: true,
            ..NOTHING
        };
        assert_eq!(NONE.after(&appears), NONE);
    }

    #[test]
    fn it_ends_when_the_set_is_won_back() {
        assert_eq!(AT_ONCE.after(&NOTHING), AT_ONCE);
        let won_back = Moment {
            is_won_back: true,
            ..NOTHING
        };
        assert_eq!(AT_ONCE.after(&won_back), NONE);
    }

    #[test]
    fn what_no_measurement_tells_of_is_judged_when_one_does() {
        let untold = Moment {
            comes_in: true,
            is_untold: true,
            ..NOTHING
        };
        let excuse = NONE.after(&untold);
        assert_eq!(excuse, UNTOLD);
        let later = Moment {
            comes_in: false,
            ..untold
        };
        assert_eq!(excuse.after(&later), UNTOLD);
        assert_eq!(excuse.after(&NOTHING), NONE);
        let inside = Moment {
            is_inside_as_known: true,
            ..NOTHING
        };
        assert_eq!(excuse.after(&inside), AT_ONCE);
    }
}
