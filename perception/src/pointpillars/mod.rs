//! 3D boxes from the LIDAR's sweep: [`preprocess`] into pillars, [`network`], [`decode`], [`nms`].

pub mod decode;
pub mod network;
pub mod nms;
pub mod preprocess;
