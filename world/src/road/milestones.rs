use std::ops::Range;

use nalgebra::Vector2;

/// Points that a milestone of the next level stands for, in their middle.
const GROUP: usize = 16;
const LEVELS: usize = 3;

/// Points along a line, to find the nearest of them whatever the length of the line.
///
/// Each level has the middles of groups of the level below. No point is farther from its middle
/// than the line is long between them, so that groups with far middles are left out.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Milestones {
    levels: [Vec<Vector2<f64>>; LEVELS],
    spacing_m: f64,
}

/// The nearest point so far.
struct Nearest {
    index: usize,
    distance_m: f64,
}

impl Milestones {
    /// For `points` along a line, at most `spacing_m` from one to the next.
    pub fn new(points: Vec<Vector2<f64>>, spacing_m: f64) -> Self {
        let mut levels = [const { Vec::new() }; LEVELS];
        levels[0] = points;
        for level in 1..LEVELS {
            let groups = levels[level - 1].chunks(GROUP);
            levels[level] = groups
                .map(|group| group[(group.len() - 1).min(GROUP / 2)])
                .collect();
        }
        Self { levels, spacing_m }
    }

    /// Index of the point nearest to `position`.
    pub fn nearest(&self, position: Vector2<f64>) -> usize {
        let mut nearest = Nearest {
            index: 0,
            distance_m: f64::INFINITY,
        };
        let top = LEVELS - 1;
        self.search(top, 0..self.levels[top].len(), position, &mut nearest);
        nearest.index
    }

    fn search(
        &self,
        level: usize,
        range: Range<usize>,
        position: Vector2<f64>,
        nearest: &mut Nearest,
    ) {
        let points = &self.levels[level];
        let squared = |index: usize| (points[index] - position).norm_squared();
        let mut least = (range.start, f64::INFINITY);
        for index in range.clone() {
            let here = squared(index);
            if here < least.1 {
                least = (index, here);
            }
        }
        let (first, least) = least;
        if level == 0 {
            if least < nearest.distance_m.powi(2) {
                nearest.index = first;
                nearest.distance_m = least.sqrt();
            }
            return;
        }
        self.search(level - 1, self.group(level, first), position, nearest);
        // Half a group of this level, of the next lower one, and so on.
        let reach = (0..level as u32).map(|below| GROUP / 2 * GROUP.pow(below));
        let reach_m = reach.sum::<usize>() as f64 * self.spacing_m;
        for index in range.filter(|index| *index != first) {
            if squared(index) < (nearest.distance_m + reach_m).powi(2) {
                self.search(level - 1, self.group(level, index), position, nearest);
            }
        }
    }

    /// The points of the level below that a middle stands for.
    fn group(&self, level: usize, index: usize) -> Range<usize> {
        let from = index * GROUP;
        from..(from + GROUP).min(self.levels[level - 1].len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_nearest_of_all() {
        for count in [1_usize, 2, 17, 300, 5000] {
            let point = |i: usize| {
                let s = 4.0 * i as f64;
                Vector2::new(300.0 * (s / 400.0).sin(), 0.6 * s)
            };
            let points: Vec<_> = (0..count).map(point).collect();
            let spacing_m = 4.0;
            let milestones = Milestones::new(points.clone(), spacing_m);
            for i in 0..500 {
                let t = f64::from(i);
                let position = Vector2::new(400.0 * (0.7 * t).sin(), 24.0 * t - 100.0);
                let distance_m = |index: usize| (points[index] - position).norm();
                let found = milestones.nearest(position);
                let expected = (0..count).map(distance_m).fold(f64::INFINITY, f64::min);
                assert!((distance_m(found) - expected).abs() < 1e-9, "{count} {i}");
            }
            assert_eq!(milestones.nearest(Vector2::new(f64::NAN, 0.0)), 0);
        }
    }
}
