use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// The first of the seeds that experiments are driven on; training draws its own.
const FIRST_SEED: u64 = 9000;

/// The seeds of an experiment, from the first to the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seeds {
    /// The first.
    pub first: u64,
    /// The last.
    pub last: u64,
}

impl Default for Seeds {
    /// Five from 9000 on.
    fn default() -> Self {
        Self {
            first: FIRST_SEED,
            last: FIRST_SEED + 4,
        }
    }
}

impl FromStr for Seeds {
    type Err = String;

    /// `N`, so many from 9000 on, or `A-B`, from A to B.
    fn from_str(text: &str) -> Result<Self, String> {
        const MOST: u64 = 10_000;
        let refused =
            || format!("give a number of seeds from 1 to {MOST}, or a range such as 9000-9009");
        let number = |text: &str| text.parse::<u64>().map_err(|_| refused());
        let (first, last) = match text.split_once('-') {
            Some((first, last)) => (number(first)?, number(last)?),
            None => {
                let count = number(text)?.min(MOST + 1);
                (FIRST_SEED, (FIRST_SEED + count).saturating_sub(1))
            }
        };
        if last < first || last - first >= MOST {
            return Err(refused());
        }
        Ok(Self { first, last })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeds_are_a_number_or_a_range() {
        let seeds = |text: &str| text.parse::<Seeds>().map(|seeds| (seeds.first, seeds.last));
        assert_eq!(seeds("1"), Ok((9000, 9000)));
        assert_eq!(seeds("5").ok(), Some((9000, 9004)));
        assert_eq!(seeds("17-20"), Ok((17, 20)));
        for bad in [
            "0",
            "",
            "-",
            "5-",
            "7-3",
            "x",
            "1-99999",
            "18446744073709551615",
            "-3",
        ] {
            assert!(seeds(bad).is_err(), "{bad}");
        }
    }
}
