/// Largest x in `[low, high]` at which `margin`, which does not rise with x, is at least zero;
/// `None` when it is negative at `low` already.
///
/// The answer is on the safe side: its own margin was computed and is not negative. False position
/// with the rule of Anderson and Björck, and a bisection where three steps did not halve the
/// bracket, so that jumps do no harm.
pub(crate) fn largest(low: f64, high: f64, margin: impl Fn(f64) -> f64) -> Option<f64> {
    let (mut no, mut at_no) = (high, margin(high));
    if at_no >= 0.0 {
        return Some(high);
    }
    let (mut yes, mut at_yes) = (low, margin(low));
    if at_yes.is_nan() || at_yes < 0.0 {
        return None;
    }
    let mut last_was_yes = None;
    let mut widths = [f64::INFINITY; 3];
    for _ in 0..200 {
        let width = no - yes;
        let enough = WIDTH * (1.0 + yes.abs());
        if width <= enough {
            break;
        }
        let is_slow = width > 0.5 * widths[0];
        widths = if is_slow {
            [f64::INFINITY; 3]
        } else {
            [widths[1], widths[2], width]
        };
        let share = at_yes / (at_yes - at_no);
        let x = if is_slow || !(share > 0.0 && share < 1.0) {
            yes + 0.5 * width
        } else {
            // A hair off either end, so that an end that is the answer is found to be.
            (yes + share * width).clamp(yes + 0.5 * enough, no - 0.5 * enough)
        };
        let at_x = margin(x);
        let is_yes = at_x >= 0.0;
        let again = last_was_yes == Some(is_yes);
        if is_yes {
            at_no *= if again { shrunk(at_x / at_yes) } else { 1.0 };
            (yes, at_yes) = (x, at_x);
        } else {
            at_yes *= if again { shrunk(at_x / at_no) } else { 1.0 };
            (no, at_no) = (x, at_x);
        }
        last_was_yes = Some(is_yes);
    }
    Some(yes)
}

/// How much less the end counts that stayed, when the margin at the other fell to this `share`.
fn shrunk(share: f64) -> f64 {
    if share < 1.0 { 1.0 - share } else { 0.5 }
}

/// The answer is this near to the largest, in its own units.
const WIDTH: f64 = 1e-13;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_root_of_a_falling_function_is_found(
            root in -3.0..3.0_f64, slope in 0.01..50.0_f64, bend in 0.0..9.0_f64,
        ) {
            let margin = |x: f64| slope * (root - x) + bend * (root - x).powi(3);
            let found = largest(-4.0, 4.0, margin).expect("a root");
            prop_assert!(margin(found) >= 0.0 && (found - root).abs() < 1e-9, "{found} {root}");
        }

        #[test]
        fn a_jump_is_found(at in -3.0..3.0_f64, below in 1e-6..5.0_f64, above in 1e-6..1e9_f64) {
            let found = largest(-4.0, 4.0, |x| if x <= at { below } else { -above });
            prop_assert!((found.expect("a place") - at).abs() < 1e-9);
        }
    }

    #[test]
    fn a_margin_of_nothing_on_the_way_is_no_end() {
        let found = largest(0.0, 9.0, |x| if x <= 7.0 { 0.0 } else { 7.0 - x });
        assert!((found.expect("a place") - 7.0).abs() < 1e-9);
    }

    #[test]
    fn the_ends_are_told_apart() {
        assert_eq!(largest(0.0, 1.0, |_| -1.0), None);
        assert_eq!(largest(0.0, 1.0, |_| f64::NAN), None);
        assert_eq!(largest(0.0, 1.0, |_| 0.0), Some(1.0));
        let found = largest(0.0, 1.0, |x| if x > 0.5 { f64::NEG_INFINITY } else { 1.0 });
        assert!((found.expect("a place") - 0.5).abs() < 1e-12);
        let dies = largest(0.0, 1.0, |x| if x > 0.25 { f64::NAN } else { 1.0 });
        assert!((dies.expect("a place") - 0.25).abs() < 1e-12);
    }
}
