//! The scene that a subcommand is about, and the eye: shared by all that make pictures or measure.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
    time::{Duration, Instant},
};

use wavecast::{
    flat::{CameraView, FlatScene},
    glam::DVec3,
    load::{self, CameraInfo, LoadOptions},
    render::Renderer,
    world::{Camera, Environment, LocalTransform, Name, Scene, SceneKey, Sky},
};

use super::{
    args::{self, EnvArg},
    console::Console,
    error::CliError,
    structure::AccelArgs,
};

/// Width of a picture of which only the shape is known.
pub const DEFAULT_WIDTH: u32 = 1280;
/// Shape of a picture where neither the user nor the camera says.
const DEFAULT_ASPECT: f32 = 16.0 / 9.0;

/// Vertical field of view from a place that was given, rad.
const VIEW: f32 = 1.0;

/// From where to look, where the camera of the scene is not wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    eye: DVec3,
    target: DVec3,
}

impl View {
    /// Puts a camera there, and makes it the scene's.
    pub fn take(self, scene: &mut Scene) {
        let pose = LocalTransform::looking_at(self.eye, self.target, DVec3::Y);
        scene.active_camera = Some(scene.spawn((Camera::perspective(VIEW), pose)));
    }
}

/// Six numbers: the eye and a point that it looks at, m.
pub fn view(text: &str) -> Result<View, String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(args::finite).collect();
    let point = |p: &[f32]| DVec3::new(p[0].into(), p[1].into(), p[2].into());
    match numbers.as_deref() {
        Ok(all @ [_, _, _, _, _, _]) if all[..3] != all[3..] => {
            Ok(View { eye: point(&all[..3]), target: point(&all[3..]) })
        }
        _ => Err("expected two points, such as 0,1,0,1,1,0: the eye and what it looks at".into()),
    }
}

/// Which scene, and by what light and with what eyes it is seen.
#[derive(clap::Args, Clone, Debug)]
pub struct SceneArgs {
    /// The scene, .gltf or .glb
    #[arg(value_name = "SCENE")]
    pub file: PathBuf,
    /// Camera by name or index [default: the first one; none: one that frames the scene]
    #[arg(long, value_name = "NAME|INDEX")]
    pub camera: Option<String>,
    /// Look from one point to another, in metres, instead
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = view, allow_hyphen_values = true, conflicts_with = "camera")]
    pub view: Option<View>,
    /// Scene by name or index [default: the file's]
    #[arg(id = "scene", long = "scene", value_name = "NAME|INDEX")]
    pub name: Option<String>,
    /// Environment: a lat-long picture in nit, or R,G,B in nit
    #[arg(long, value_name = "FILE|R,G,B", value_parser = args::env)]
    pub env: Option<EnvArg>,
    /// Turn the environment about +Y, counter-clockwise seen from above
    #[arg(long, value_name = "DEGREES", value_parser = args::finite, allow_hyphen_values = true, requires = "env")]
    pub env_rotate: Option<f32>,
    /// Multiply the environment's light
    #[arg(long, value_name = "X", value_parser = args::not_negative, requires = "env")]
    pub env_scale: Option<f32>,
    #[command(flatten)]
    pub accel: AccelArgs,
}

/// A scene with its tables.
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    /// In step with it.
    pub renderer: Renderer,
    /// Time that reading the file took.
    pub load_time: Duration,
    /// Time that making the tables took.
    pub sync_time: Duration,
    /// Of that, time that the structures for rays took.
    pub build_time: Duration,
}

impl SceneArgs {
    /// Reads the scene and makes its tables; says what had to be left out.
    pub fn open(&self, console: &mut Console) -> Result<Opened, CliError> {
        let start = Instant::now();
        let accel = self.accel.kind()?;
        let options = LoadOptions { scene: self.name.as_deref().map(Into::into) };
        let mut loaded = load::load(&self.file, &options)?;
        loaded.warnings.iter().for_each(|warning| console.warn(warning));
        let mut scene = loaded.scene;
        if let Some(env) = &self.env {
            let (rotation, scale) = (self.env_rotate.unwrap_or(0.0), self.env_scale.unwrap_or(1.0));
            set_environment(&mut scene, env, rotation, scale, console)?;
        }
        match self.view {
            Some(view) => view.take(&mut scene),
            None => self.choose_camera(&mut scene, &std::mem::take(&mut loaded.info.cameras), console)?,
        }
        let load_time = start.elapsed();
        let mut renderer = Renderer::new();
        renderer.accel = accel;
        let report = renderer.sync(&mut scene);
        report.warnings.iter().for_each(|warning| console.warn(warning));
        if renderer.scene().lights.default_sky {
            console.warn("no light in the scene: using a uniform environment of 1 nit");
        }
        let sync_time = start.elapsed() - load_time;
        Ok(Opened { scene, renderer, load_time, sync_time, build_time: report.build_time })
    }

    /// The scene anew, without another word about it.
    pub fn open_silently(&self) -> Result<(Scene, Renderer), CliError> {
        let options = LoadOptions { scene: self.name.as_deref().map(Into::into) };
        let mut scene = load::load(&self.file, &options)?.scene;
        let mut renderer = Renderer::new();
        renderer.accel = self.accel.kind()?;
        renderer.sync(&mut scene);
        Ok((scene, renderer))
    }

    /// The scene anew, but with nothing else than an entity and what hangs below it.
    pub fn alone(&self, key: SceneKey) -> Result<(Scene, Renderer), CliError> {
        let (mut scene, mut renderer) = self.open_silently()?;
        scene.keep_only(key);
        renderer.sync(&mut scene);
        Ok((scene, renderer))
    }

    /// What of it decides the pixels, as text for files.
    pub fn metadata(&self) -> Vec<(String, String)> {
        let name = |path: &Path| path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let mut pairs = vec![("scene".to_owned(), name(&self.file))];
        let mut add = |key: &str, value: Option<String>| pairs.extend(value.map(|value| (key.to_owned(), value)));
        add("scene-name", self.name.clone());
        add("camera", self.camera.clone());
        add("view", self.view.map(|View { eye, target }| format!("{eye} {target}")));
        add(
            "env",
            self.env.as_ref().map(|env| match env {
                EnvArg::Constant([r, g, b]) => format!("{r},{g},{b}"),
                EnvArg::File(path) => name(path),
            }),
        );
        add("env-rotate", self.env_rotate.map(|degrees| degrees.to_string()));
        add("env-scale", self.env_scale.map(|scale| scale.to_string()));
        pairs
    }

    /// Finds the camera by the name of its node, else by its own, else by its place among the scene's.
    fn choose_camera(&self, scene: &mut Scene, in_file: &[CameraInfo], console: &Console) -> Result<(), CliError> {
        let cameras = scene.keys_with::<Camera>();
        let Some(wanted) = &self.camera else {
            if cameras.is_empty() {
                console.note("no camera in the scene: using one that frames it");
            }
            return Ok(());
        };
        let node = |key: &SceneKey| scene.get::<Name>(*key).is_some_and(|name| *name.0 == **wanted);
        let own = |key: &SceneKey| in_file.iter().any(|camera| camera.name == *wanted && camera.keys.contains(key));
        let index = wanted.parse().ok().and_then(|index: usize| cameras.get(index));
        let found = cameras.iter().find(|key| node(key)).or_else(|| cameras.iter().find(|key| own(key))).or(index);
        if found.is_none() {
            let names = camera_names(scene, in_file);
            let list: Vec<_> = names.iter().enumerate().map(|(i, name)| format!("{i} {name:?}")).collect();
            let available = if list.is_empty() { "none in the scene".into() } else { list.join(", ") };
            return Err(CliError::NoCamera { scene: self.file.clone(), wanted: wanted.clone(), available });
        }
        scene.active_camera = found.copied();
        Ok(())
    }
}

/// Puts the environment asked for in the place of the scene's own.
pub fn set_environment(
    scene: &mut Scene,
    env: &EnvArg,
    rotation_degrees: f32,
    scale: f32,
    console: &mut Console,
) -> Result<(), CliError> {
    let sky = match env {
        EnvArg::Constant(radiance) => Sky::Constant((*radiance).into()),
        EnvArg::File(path) => {
            let (map, warnings) = load::load_environment(path)?;
            warnings.iter().for_each(|warning| console.warn(warning));
            Sky::Map(Arc::new(map))
        }
    };
    let environment = Environment { sky, rotation_degrees, scale };
    let existing = scene.keys_with::<Environment>();
    if existing.is_empty() {
        scene.spawn((environment,));
    } else {
        for key in existing {
            scene.insert(key, environment.clone());
        }
    }
    Ok(())
}

/// Names of the scene's cameras in the order of their indices: the node's, else their own.
pub fn camera_names(scene: &Scene, in_file: &[CameraInfo]) -> Vec<String> {
    let own = |key| in_file.iter().find(|camera| camera.keys.contains(&key)).map(|camera| camera.name.clone());
    let name = |key| scene.get::<Name>(key).map(|name| name.0.to_string()).or_else(|| own(key)).unwrap_or_default();
    scene.keys_with::<Camera>().into_iter().map(name).collect()
}

/// 1280 pixels wide in the shape that the camera asks for.
pub fn default_size(camera: &CameraView) -> [u32; 2] {
    let aspect = camera.aspect.filter(|a| a.is_finite() && *a > 0.0).unwrap_or(DEFAULT_ASPECT);
    let height = (DEFAULT_WIDTH as f32 / aspect).round().clamp(1.0, 65_536.0);
    [DEFAULT_WIDTH, height as u32]
}

/// The lights of a scene, for messages.
pub fn light_names(scene: &Scene, flat: &FlatScene) -> String {
    let groups = wavecast::flat::LightGroups::new(flat);
    let name =
        |&key: &u64| scene.get::<Name>(SceneKey(key)).map_or_else(|| key.to_string(), |name| format!("{:?}", name.0));
    let names: Vec<String> = groups.keys.iter().filter(|&&key| key != u64::MAX).map(name).take(20).collect();
    if names.is_empty() { "none with a flux".into() } else { names.join(", ") }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        scene: SceneArgs,
    }

    fn parse(line: &str) -> SceneArgs {
        let words = ["wavecast", "a.glb"].into_iter().chain(line.split_whitespace());
        Line::try_parse_from(words).unwrap_or_else(|error| panic!("{line}: {error}")).scene
    }

    #[test]
    fn views_are_two_points() {
        assert_eq!(view("0,1,0,1,1,0"), Ok(View { eye: DVec3::Y, target: DVec3::new(1.0, 1.0, 0.0) }));
        for text in ["", "0,1,0", "0,1,0,0,1,0", "0,1,0,1,1,x"] {
            assert!(view(text).is_err(), "{text}");
        }
        assert!(Line::try_parse_from("wavecast a.glb --view 0,1,0,1,1,0 --camera 0".split(' ')).is_err());
        let mut scene = Scene::new();
        parse("--view 0,1,0,0,-1,0").view.expect("it is given").take(&mut scene);
        let mut renderer = Renderer::new();
        renderer.sync(&mut scene);
        // Straight down, which has no up.
        assert!((renderer.scene().camera.forward + DVec3::Y).length() < 1e-9 && renderer.scene().camera.up.is_finite());
    }

    #[test]
    fn a_picture_is_1280_wide_in_the_shape_of_its_camera() {
        let camera = |aspect| CameraView { aspect, ..CameraView::default() };
        assert_eq!(default_size(&camera(None)), [1280, 720]);
        assert_eq!(default_size(&camera(Some(2.0))), [1280, 640]);
        assert_eq!(default_size(&camera(Some(f32::NAN))), [1280, 720]);
        assert_eq!(default_size(&camera(Some(1e9))), [1280, 1]);
    }

    #[test]
    fn cameras_are_found_by_name_then_by_index() {
        let mut scene = Scene::new();
        let spawn = |scene: &mut Scene, name: &str| scene.spawn((Name(name.into()), Camera::perspective(1.0)));
        let keys = [spawn(&mut scene, "left"), spawn(&mut scene, "0"), spawn(&mut scene, "right")];
        let console = Console::new(true, false);
        let in_file = [CameraInfo { name: "wide".into(), keys: vec![keys[2]] }];
        let mut choose =
            |line: &str| parse(line).choose_camera(&mut scene, &in_file, &console).map(|()| scene.active_camera);
        assert_eq!(choose("").unwrap(), None);
        assert_eq!(choose("--camera right").unwrap(), Some(keys[2]));
        assert_eq!(choose("--camera wide").unwrap(), Some(keys[2]), "the camera's own name");
        assert_eq!(choose("--camera 2").unwrap(), Some(keys[2]));
        assert_eq!(choose("--camera 0").unwrap(), Some(keys[1]), "a name comes before an index");
        let error = choose("--camera top").unwrap_err();
        assert!(error.to_string().contains("0 \"left\", 1 \"0\", 2 \"right\""), "{error}");
        assert_eq!(error.exit_code(), 1);
    }

    #[test]
    fn the_environment_asked_for_replaces_the_scenes_own() {
        let mut scene = Scene::new();
        let own = scene.spawn((Environment::constant(glam::Vec3::ONE),));
        let args = parse("--env 1,2,3 --env-rotate -90 --env-scale 2");
        let (rotation, scale) = (args.env_rotate.unwrap(), args.env_scale.unwrap());
        let console = &mut Console::new(true, false);
        set_environment(&mut scene, args.env.as_ref().unwrap(), rotation, scale, console).unwrap();
        assert_eq!(scene.keys_with::<Environment>(), [own]);
        let want =
            Environment { sky: Sky::Constant(glam::Vec3::new(1.0, 2.0, 3.0)), rotation_degrees: -90.0, scale: 2.0 };
        assert_eq!(scene.get::<Environment>(own), Some(want));
    }
}
