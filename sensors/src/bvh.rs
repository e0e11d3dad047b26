//! A bounding-volume hierarchy of four children a node, side by side for the vector units.

use nalgebra::{Point3, Vector3};

const WIDTH: usize = 4;
/// Children left to visit at once: three a level, and 4^20 parts.
const STACK: usize = 64;
/// Marks a child as a leaf.
const LEAF: u32 = 1 << 31;

/// An axis-aligned box: its least and its greatest corner.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) low: Vector3<f32>,
    pub(crate) high: Vector3<f32>,
}

/// The bounds of four children: per axis their least and their greatest coordinates.
pub(crate) type Boxes = [[[f32; WIDTH]; 2]; 3];

/// A value for each of four children.
pub(crate) type Lanes = [f32; WIDTH];

#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) boxes: Boxes,
    children: [u32; WIDTH],
    count: usize,
}

pub(crate) enum Child {
    Node(u32),
    Leaf(u32),
}

/// The hierarchy; its leaves are indices of the bounds that it was built from.
#[derive(Debug, Clone, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
}

/// A ray as the slabs of a box see it.
struct Slabs {
    origin: Point3<f32>,
    inverse: Vector3<f32>,
    /// Which of an axis' two planes is met first.
    first: [usize; 3],
}

impl Bounds {
    fn doubled_center(&self) -> Vector3<f32> {
        self.low + self.high
    }

    fn union(&self, other: &Self) -> Self {
        Self {
            low: self.low.inf(&other.low),
            high: self.high.sup(&other.high),
        }
    }
}

impl Node {
    /// The node's children, each with its slot.
    pub(crate) fn children(&self) -> impl Iterator<Item = (usize, Child)> {
        let children = self.children.iter().take(self.count).enumerate();
        children.map(|(slot, &child)| {
            let index = child & !LEAF;
            (
                slot,
                if child == index {
                    Child::Node(index)
                } else {
                    Child::Leaf(index)
                },
            )
        })
    }
}

impl Bvh {
    /// Memory of its nodes in bytes.
    pub(crate) fn memory_bytes(&self) -> usize {
        size_of_val(&*self.nodes)
    }

    pub(crate) fn new(bounds: &[Bounds]) -> Self {
        let mut leaves: Vec<u32> = (0..bounds.len() as u32).collect();
        let mut bvh = Self {
            nodes: Vec::with_capacity(bounds.len() / 2 + 1),
        };
        if !leaves.is_empty() {
            bvh.add(bounds, &mut leaves);
        }
        bvh
    }

    pub(crate) fn root(&self) -> Option<u32> {
        (!self.nodes.is_empty()).then_some(0)
    }

    pub(crate) fn node(&self, index: u32) -> &Node {
        &self.nodes[index as usize]
    }

    /// Adds the node of some leaves: halved at the median of their longest axis, and again.
    fn add(&mut self, bounds: &[Bounds], leaves: &mut [u32]) -> u32 {
        let index = self.nodes.len();
        self.nodes.push(Node {
            boxes: [[[0.0; WIDTH]; 2]; 3],
            children: [0; WIDTH],
            count: 0,
        });
        let (left, right) = halve(bounds, leaves);
        let (quarters, more) = (halve(bounds, left), halve(bounds, right));
        let quarters = [quarters.0, quarters.1, more.0, more.1];
        for quarter in quarters.into_iter().filter(|quarter| !quarter.is_empty()) {
            let child = match quarter {
                &mut [leaf] => leaf | LEAF,
                _ => self.add(bounds, quarter),
            };
            let of = |&leaf: &u32| bounds[leaf as usize];
            let node = &mut self.nodes[index];
            if let Some(all) = quarter.iter().map(of).reduce(|a, b| a.union(&b)) {
                for axis in 0..3 {
                    node.boxes[axis][0][node.count] = all.low[axis];
                    node.boxes[axis][1][node.count] = all.high[axis];
                }
                node.children[node.count] = child;
                node.count += 1;
            }
        }
        index as u32
    }

    /// Calls `visit` with the leaves that the ray meets within its reach, about the nearest first;
    /// `visit` answers with the reach from then on.
    pub(crate) fn along_ray(
        &self,
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
        mut reach_m: f32,
        mut visit: impl FnMut(u32) -> f32,
    ) {
        let slabs = Slabs::new(origin, direction);
        let mut stack = [(0_u32, 0.0_f32); STACK];
        let mut height = usize::from(!self.nodes.is_empty());
        while height > 0 {
            height -= 1;
            let (child, near_m) = stack[height];
            if near_m > reach_m {
                continue;
            }
            if child & LEAF != 0 {
                reach_m = visit(child & !LEAF);
                continue;
            }
            let node = self.node(child);
            let (near_m, far_m) = slabs.crossings(&node.boxes);
            let bottom = height;
            for slot in 0..node.count {
                if near_m[slot] <= far_m[slot].min(reach_m) {
                    // The nearest goes on top.
                    let mut place = height;
                    while place > bottom && stack[place - 1].1 < near_m[slot] {
                        stack[place] = stack[place - 1];
                        place -= 1;
                    }
                    stack[place] = (node.children[slot], near_m[slot]);
                    height += 1;
                }
            }
        }
    }
}

/// Splits leaves at the median of their centers along the longest axis.
fn halve<'a>(bounds: &[Bounds], leaves: &'a mut [u32]) -> (&'a mut [u32], &'a mut [u32]) {
    let middle = leaves.len() / 2;
    if leaves.len() > 2 {
        let center = |leaf: u32| bounds[leaf as usize].doubled_center();
        let (low, high) = leaves.iter().fold(
            (Vector3::repeat(f32::MAX), Vector3::repeat(f32::MIN)),
            |(low, high), &leaf| (low.inf(&center(leaf)), high.sup(&center(leaf))),
        );
        let axis = (high - low).imax();
        leaves.select_nth_unstable_by(middle, |&a, &b| {
            center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(&b))
        });
    }
    leaves.split_at_mut(middle)
}

impl Slabs {
    fn new(origin: &Point3<f32>, direction: &Vector3<f32>) -> Self {
        // No slab's crossing may be 0 / 0.
        let inverse = direction.map(|way| if way.abs() > 1e-30 { way.recip() } else { 1e30 });
        Self {
            origin: *origin,
            inverse,
            first: [0, 1, 2].map(|axis| usize::from(inverse[axis] < 0.0)),
        }
    }

    /// Where the ray enters and leaves each of four boxes.
    fn crossings(&self, boxes: &Boxes) -> (Lanes, Lanes) {
        let (mut near_m, mut far_m) = ([0.0; WIDTH], [f32::MAX; WIDTH]);
        for (axis, planes) in boxes.iter().enumerate() {
            let (origin_m, inverse) = (self.origin[axis], self.inverse[axis]);
            let first = self.first[axis];
            let (entries, exits) = (&planes[first], &planes[1 - first]);
            for lane in 0..WIDTH {
                let entry_m = (entries[lane] - origin_m) * inverse;
                let exit_m = (exits[lane] - origin_m) * inverse;
                near_m[lane] = if entry_m > near_m[lane] {
                    entry_m
                } else {
                    near_m[lane]
                };
                far_m[lane] = if exit_m < far_m[lane] {
                    exit_m
                } else {
                    far_m[lane]
                };
            }
        }
        (near_m, far_m)
    }
}
