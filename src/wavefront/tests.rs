//! Rays that leave a shape must not meet it again where they start; camera rays go together.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::{
    Aim, Job, Parts, Worker, one_path, schedule,
    surface::{self, Incoming},
};
use crate::{
    accel::{NO_HIT, Solid, Stacks, TOGETHER},
    film::{Film, LayerData, PathLayer, Split, Sums, Tile},
    reference::Rng,
    render::{LayerKind, RenderSettings, Renderer, Sharing, find_lights},
    sampling::REPLICAS,
    simd::V3,
    world::{
        AlphaMode, Camera, Environment, EnvironmentMap, Geometry, LocalTransform, Material, MaterialSlots, PointLight,
        Scene, Shape, Sky, TriMesh, generated, units::Candela,
    },
};

fn vector(v: DVec3) -> V3<f32> {
    V3::from_array(v.as_vec3().to_array())
}

fn double(v: V3<f32>) -> DVec3 {
    DVec3::from_array(v.lane(0).map(f64::from))
}

/// Follows rays on from where rays have met a shape from outside, to both sides: outside they never meet it again, inside
/// only on its other side, half the true chord away at least, and of what is closed always.
#[track_caller]
fn check_leaving(shape: Shape, place: DAffine3, rays: u32, rng: &mut Rng) -> [u32; 2] {
    let mut scene = Scene::new();
    scene.spawn((shape, LocalTransform::Matrix(place)));
    let mut renderer = Renderer::new();
    let report = renderer.sync(&mut scene);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let flat = renderer.scene();
    let m = flat.instances.world_from_local[0].map(f64::from);
    let column = |i: usize| DVec3::new(m[i], m[i + 4], m[i + 8]);
    let world_from_local =
        DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
    let local_from_world = world_from_local.inverse();
    let size = match shape {
        Shape::Sphere { radius } | Shape::Disc { radius } | Shape::Cylinder { radius, .. } => f64::from(radius),
        Shape::Plane => 1.0,
    };
    let mut between = || 2.0 * rng.uniform() - 1.0;
    let mut stacks = Stacks::default();
    let mut nearest = |origin: V3<f32>, direction: V3<f32>| {
        flat.accel.nearest(origin.lane(0), direction.lane(0), f32::INFINITY, 0, &Solid, &mut stacks)
    };
    let mut left = [0; 2];
    for _ in 0..rays {
        let mut point = |scale: f64| scale * DVec3::new(between(), between(), between());
        let origin = world_from_local.transform_point3(point(5.0 * size));
        let target = world_from_local.transform_point3(point(0.8 * size));
        let direction = (target - origin).normalize();
        let hit = nearest(vector(origin), vector(direction));
        if hit == NO_HIT {
            continue;
        }
        let incoming = Incoming::<f32> {
            direction: vector(direction),
            b1: hit.b1,
            b2: hit.b2,
            back: hit.back,
            instance: [0; 8],
            triangle: [hit.triangle; 8],
            material: [0; 8],
        };
        let surface = surface::interact::<f32, false>(flat, &incoming, Parts::Color, true, &mut 0);
        let local = shape.point(hit.triangle, hit.b1, hit.b2);
        let normal = shape.normal(local);
        let away = (double(surface.p) - world_from_local.transform_point3(local)).abs();
        assert!(away.cmple(double(surface.error)).all(), "{shape:?} {place:?}: {away} {:?}", surface.error);
        let facing = (local_from_world.matrix3.transpose() * normal).normalize();
        let side = if hit.back { -1.0 } else { 1.0 };
        assert!((double(surface.ng) - side * facing).length() < 1e-6, "{:?} {facing}", surface.ng);
        // As often as not along the surface.
        let mut wi = point(1.0).normalize();
        wi -= wi.dot(facing) * facing * [0.0, 0.9, 0.999, 0.99999][(between() * 2.0 + 2.0) as usize & 3];
        let wi = vector(wi.normalize());
        let height = double(wi).dot(side * facing);
        if height.abs() < 1e-6 {
            continue;
        }
        let origin = surface.leave(height > 0.0);
        let again = nearest(origin, wi);
        let d = local_from_world.matrix3 * double(wi);
        let flat_d = if matches!(shape, Shape::Cylinder { .. }) { d.with_y(0.0) } else { d };
        // From p on the surface the other crossing is where |p + t d| = |p|.
        let chord = -2.0 * local.dot(flat_d) / flat_d.length_squared();
        let round = matches!(shape, Shape::Sphere { .. } | Shape::Cylinder { .. });
        if !round || normal.dot(d) > 0.0 {
            left[0] += 1;
            assert!(again == NO_HIT, "{shape:?} {place:?}: left at {height}, met again after {}", again.t);
        } else {
            left[1] += 1;
            let closed = matches!(shape, Shape::Sphere { .. });
            assert!(again != NO_HIT || !closed, "{shape:?} {place:?}: lost inside at {height}");
            assert!(f64::from(again.t) >= 0.5 * chord, "{shape:?} {place:?}: {} of {chord}", again.t);
        }
    }
    left
}

/// A million rays: radii and distances from the origin from 1 mm to 100 km, as they are and turned, stretched and mirrored.
/// Not where the radius is so small that positions there cannot tell its points apart.
#[test]
fn rays_that_leave_a_shape_do_not_meet_it_where_they_start() {
    let mut rng = Rng::new(5, 0);
    let mut left = [0; 2];
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 0.4, -0.3).normalize(), 0.8);
    let sizes = [1e-3_f32, 0.1, 10.0, 1e3, 1e5];
    for radius in sizes {
        for far in sizes.map(f64::from).into_iter().filter(|far| *far <= 1.1e4 * f64::from(radius)) {
            for shape in [
                Shape::Sphere { radius },
                Shape::Cylinder { radius, half_height: 0.7 * radius },
                Shape::Disc { radius },
                Shape::Plane,
            ] {
                for scale in [DVec3::ONE, DVec3::new(0.3, -1.5, 0.8)] {
                    let turn = if scale == DVec3::ONE { DQuat::IDENTITY } else { turn };
                    let at = far * DVec3::new(0.6, -1.0, 0.3);
                    let place = DAffine3::from_scale_rotation_translation(scale, turn, at);
                    let some = check_leaving(shape, place, 10_000, &mut rng);
                    left = [left[0] + some[0], left[1] + some[1]];
                }
                let some = check_leaving(shape, DAffine3::IDENTITY, 2_000, &mut rng);
                left = [left[0] + some[0], left[1] + some[1]];
            }
        }
    }
    assert!(left[0] > 500_000 && left[1] > 150_000, "{left:?}");
}

/// Camera rays of a render, and rays that went in packets.
fn rays_in_packets(scene: &mut Scene, max_depth: Option<u32>) -> [u64; 2] {
    let mut renderer = Renderer::new();
    renderer.sync(scene);
    let together = AtomicU64::new(0);
    let counted = |worker: &mut Worker, job: &Job, tile: &mut Tile, from, to, step| {
        TOGETHER.set(0);
        worker.run(job, tile, from, to, step);
        together.fetch_add(TOGETHER.get(), Ordering::Relaxed);
    };
    // Rays between neighbours go in packets too.
    let sharing = Sharing::Off;
    let settings =
        RenderSettings { width: 192, height: 128, spp: Some(4), max_depth, sharing, ..RenderSettings::default() };
    let stats = schedule::render_by(renderer.scene(), &settings, &(), counted).stats;
    assert_eq!(stats.rays.camera, 192 * 128 * 4);
    assert_eq!(stats.rays.bounce > stats.rays.camera, max_depth.is_none());
    [stats.rays.camera, together.into_inner()]
}

/// Where all surfaces are solid, and where some let rays pass; with bounces before them in a wave, and without. Those go
/// alone whose neighbours differ in the sign or the longest axis of a direction.
#[test]
fn camera_rays_go_in_packets() {
    let mut veiled = generated::hall(3000);
    for key in veiled.keys_with::<Material>() {
        let material: Material = veiled.get(key).unwrap();
        veiled.insert(key, Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.7, ..material });
    }
    for scene in [&mut generated::hall(3000), &mut veiled] {
        for max_depth in [Some(0), None] {
            let [camera, together] = rays_in_packets(scene, max_depth);
            assert!(together <= camera && together > camera * 3 / 4, "{together} of {camera}, {max_depth:?}");
        }
    }
}

/// Everything that light takes another way for: glass and a mirror before an emitting triangle and before the sun of a sky, what
/// absorbs, what covers in part, lamps of all kinds, and surfaces that share.
fn all_ways() -> Scene {
    let mut scene = Scene::new();
    let mut show = |mesh: TriMesh, material: Material| {
        let material = scene.spawn((material,));
        scene.spawn((Geometry(mesh.into()), MaterialSlots::from(material)));
    };
    let quad = |corner: [f32; 3], a: Vec3, b: Vec3| TriMesh::quad(corner.into(), a, b);
    show(quad([-3.0, 0.0, 3.0], Vec3::X * 6.0, Vec3::NEG_Z * 6.0), Material::lambert(Vec3::new(0.7, 0.6, 0.5)));
    show(quad([-3.0, 0.0, -3.0], Vec3::X * 6.0, Vec3::Y * 4.0), Material { metallic: 0.0, ..Material::default() });
    let lamp = Material { emissive: Vec3::new(9.0, 8.0, 5.0), double_sided: true, ..Material::default() };
    show(quad([-0.5, 3.0, -0.5], Vec3::X, Vec3::Z), lamp);
    show(
        quad([-2.5, 0.5, -2.9], Vec3::X * 0.5, Vec3::Y * 0.5),
        Material { unlit: true, ..Material::lambert(Vec3::ONE) },
    );
    show(TriMesh::sphere(Vec3::new(-1.2, 0.7, 0.0), 0.7, 12), Material { roughness: 0.0, ..Material::default() });
    let glass = Material { attenuation_distance: 0.5, attenuation_color: Vec3::splat(0.5), ..Material::glass(1.5) };
    show(TriMesh::sphere(Vec3::new(1.0, 0.7, 0.6), 0.7, 12), glass);
    scene.spawn((
        PointLight { color: Vec3::new(1.0, 0.5, 0.2), intensity: Candela(3.0) },
        LocalTransform::from_translation(DVec3::new(2.0, 2.0, 2.0)),
    ));
    let mut texels = vec![[0.1, 0.15, 0.2]; 32 * 16];
    texels[3 * 32 + 20] = [900.0; 3];
    let map = EnvironmentMap { name: String::new(), width: 32, height: 16, texels };
    scene.spawn((Environment { sky: Sky::Map(map.into()), rotation_degrees: 0.0, scale: 1.0 },));
    let eye = LocalTransform::looking_at(DVec3::new(0.5, 1.8, 5.0), DVec3::new(0.0, 0.8, 0.0), DVec3::Y);
    scene.spawn((Camera::perspective(0.7), eye));
    scene
}

/// The layers of each split add up to the picture's light in all 128 bits, in every pixel and replica; and all other bits
/// are those of a picture without layers, whether pixels share or not and however paths are taken.
#[test]
fn light_in_parts_adds_up_to_all_light_and_changes_none_of_it() {
    const SPLITS: [Split; 7] = [
        Split::Bounces,
        Split::Lights,
        Split::Direct,
        Split::LightsByBounces,
        Split::LightsByDirect,
        Split::Lobes,
        Split::LobesByBounces,
    ];
    let mut renderer = Renderer::new();
    let mut scene = all_ways();
    renderer.sync(&mut scene);
    let flat = renderer.scene();
    for (sharing, max_depth, error) in [
        (Sharing::Always, None, None),
        (Sharing::Off, None, None),
        (Sharing::Always, Some(3), None),
        (Sharing::WherePays, None, Some(0.3)),
    ] {
        let plain = RenderSettings {
            width: 40,
            height: 30,
            spp: Some(if error.is_some() { 64 } else { 8 }),
            sharing,
            max_depth,
            error,
            ..RenderSettings::default()
        };
        let layers: Vec<_> = SPLITS.into_iter().chain([Split::Paths]).map(LayerKind::Light).collect();
        // As other layers are.
        let same = [
            ("all", "C.*", None),
            ("seen", "C[LB]", Some("bounce00")),
            ("second", "C..[LB]", Some("bounce02")),
            ("later", "C.{2,}[LB]", Some("indirect")),
            ("of-sky", "C.*B", Some("light.sky")),
            ("of-sky-late", "C...<L.'sky'>", Some("light.sky.bounce03")),
            ("coats", "C<R[SG]>.*[LB]", Some("specular.all")),
        ];
        let paths = same.map(|(name, text, _)| PathLayer {
            name: name.into(),
            expression: text.parse().unwrap_or_else(|error| panic!("{error}")),
        });
        let mut with = RenderSettings { layers: layers.clone(), paths: paths.to_vec(), ..plain.clone() };
        find_lights(&mut with, &scene).expect("the sky is there");
        let (film, rendered) = schedule::film_by(flat, &with, Aim::Camera, &(), Worker::run);
        assert!(film.splats.is_some(), "light comes from emitters too");
        assert_eq!(rendered.picture.rgb, renderer.render(&plain, &()).picture.rgb);
        check_parts(&film, SPLITS);
        // However waves, tiles and threads are cut.
        let other = RenderSettings { threads: 1, wave_size: 100, tile_size: 16, ..with.clone() };
        assert_eq!(rendered.picture.layers, renderer.render(&other, &()).picture.layers);
        if error.is_none() {
            let (single, one) = schedule::film_by(flat, &with, Aim::Camera, &(), one_path::run);
            check_parts(&single, SPLITS);
            assert_eq!(rendered.picture.layers, one.picture.layers);
        }
        // None of them is there for nothing.
        let lit = |name: &str| {
            let layer = rendered.picture.layers.iter().find(|layer| layer.name == name);
            let data = &layer.unwrap_or_else(|| panic!("no layer {name}")).data;
            matches!(data, LayerData::Rgb(values) if values.iter().flatten().any(|&c| c > 0.0))
        };
        for name in ["bounce00", "bounce01", "bounce02", "bounce03", "light.sky", "indirect", "light.sky.bounce03"] {
            assert!(lit(name), "{name}");
        }
        assert!(lit("bounce03.error"));
        for name in ["diffuse.direct", "specular.direct", "specular.bounce02", "transmission.indirect"] {
            assert!(lit(name), "{name}");
        }
        let values = |name: &str| {
            let layer = rendered.picture.layers.iter().find(|layer| layer.name == name);
            match layer.map(|layer| &layer.data) {
                Some(LayerData::Rgb(values)) => values.clone(),
                other => panic!("{name}: {other:?}"),
            }
        };
        for (name, _, other) in same {
            match other {
                None => assert!(values(name) == rendered.picture.rgb, "{name}"),
                Some("specular.all") => {
                    let parts = ["specular.direct", "specular.indirect"].map(values);
                    for (i, all) in values(name).into_iter().enumerate() {
                        (0..3).for_each(|c| {
                            let sum = parts[0][i][c] + parts[1][i][c];
                            assert!((sum - all[c]).abs() <= 2e-7 * all[c], "{name}: {sum} {}", all[c]);
                        });
                    }
                }
                Some(other) => assert!(values(name) == values(other), "{name}"),
            }
        }
    }
}

#[track_caller]
fn check_parts(film: &Film, splits: [Split; 7]) {
    let sum = |parts: &[[Sums; REPLICAS]], replica: usize, pixel: usize| -> [i128; 3] {
        std::array::from_fn(|c| parts.iter().map(|part| part[replica].0[pixel][c]).sum())
    };
    for (row, tile) in film.tiles.iter().enumerate() {
        for split in splits {
            let layers = film.splits.first_of(split)..film.splits.first_of(split) + film.splits.layers_of(split);
            let splats = film.splats.as_ref().expect("checked above");
            let splatted: Vec<_> = layers.clone().map(|part| splats.tile(row, Some(part))).collect();
            for (replica, pixel) in (0..REPLICAS).flat_map(|r| (0..tile.pixels()).map(move |pixel| (r, pixel))) {
                assert_eq!(
                    sum(&tile.parts[layers.clone()], replica, pixel),
                    tile.replicas[replica].0[pixel],
                    "{split:?}"
                );
                assert_eq!(
                    sum(&splatted, replica, pixel),
                    splats.tile(row, None)[replica].0[pixel],
                    "{split:?} splats"
                );
            }
        }
    }
}
