//! Builders of static bodies.
//!
//! What runs along the road is drawn along it in the world frame; everything else is built in its
//! own frame, its foot on z = 0 and its front along x, and set down with [`Body::at`].

mod along;
mod furniture;
mod houses;
mod people;
mod plants;
mod solids;
mod two_wheelers;

pub use along::{
    Stretch, guard_rail, hedge, jersey_barrier, picket_fence, railed_wall, sidewalk, slab, wall,
    wire_fence,
};
pub use furniture::{bridge, container, dustbin, gantry, hydrant, lamp, pole, sign};
pub use houses::{building, gabled_house, shed};
pub use people::{cyclist, person};
pub use plants::{avenue_tree, bush, tree};
pub use two_wheelers::{bicycle, motorcycle};
