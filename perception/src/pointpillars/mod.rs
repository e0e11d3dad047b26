//! 3D boxes from the LIDAR's sweep: [`preprocess`] into pillars, [`features`] onto a canvas,
//! [`network`], [`decode`], [`nms`]; [`detector`] does it all.

pub mod decode;
pub mod detector;
pub mod features;
pub mod network;
pub mod nms;
pub mod preprocess;
