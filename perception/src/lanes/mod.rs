//! Lane marks from the camera's image: [`preprocess`], [`network`], [`decode`], [`ground`]; from
//! photographs of other cameras by way of [`view`]. [`finder`] goes from image to marks.

pub mod decode;
pub mod finder;
pub mod ground;
pub mod network;
pub mod preprocess;
pub mod view;
