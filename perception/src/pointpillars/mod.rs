//! 3D boxes from the LIDAR's sweep: [`preprocess`] into pillars, [`network`], [`decode`], [`nms`];
//! [`detector`] does it all.

pub mod decode;
pub mod detector;
pub mod network;
pub mod nms;
pub mod preprocess;
