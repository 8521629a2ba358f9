//! Which light, and where on it: what shines, as a surface looks for it.
//!
//! In flow lights as [`Emitter`]s and the map of an [`Environment`](crate::world::Environment); out flow a light chosen by what it
//! could bring to a [`Receiver`], points on it, and directions by radiance; each with the probability or density that the
//! other way of finding the same light is weighed by.

mod choice;
mod environment;
mod facets;
mod receiver;
mod shape;
mod tree;

pub use choice::LightChoice;
pub use environment::EnvironmentTable;
use environment::turns;
pub use facets::{Facets, Seen};
pub use receiver::{Receiver, Receivers, pack};
pub use shape::Density;
pub use tree::{Choices, Chosen, Emitter, LightTree};

/// Random numbers for tests.
#[cfg(test)]
fn numbers(stream: u32) -> impl FnMut() -> f64 {
    let mut pairs = crate::sampling::tests::numbers(stream, u32::MAX);
    move || f64::from(pairs.next().expect("more than any test draws").0)
}

/// A normal and side for tests.
#[cfg(test)]
fn packed(n: [f32; 3], halved: bool) -> u32 {
    pack(crate::simd::V3::<f32>::from_array(n), halved).0
}
