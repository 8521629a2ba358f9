//! wavecast: a data-oriented wavefront path tracer for glTF 2.0 scenes, in physical units, on the CPU.
//!
//! # The flow
//!
//! ```text
//!  .gltf/.glb ──load──▶ Scene ──systems──▶ FlatScene ──wavefront──▶ Film ──▶ Picture ──▶ .exr .png .hdr
//!                         ▲                    │
//!           library ──edits                    └─ accel, bsdf, light, sampling  (what the stages call)
//!
//!  per worker, per tile, per pass of samples:
//!    generate ─▶ PathQueue ─▶ intersect ─▶ HitQueue ─▶ sort ─▶ shade ─┬▶ ShadowQueue ─▶ connect ─▶ tile sums
//!                   ▲                                                 │
//!                   └───────────────────── bounce ◀───────────────────┘
//! ```
//!
//! Between `sort` and `shade` run the stages that not every scene needs: `absorb` (light fades inside
//! solids), `layers` (albedo, normals and the like), `sky` and `emit` (light that paths arrive at, added
//! to the tile's sums). Where emitters light something by mirrors or clear glass, light paths start at these and are seen by
//! the camera; what they bring is added up apart, since it falls on any pixel. One turn of the loop is one application of the light-transport operator.
//!
//! # The tree
//!
//! [`render`] is the front door: a [`Renderer`](render::Renderer) turns a scene into tables and tables
//! into a picture. Six folders are the flow, in order; the rest is what they call.
//!
//! | module | | in → out |
//! |---|---|---|
//! | [`load`] | 1 | glTF file → `Scene`, with warnings for what had to be left out |
//! | [`world`] | 2 | edits → entities with components: geometry, material, emitters, camera |
//! | [`systems`] | 3 | changes of the world → tables, rebuilding only what depends on them |
//! | [`flat`] | 4 | the tables: the scene as rays see it |
//! | [`wavefront`] | 5 | tables and settings → sums of light; one file per stage |
//! | [`film`] | 6 | sums → pixels → files |
//! | [`accel`] | | rays → hits: a tree or another structure per mesh, under a tree over instances |
//! | [`bsdf`] | | directions at a surface → how much is scattered, and samples of it |
//! | [`light`] | | a point → a light that may shine there, and where on it; the sky |
//! | [`sampling`] | | (pixel, sample, dimension, seed) → numbers, directions, choices |
//! | [`simd`] | | eight lanes, or one, of the arithmetic that kernels are written in |
//! | [`reference`](mod@reference) | | tables → picture by recursion in f64, and light as a matrix equation, to compare with |
//! | [`measure`] | | a scene → what light meters read; two pictures → how far they are apart; statistics |
//!
//! What a picture means, to the last convention, is `docs/model.md`; `wavefront` and `reference` both
//! implement that page and share no code. The program around the library is `src/main.rs` and `src/cli`.
//!
//! # Invariants
//!
//! Each has a test under `tests/`, named in brackets.
//!
//! 1. hecs is known to `load`, `world` and `systems` alone; everyone else sees `Scene` or `FlatScene` (layering).
//! 2. A `FlatScene` does not change while it is rendered; workers share `&FlatScene` (the borrow checker).
//! 3. A stage is a free function over queues. No stage calls another; `wavefront/mod.rs` alone knows the order (layering).
//! 4. `flat`, `accel`, `bsdf`, `light`, `sampling` and the stages do no I/O and cannot fail (layering).
//! 5. Scene, settings, seed and the recorded sample counts decide every bit of the pixels, whatever the number of
//!    threads, the size of tiles or of queues (determinism).
//! 6. A SIMD kernel and its scalar twin are one function, generic over [`simd::Real`]; tests beside the
//!    kernels compare the two.
//! 7. If nothing changed, a sync does nothing; if one thing changed, only what depends on it is rebuilt.
//!    Either way the picture is that of a fresh load (sync).
//! 8. Each field of a table or queue is declared once, by the macro in [`flat::soa`].
//! 9. What a scene does not need costs it nothing: [`SceneNeeds`](flat::SceneNeeds) decides which stages
//!    run, and counters prove it (skipping).
//! 10. No `unsafe` code but a prefetch and, in a benchmark of the program that few build, the functions of a foreign
//!     library (layering, and the compiler).
//!
//! # Units
//!
//! Metres, and light as linear Rec.709 RGB in photometric units: radiance in nit (cd/m²), intensity in
//! cd, illuminance in lx. These are glTF's, so nothing is converted on loading; watts and lumens enter
//! through [`world::units`] alone. A [`Picture`](film::Picture) holds nit, unexposed; exposure and tone
//! mapping happen when a PNG is written and nowhere else. Space is right-handed with +Y up; cameras and
//! lights look along their −Z.
//!
//! # Example
//!
//! A scene without any file: a floor, what it is made of, and a lamp are entities of a hecs world.
//! A floor of albedo ρ, `d` metres below a lamp of `I` candela, has the luminance `ρ/π · I/d²`.
//!
//! ```
//! use std::{f32::consts::PI, sync::Arc};
//! use wavecast::glam::{DVec3, Vec3};
//! use wavecast::render::{RenderSettings, Renderer};
//! use wavecast::world::{
//!     Camera, Geometry, LocalTransform, Material, MaterialSlots, PointLight, Scene, TriMesh, units::Candela,
//! };
//!
//! let mut scene = Scene::new();
//! let paint = scene.spawn((Material::lambert(Vec3::new(0.8, 0.5, 0.2)),));
//! let floor = TriMesh::quad(Vec3::new(-2.0, 0.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0);
//! scene.spawn((Geometry(Arc::new(floor)), MaterialSlots::from(paint)));
//! scene.spawn((
//!     Camera::perspective(0.1),
//!     LocalTransform::looking_at(DVec3::Y * 5.0, DVec3::ZERO, DVec3::NEG_Z),
//! ));
//! // `Scene::spawn` gives a key that lasts; the hecs world behind it can be used as well.
//! let lamp = scene.world_mut().spawn((
//!     PointLight { color: Vec3::ONE, intensity: Candela(100.0) },
//!     LocalTransform::from_translation(DVec3::Y * 2.0),
//! ));
//!
//! let settings = RenderSettings { width: 15, height: 15, spp: Some(16), ..RenderSettings::default() };
//! let mut renderer = Renderer::new();
//! renderer.sync(&mut scene);
//! let picture = renderer.render(&settings, &()).picture;
//! let [red, green, blue] = picture.rgb[7 * 15 + 7];
//! let illuminance = 100.0 / (2.0 * 2.0);
//! for (luminance, albedo) in [(red, 0.8), (green, 0.5), (blue, 0.2)] {
//!     let expected = albedo / PI * illuminance;
//!     assert!((luminance / expected - 1.0).abs() < 1e-3, "{luminance} nit, expected {expected}");
//! }
//!
//! // An edit, and only what depends on it is made anew.
//! scene.world_mut().get::<&mut PointLight>(lamp).unwrap().intensity = Candela(50.0);
//! let report = renderer.sync(&mut scene);
//! assert_eq!(report.rebuilt, [("lights", 1)]);
//! let dimmed = renderer.render(&settings, &()).picture.rgb[7 * 15 + 7];
//! assert!((dimmed[0] / red - 0.5).abs() < 1e-3);
//! ```
//!
//! [`film::write`] makes a file of a picture, [`load::load`] a scene of a file.
//!
//! # What differs from the architecture as first drawn
//!
//! - `load` reads glTF with its own checked code; the `gltf` crate lends constants, and tests compare the two.
//! - The eight-wide trees are collapsed from binary trees that obvhs builds; the top level is always one.
//! - What a light brings to a surface is computed by kernels of the wavefront (`direct`, `emit`), because they read its
//!   queues; [`light`] chooses one, and has what it takes to draw a place on it.
//! - Light trees have eight children to a node, and no splitting. Quads are drawn from as two spherical triangles with no
//!   seam, which serves any parallelogram, in place of a spherical rectangle.
//! - A wave is topped up with camera rays as its paths end, so that blocks stay full. Sums are exact,
//!   so that changes no bit.
//! - Scenes that need them have four stages more than the drawing: those listed above.
//! - Surfaces given by a formula, [`world::Shape`], are built in code alone: glTF has no ratified extension for them.
//!   Those that emit are sampled by area.
//! - There are no scalar copies of kernels: a kernel is generic over one lane or eight.
//! - That stages do not allocate once warm holds by design; no test counts allocations yet.
//! - Edits are made to the world directly; an `Edit` type, scripts, animation and checkpoints are not there yet.
//! - Layers by number of bounces or by light are not there yet; the sums are made for them.

#![warn(missing_docs)]

// In the order of the flow. Blank lines keep it: the formatter sorts neighbours.
pub mod render;

pub mod load;

pub mod world;

pub mod systems;

pub mod flat;

pub mod wavefront;

pub mod film;

// What the flow calls.
pub mod accel;

pub mod bsdf;

pub mod light;

pub mod sampling;

pub mod simd;

// What the flow is held against.
pub mod reference;

pub mod measure;

// Their types are part of the interface.
pub use {glam, hecs};

/// The README's example, compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
