//! Lane marks from the camera's image: [`preprocess`], [`network`], [`decode`], [`ground`]; from
//! photographs of other cameras by way of [`view`].

pub mod decode;
pub mod ground;
pub mod network;
pub mod preprocess;
pub mod view;
