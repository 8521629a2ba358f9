//! The classic integrators, beside path tracing: what was drawn before the rendering equation was solved whole.
//!
//! Each leaves out some of its light, and shows so what that is; `docs/light.md` has the same scene under each.

mod ambient;
#[cfg(test)]
mod tests;
mod whitted;

pub use self::{ambient::in_white_sky, whitted::run as run_whitted};
