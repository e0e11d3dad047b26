/// What a network's id says of it: `FAMILY-p8-int8` is the family's network pruned to an eighth of
/// its work and quantised, `FAMILY-zeros8` the dense one with that many weights set to 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Member<'a> {
    pub(super) family: &'a str,
    /// `p8`, `zeros8`; empty for the dense one.
    pub(super) cut: &'a str,
    pub(super) is_int8: bool,
}

impl<'a> Member<'a> {
    pub(super) fn of(id: &'a str) -> Self {
        let (rest, is_int8) = match id.strip_suffix("-int8") {
            Some(rest) => (rest, true),
            None => (id, false),
        };
        let is_cut = |suffix: &str| {
            ["p", "zeros"].into_iter().any(|what| {
                let count = suffix.strip_prefix(what).unwrap_or_default();
                !count.is_empty() && count.bytes().all(|byte| byte.is_ascii_digit())
            })
        };
        match rest.rsplit_once('-') {
            Some((family, cut)) if is_cut(cut) => Self {
                family,
                cut,
                is_int8,
            },
            _ => Self {
                family: rest,
                cut: "",
                is_int8,
            },
        }
    }

    /// Whether channels were removed or none: what lies on one curve.
    pub(super) fn is_structured(&self) -> bool {
        !self.cut.starts_with("zeros")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member<'a>(family: &'a str, cut: &'a str, is_int8: bool) -> Member<'a> {
        Member {
            family,
            cut,
            is_int8,
        }
    }

    #[test]
    fn ids_say_family_cut_and_precision() {
        for (id, expected) in [
            ("pointpillars", member("pointpillars", "", false)),
            (
                "pointpillars-kitti",
                member("pointpillars-kitti", "", false),
            ),
            (
                "pointpillars-kitti-p8",
                member("pointpillars-kitti", "p8", false),
            ),
            (
                "pointpillars-kitti-p16-int8",
                member("pointpillars-kitti", "p16", true),
            ),
            (
                "pointpillars-kitti-int8",
                member("pointpillars-kitti", "", true),
            ),
            (
                "pointpillars-kitti-zeros8",
                member("pointpillars-kitti", "zeros8", false),
            ),
            ("ufld-resnet18", member("ufld-resnet18", "", false)),
            ("ufld-p", member("ufld-p", "", false)),
        ] {
            assert_eq!(Member::of(id), expected);
        }
    }
}
