//! The front door of the library: a scene in, a film out.

use std::{ops::Range, time::Duration};

pub use crate::accel::{AccelKind, Quality};
use crate::{
    film::{ExpressionError, PathLayer, Picture, PictureError, Split},
    flat::FlatScene,
    measure::student::Estimate,
    systems::Systems,
    wavefront,
    world::{Environment, Name, Scene, SceneKey},
};

/// Where numbers in [0, 1) come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SamplerKind {
    /// Owen-scrambled Sobol.
    #[default]
    Sobol,
    /// The same, in an order over the screen that makes the errors of neighbouring pixels differ, so that they look like blue
    /// noise: dithered, and gone at a distance. No pixel's error is smaller for it. Where pixels share what their paths
    /// find, only what the camera sees at once is ordered so. The order depends on the number of samples that is asked for. Not for
    /// pictures of a given error, which are rendered with [`SamplerKind::Sobol`] instead.
    BlueNoise,
    /// Independent hashes.
    Independent,
}

/// Pixel filter, importance-sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PixelFilter {
    /// Blackman–Harris, radius 1.5 pixels.
    #[default]
    BlackmanHarris,
    /// Gaussian, radius 1.5 pixels.
    Gaussian,
    /// The pixel's own square.
    Box,
}

/// Whether neighbouring pixels share the light that their paths find. Their errors are then alike, and smaller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sharing {
    /// Each pixel has its own paths alone.
    Off,
    /// What a look at parts of the picture finds worth its price.
    #[default]
    WherePays,
    /// All that can be shared.
    Always,
}

/// Which light is looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Integrator {
    /// All of it: E + KE + K²E + … (Kajiya 1986).
    #[default]
    Path,
    /// E + KE: what comes straight from lights, with soft shadows.
    Direct,
    /// Mirrors and clear glass, and lamps as points (Whitted 1980): hard shadows, no light from one matt surface to another.
    Whitted,
    /// How open the hemisphere above surfaces is within a distance, m: 1 for all of it, and for the sky itself.
    Ambient {
        /// Beyond it nothing is in the way.
        distance: f32,
    },
}

impl Integrator {
    /// How far scattered rays look, m.
    pub(crate) fn reach(self) -> f32 {
        if let Self::Ambient { distance } = self { distance } else { f32::INFINITY }
    }
}

/// A layer beside the beauty picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerKind {
    /// Albedo at the first hit.
    Albedo,
    /// Shading normal at the first hit, world space.
    Normal,
    /// Distance to the first hit, m.
    Depth,
    /// First hit, world space, m.
    Position,
    /// Texture coordinates at the first hit.
    Uv,
    /// Row of the instance + 1 of the first sample's first hit; 0 for none.
    EntityId,
    /// Row of the material + 1 of the first sample's first hit; 0 for none.
    MaterialId,
    /// Samples taken.
    SampleCount,
    /// Standard error of the beauty picture, nit, from the spread of the replicas: ±4.30 times as much holds what the pixel
    /// would converge to in 95 % of the cases in pictures rendered to an error (Student's factor for two degrees of freedom),
    /// ±3.18 times as much in others, in which it says too much rather than too little. Infinite below four samples.
    Error,
    /// The picture's light in parts that add up to it, each followed by its standard error, `<layer>.error`, as of
    /// [`LayerKind::Error`]. They cost time and memory but change no bit of the picture.
    Light(Split),
}

/// How to make a picture of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Pixels to a row of the whole picture.
    pub width: u32,
    /// Rows of the whole picture.
    pub height: u32,
    /// x, y, width, height of the part to render.
    pub crop: Option<[u32; 4]>,
    /// Samples per pixel after which to stop.
    pub spp: Option<u32>,
    /// Time after which to stop.
    pub time: Option<Duration>,
    /// Square root of the picture's relMSE at which to stop, once it is at most that with a probability of 95 %. Blocks of
    /// pixels then get samples by their error, and `spp` is the mean over the picture.
    pub error: Option<f64>,
    /// First sample and one past the last, in place of `0..spp`; `error` has no effect then.
    pub samples: Option<Range<u32>>,
    /// Greatest number of scatterings; `None` leaves it to Russian roulette.
    pub max_depth: Option<u32>,
    /// Which light is looked for.
    pub integrator: Integrator,
    /// Chooses the random numbers.
    pub seed: u64,
    /// Kind of random numbers.
    pub sampler: SamplerKind,
    /// Pixel filter.
    pub filter: PixelFilter,
    /// Lift the origins of rays towards the smooth surface (Hanika 2021).
    pub terminator_fix: bool,
    /// Whether neighbouring pixels share the light that their paths find.
    pub sharing: Sharing,
    /// Trace light from the emitters through mirrors and clear glass, rather than leave it to paths from the camera to find
    /// an emitter behind them. It changes no expected value; off only to test that, and to measure what it gains.
    pub caustics: bool,
    /// Alpha 0 where the background shows, and no background light there.
    pub transparent: bool,
    /// Layers beside the beauty picture. Those of light by paths are left out with [`Integrator::Whitted`] and
    /// [`Integrator::Ambient`].
    pub layers: Vec<LayerKind>,
    /// The layers of [`Split::Paths`]; before, [`find_lights`] finds the lights that they name.
    pub paths: Vec<PathLayer>,
    /// Paths in a wave.
    pub wave_size: usize,
    /// Order a wave by the shading that its hits need, so that blocks of eight need the same. It changes no bit of a
    /// picture; off only to measure what it gains.
    pub sort: bool,
    /// Edge of a tile, pixels; rounded up to whole blocks of 8.
    pub tile_size: u32,
    /// Worker threads; 0 for one per core.
    pub threads: usize,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            width: 1280,
            height: 720,
            crop: None,
            spp: Some(64),
            time: None,
            error: None,
            samples: None,
            max_depth: None,
            integrator: Integrator::default(),
            seed: 0,
            sampler: SamplerKind::default(),
            filter: PixelFilter::default(),
            terminator_fix: true,
            sharing: Sharing::default(),
            caustics: true,
            transparent: false,
            layers: Vec::new(),
            paths: Vec::new(),
            wave_size: 2048,
            sort: true,
            tile_size: 32,
            threads: 0,
        }
    }
}

impl RenderSettings {
    /// True if blocks of pixels get samples by their error, false if all get as many.
    pub fn is_adaptive(&self) -> bool {
        self.error.is_some() && self.samples.is_none()
    }
}

/// How far a render has come.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// Mean samples per pixel taken so far.
    pub spp: f64,
    /// Share of the work done, 0 to 1.
    pub done: f64,
    /// Rays traced so far.
    pub rays: u64,
    /// Seconds since the start.
    pub seconds: f64,
}

/// Watches a render and may end it; called by one worker at a time, several times a second.
pub trait Observer: Sync {
    /// Told how far it is.
    fn progress(&self, _progress: &Progress) {}
    /// Asked whether to stop; what is there is still returned.
    fn cancelled(&self) -> bool {
        false
    }
}

/// An observer that does nothing.
impl Observer for () {}

/// Rays by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// From the camera.
    pub camera: u64,
    /// After a scattering.
    pub bounce: u64,
    /// Towards lights.
    pub shadow: u64,
}

/// Work of one stage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageStats {
    /// As the stage's file.
    pub name: &'static str,
    /// Summed over workers.
    pub seconds: f64,
    /// Rows that went through.
    pub rows: u64,
    /// Blocks of eight lanes that ran; 0 for stages that take rows one at a time, or a ray by eight boxes.
    pub blocks: u64,
    /// Share of the blocks' lanes that held work; 1 where there are no blocks.
    pub lane_fill: f64,
}

/// The mean of a layer of light.
#[derive(Clone, Debug, PartialEq)]
pub struct PartMean {
    /// Its name.
    pub layer: String,
    /// By channel, nit.
    pub mean: [Estimate; 3],
    /// Luminance, nit.
    pub luminance: Estimate,
}

/// What a render did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RenderStats {
    /// Wall time of the render alone.
    pub seconds: f64,
    /// Mean samples per pixel.
    pub spp: f64,
    /// Paths started.
    pub paths: u64,
    /// Rays by kind.
    pub rays: RayCounts,
    /// By stage, in the order they run; only those that ran.
    pub stages: Vec<StageStats>,
    /// Texture look-ups, alpha tests, environment look-ups and the like, by name; only those that ran.
    pub counters: Vec<(&'static str, u64)>,
    /// Contributions that were not finite, by reason.
    pub discarded: Vec<(&'static str, u64)>,
    /// Of each layer of light in parts, the mean over the picture, nit; empty below four samples per pixel.
    pub parts: Vec<PartMean>,
    /// What the picture's samples say of its error; `None` below four per pixel.
    pub error: Option<PictureError>,
    /// Threads that worked.
    pub threads: usize,
    /// True if it ended because the observer asked.
    pub cancelled: bool,
}

/// A picture and how it was made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rendered {
    /// Resolved pixels and layers; no metadata yet.
    pub picture: Picture,
    /// What was done.
    pub stats: RenderStats,
}

/// What [`Renderer::sync`] rebuilt.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SyncReport {
    /// Systems that had something to do, in the order they ran, with how many rows they rebuilt.
    pub rebuilt: Vec<(&'static str, usize)>,
    /// What was left out of the tables and why: singular transforms, meshes without triangles, …
    pub warnings: Vec<String>,
    /// Wall time of putting meshes into structures for rays; zero if that was not asked for.
    pub build_time: Duration,
}

/// Calls the layers of single lights after their entities in the scene that the picture is of.
///
/// Tables know no names: of an entity with the key 7, [`Renderer::render`] calls a layer `light.7`. After this it is `light.lamp`
/// if the entity has that [`Name`], and `light.lamp#2` if another one before has it too. The sky is called after its entity, or `sky`.
pub fn name_lights(rendered: &mut Rendered, scene: &Scene) {
    let picture = &mut rendered.picture;
    let keys: Vec<String> = {
        let of_light = picture.layers.iter().filter_map(|layer| layer.name.strip_prefix("light."));
        let mut keys: Vec<_> = of_light.map(|rest| rest.split('.').next().unwrap_or(rest).to_owned()).collect();
        keys.sort_unstable_by_key(|key| key.parse().unwrap_or(u64::MAX));
        keys.dedup();
        keys
    };
    let mut names: Vec<(String, String)> = Vec::new();
    for key in keys {
        let entity = match key.parse() {
            Ok(number) => Some(SceneKey(number)),
            Err(_) => scene.keys_with::<Environment>().into_iter().next(),
        };
        let name = entity.and_then(|key| scene.get::<Name>(key)).map(|name| name.0.to_string());
        let name = name.filter(|name| !name.is_empty()).unwrap_or_else(|| key.clone());
        let is_taken = |name: &String| names.iter().any(|(_, other)| other == name);
        let unique = (1..).map(|n| if n == 1 { name.clone() } else { format!("{name}#{n}") }).find(|n| !is_taken(n));
        names.push((key, unique.unwrap_or(name)));
    }
    let layers = picture.layers.iter_mut().map(|layer| &mut layer.name);
    for layer in layers.chain(rendered.stats.parts.iter_mut().map(|part| &mut part.layer)) {
        let Some(rest) = layer.strip_prefix("light.") else { continue };
        let (key, part) = rest.split_once('.').map_or((rest, None), |(key, part)| (key, Some(part)));
        if let Some((_, name)) = names.iter().find(|(of, _)| of == key) {
            *layer = part.map_or_else(|| format!("light.{name}"), |part| format!("light.{name}.{part}"));
        }
    }
}

/// Finds the lights that layers by paths name: entities with that [`Name`]; or with that key, which numbers are; the sky is
/// called `sky` too.
///
/// # Errors
///
/// The first name that no entity has.
pub fn find_lights(settings: &mut RenderSettings, scene: &Scene) -> Result<(), String> {
    let named = scene.keys_with::<Name>();
    let skies = scene.keys_with::<Environment>();
    let find = |name: &str| {
        let has_it = |key: &&SceneKey| scene.get::<Name>(**key).is_some_and(|other| *other.0 == *name);
        let number = name.parse().ok().map(SceneKey).filter(|key| scene.entity(*key).is_some());
        let found = named.iter().filter(has_it).copied().chain(number);
        let keys = found.map(|key| if skies.contains(&key) { u64::MAX } else { key.0 });
        keys.chain((name == "sky" && !skies.is_empty()).then_some(u64::MAX)).collect()
    };
    settings.paths.iter_mut().try_for_each(|path| path.expression.resolve(find))
}

/// Holds the tables of a scene between pictures of it.
#[derive(Default)]
pub struct Renderer {
    /// What meshes are put into for rays. It changes no bit of a picture; a change takes effect with the next sync, and
    /// rebuilds the trees alone.
    pub accel: AccelKind,
    systems: Systems,
    flat: FlatScene,
}

impl Renderer {
    /// A renderer without a scene.
    pub fn new() -> Self {
        Self::default()
    }

    /// Brings the tables up to date with the scene; does only what its changes ask for.
    pub fn sync(&mut self, scene: &mut Scene) -> SyncReport {
        self.systems.sync(scene, &mut self.flat, self.accel)
    }

    /// The tables as of the last sync.
    pub fn scene(&self) -> &FlatScene {
        &self.flat
    }

    /// Bytes that layers of light in parts would take: with many lights and bounces, more than there may be.
    ///
    /// # Errors
    ///
    /// Layers by paths that would need too many states; [`Renderer::render`] leaves all such out then.
    pub fn bytes_of_parts(&self, settings: &RenderSettings) -> Result<u64, ExpressionError> {
        wavefront::bytes_of_parts(&self.flat, settings)
    }

    /// Makes a picture of the tables.
    pub fn render(&self, settings: &RenderSettings, observer: &dyn Observer) -> Rendered {
        wavefront::render(&self.flat, settings, observer)
    }
}
