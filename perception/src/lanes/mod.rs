//! Lane marks from the camera's image: [`preprocess`], [`network`], [`decode`], [`ground`].

pub mod decode;
pub mod ground;
pub mod network;
pub mod preprocess;
