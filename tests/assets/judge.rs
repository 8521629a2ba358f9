//! Looks at small parts of a model, straight from the front, and compares them.

use glam::{DVec3, Vec3};
use wavecast::{
    film::LayerData,
    load::{LoadOptions, load},
    render::{LayerKind, RenderSettings, Renderer},
    world::{Camera, DirectionalLight, Environment, LocalTransform, Projection, Scene, SceneKey, units::Lux},
};

use crate::common::{asset, settings};

/// Pixels along a side of a patch.
pub const SIDE: u32 = 24;

/// A model under an even sky and a lamp from the upper right of the front.
pub struct Model {
    pub scene: Scene,
    renderer: Renderer,
    camera: SceneKey,
}

/// A square part of a picture, rows from the top.
pub struct Patch(pub Vec<[f32; 3]>);

impl Model {
    /// `None`, said aloud, if the file is not there.
    pub fn open(path: &str) -> Option<Self> {
        let path = asset(path)?;
        let mut scene = load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}")).scene;
        scene.spawn((Environment::constant(Vec3::splat(1.0)),));
        let lamp = LocalTransform::looking_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y);
        scene.spawn((DirectionalLight { color: Vec3::ONE, illuminance: Lux(2.0) }, lamp));
        let camera = scene.spawn((Camera::perspective(1.0), LocalTransform::IDENTITY));
        scene.active_camera = Some(camera);
        Some(Self { scene, renderer: Renderer::new(), camera })
    }

    /// Points the camera at the square of half width `half` around `center`, from +Z.
    fn look(&mut self, [x, y]: [f64; 2], half: f32, settings: &RenderSettings) -> wavecast::render::Rendered {
        let projection = Projection::Orthographic { xmag: half, ymag: half };
        self.scene.insert(self.camera, Camera { projection, znear: 0.0, zfar: f32::INFINITY });
        self.scene.insert(self.camera, LocalTransform::from_translation(DVec3::new(x, y, 50.0)));
        assert!(self.renderer.sync(&mut self.scene).warnings.is_empty());
        let rendered = self.renderer.render(settings, &());
        assert_eq!(rendered.stats.discarded, []);
        rendered
    }

    /// Light, nit.
    pub fn light(&mut self, center: [f64; 2], half: f32, spp: u32) -> Patch {
        Patch(self.look(center, half, &settings(SIDE, spp)).picture.rgb)
    }

    /// Albedo or normals.
    pub fn layer(&mut self, kind: LayerKind, center: [f64; 2], half: f32) -> Patch {
        let settings = RenderSettings { layers: vec![kind], max_depth: Some(0), ..settings(SIDE, 16) };
        match self.look(center, half, &settings).picture.layers.remove(0).data {
            LayerData::Rgb(values) | LayerData::Xyz(values) => Patch(values),
            other => panic!("{other:?}"),
        }
    }

    /// Albedo.
    pub fn albedo(&mut self, center: [f64; 2], half: f32) -> Patch {
        self.layer(LayerKind::Albedo, center, half)
    }

    /// Which entity the first ray of each pixel met.
    pub fn entities(&mut self, center: [f64; 2], half: f32) -> Vec<u32> {
        let layers = vec![LayerKind::EntityId];
        let settings = RenderSettings { layers, max_depth: Some(0), ..settings(SIDE, 1) };
        match self.look(center, half, &settings).picture.layers.remove(0).data {
            LayerData::Id(ids) => ids,
            other => panic!("{other:?}"),
        }
    }
}

impl Patch {
    /// Mean of all pixels.
    pub fn mean(&self) -> [f32; 3] {
        self.mean_where(|_, _| true)
    }

    /// Mean of the pixels chosen by column and row.
    pub fn mean_where(&self, chosen: impl Fn(u32, u32) -> bool) -> [f32; 3] {
        let mut sum = [0.0; 3];
        let mut count = 0.0;
        for (i, pixel) in (0..).zip(&self.0) {
            if chosen(i % SIDE, i / SIDE) {
                (0..3).for_each(|c| sum[c] += pixel[c]);
                count += 1.0;
            }
        }
        sum.map(|x| x / count)
    }

    /// Mean difference of pixels, over channels.
    pub fn difference(&self, other: &Self) -> f32 {
        let differences = self.0.as_flattened().iter().zip(other.0.as_flattened()).map(|(a, b)| (a - b).abs());
        differences.sum::<f32>() / (3 * self.0.len()) as f32
    }

    /// Mean difference of pixels from their mean: says that there is something to see.
    pub fn contrast(&self) -> f32 {
        let mean = self.mean();
        self.difference(&Self(vec![mean; self.0.len()]))
    }
}
