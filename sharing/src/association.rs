use covista_world::Se2Pose;
use nalgebra::{Matrix2, Rotation2, Vector2};

/// chi-squared, two degrees of freedom, 99.7 %.
const GATE: f64 = 11.6;
/// Cost of leaving a detection without a track: more than any pair within the gate.
const UNASSIGNED: f64 = 1e3;
const FORBIDDEN: f64 = 1e6;
/// What a box's centre may be off along and across its heading (partly seen bodies), in metres.
const BOX_SLACK_M: [f64; 2] = [1.0, 0.4];
/// How far two bodies overlap, as a share of their mean length and width, before they are one.
const COINCIDENT_SHARE: [f64; 2] = [0.6, 0.75];

/// A body in the plane: pose of its centre, length and width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Body {
    pub center: Se2Pose,
    pub length_m: f64,
    pub width_m: f64,
}

impl Body {
    /// Whether the two overlap so far that they must be the same body seen twice.
    pub fn coincides(&self, other: &Self) -> bool {
        let offset = self.center.inverse_transform(other.center.position());
        let [along, across] = COINCIDENT_SHARE;
        offset.x.abs() < along * (self.length_m + other.length_m) / 2.0
            && offset.y.abs() < across * (self.width_m + other.width_m) / 2.0
    }
}

/// Where a known object should be at the time of a detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Expectation {
    pub body: Body,
    pub position_covariance: Matrix2<f64>,
}

impl Expectation {
    /// Negative log-likelihood of a detection, where it lies within the gate.
    ///
    /// The gate is the Mahalanobis distance under the prediction's and the detector's covariance,
    /// widened along and across the heading by what a partly seen box may be off.
    fn cost(&self, position: Vector2<f64>, std_m: f64) -> Option<f64> {
        let offset = position - self.body.center.position();
        let [along, across] = BOX_SLACK_M.map(|m| m * m);
        // No eigenvalue of the covariance is larger than its trace.
        let most = self.position_covariance.trace() + 2.0 * std_m.powi(2) + along + across;
        if offset.norm_squared() > 1.01 * GATE * most {
            return None;
        }
        let rotation = Rotation2::new(self.body.center.yaw_rad);
        let slack = Matrix2::from_diagonal(&Vector2::new(along, across));
        let covariance = self.position_covariance
            + Matrix2::identity() * std_m.powi(2)
            + rotation.matrix() * slack * rotation.matrix().transpose();
        let distance2 = offset.dot(&(covariance.try_inverse()? * offset));
        (distance2 < GATE).then(|| distance2 + covariance.determinant().ln())
    }
}

/// For each detection (position, standard deviation) the index of the object that it shows.
pub(crate) fn associate(
    detections: &[(Vector2<f64>, f64)],
    objects: &[Expectation],
) -> Vec<Option<usize>> {
    let columns = objects.len() + detections.len();
    let costs: Vec<Vec<f64>> = detections
        .iter()
        .map(|&(position, std_m)| {
            let mut row = vec![UNASSIGNED; columns];
            for (cost, object) in row.iter_mut().zip(objects) {
                *cost = object.cost(position, std_m).unwrap_or(FORBIDDEN);
            }
            row
        })
        .collect();
    hungarian(&costs)
        .into_iter()
        .map(|column| (column < objects.len()).then_some(column))
        .collect()
}

/// The column of each row in the assignment of least total cost (Kuhn-Munkres with potentials,
/// O(rows^2 columns)); there must be at least as many columns as rows.
fn hungarian(costs: &[Vec<f64>]) -> Vec<usize> {
    let rows = costs.len();
    let columns = costs.first().map_or(0, Vec::len);
    let mut row_potential = vec![0.0; rows + 1];
    let mut column_potential = vec![0.0; columns + 1];
    // Row of each column, from 1; 0 is free. Column 0 holds the row that looks for a place.
    let mut row_of = vec![0; columns + 1];
    for row in 1..=rows {
        row_of[0] = row;
        let mut least = vec![f64::INFINITY; columns + 1];
        let mut previous = vec![0; columns + 1];
        let mut visited = vec![false; columns + 1];
        let mut column = 0;
        while row_of[column] != 0 {
            visited[column] = true;
            let (from, mut next, mut delta) = (row_of[column], 0, f64::INFINITY);
            for j in (1..=columns).filter(|&j| !visited[j]) {
                let reduced = costs[from - 1][j - 1] - row_potential[from] - column_potential[j];
                if reduced < least[j] {
                    (least[j], previous[j]) = (reduced, column);
                }
                if least[j] < delta {
                    (delta, next) = (least[j], j);
                }
            }
            for j in 0..=columns {
                if visited[j] {
                    row_potential[row_of[j]] += delta;
                    column_potential[j] -= delta;
                } else {
                    least[j] -= delta;
                }
            }
            column = next;
        }
        while column != 0 {
            row_of[column] = row_of[previous[column]];
            column = previous[column];
        }
    }
    let mut column_of = vec![usize::MAX; rows];
    for (column, &row) in row_of.iter().enumerate().skip(1) {
        if row > 0 {
            column_of[row - 1] = column - 1;
        }
    }
    column_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cheapest(costs: &[Vec<f64>], row: usize, taken: u32) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        (0..costs[row].len())
            .filter(|j| taken & (1 << j) == 0)
            .map(|j| costs[row][j] + cheapest(costs, row + 1, taken | (1 << j)))
            .fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #[test]
        fn the_assignment_is_optimal(
            costs in (1..5_usize).prop_flat_map(|rows| {
                prop::collection::vec(prop::collection::vec(-5.0..20.0_f64, rows + 1), rows)
            })
        ) {
            let columns = hungarian(&costs);
            let total: f64 = columns.iter().zip(&costs).map(|(&j, row)| row[j]).sum();
            prop_assert!((total - cheapest(&costs, 0, 0)).abs() < 1e-9);
        }
    }

    fn expected(x_m: f64, y_m: f64) -> Expectation {
        Expectation {
            body: Body {
                center: Se2Pose::new(x_m, y_m, 0.0),
                length_m: 4.6,
                width_m: 1.9,
            },
            position_covariance: Matrix2::identity() * 0.1,
        }
    }

    #[test]
    fn the_whole_is_assigned_not_the_nearest_first() {
        // Greedy would give detection 0 the nearer object 1 and leave detection 1 alone.
        let detections = [(Vector2::new(1.1, 0.0), 0.3), (Vector2::new(4.5, 0.0), 0.3)];
        let objects = [expected(-1.0, 0.0), expected(2.0, 0.0)];
        assert_eq!(associate(&detections, &objects), [Some(0), Some(1)]);
    }

    #[test]
    fn a_lane_width_is_outside_the_gate() {
        let detections = [(Vector2::new(0.0, 3.0), 0.3)];
        assert_eq!(associate(&detections, &[expected(0.0, 0.0)]), [None]);
        assert_eq!(associate(&detections, &[]), [None]);
        assert!(associate(&[], &[expected(0.0, 0.0)]).is_empty());
    }
}
