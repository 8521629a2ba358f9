//! Sync rebuilds what an edit asks for and nothing else, and ends where a fresh load would.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use wavecast::{
    render::{AccelKind, Quality, Renderer},
    world::{
        AlphaMode, Camera, EmissiveSurface, Environment, Geometry, LocalTransform, Material, MaterialSlots, Parent,
        PointLight, Scene, SceneKey, Shape, TriMesh, Visibility, units::Candela,
    },
};

use crate::common::{look, settings, show};

struct Stage {
    scene: Scene,
    renderer: Renderer,
    object: SceneKey,
    paint: SceneKey,
    camera: SceneKey,
    lamp: SceneKey,
    sky: SceneKey,
    parent: SceneKey,
}

fn stage() -> Stage {
    let mut scene = Scene::new();
    let parent = scene.spawn((LocalTransform::IDENTITY,));
    let (object, paint) = show(&mut scene, TriMesh::sphere(Vec3::ZERO, 1.0, 8), Material::lambert(Vec3::splat(0.5)));
    scene.insert(object, Parent(parent));
    show(&mut scene, TriMesh::quad(Vec3::new(-4.0, -1.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0), Material::default());
    let lamp = scene.spawn((
        PointLight { color: Vec3::ONE, intensity: Candela(20.0) },
        LocalTransform::from_translation(DVec3::new(1.0, 3.0, 1.0)),
    ));
    let sky = scene.spawn((Environment::constant(Vec3::splat(0.2)),));
    let camera = look(&mut scene, DVec3::new(0.0, 1.0, 6.0), DVec3::ZERO, 40.0);
    let mut renderer = Renderer::new();
    renderer.sync(&mut scene);
    Stage { scene, renderer, object, paint, camera, lamp, sky, parent }
}

/// Makes an edit, and checks which systems rebuild something, that they then rest, and that the picture is
/// that of a renderer that never saw the scene before the edit.
#[track_caller]
fn check_edit(edit: impl FnOnce(&mut Stage), want: &[&str]) {
    let mut stage = stage();
    edit(&mut stage);
    let report = stage.renderer.sync(&mut stage.scene);
    let ran: Vec<&str> = report.rebuilt.iter().map(|(name, _)| *name).collect();
    assert_eq!(ran, want);
    assert_eq!(stage.renderer.sync(&mut stage.scene).rebuilt, [], "nothing changed since");
    // Watches belong to the scene: to look at it afresh, everything in it is written into another one.
    let settings = settings(24, 2);
    let edited = stage.renderer.render(&settings, &()).picture;
    let mut fresh = Renderer::new();
    let mut copy = copy(&stage.scene);
    fresh.sync(&mut copy);
    assert!(fresh.render(&settings, &()).picture == edited, "the picture is not that of a fresh load");
}

/// The same entities under the same order of keys in another scene.
fn copy(scene: &Scene) -> Scene {
    let mut copy = Scene::new();
    let mut keys: Vec<SceneKey> = scene.keys_with::<SceneKey>();
    keys.sort_unstable();
    let new_key = |old: SceneKey, keys: &[SceneKey]| SceneKey(keys.binary_search(&old).unwrap() as u64);
    for &key in &keys {
        let made = copy.spawn(());
        macro_rules! carry {
            ($($component:ty),*) => { $(if let Some(c) = scene.get::<$component>(key) { copy.insert(made, c); })* };
        }
        carry!(LocalTransform, Geometry, Shape, Material, PointLight, Environment, Camera, Visibility, EmissiveSurface);
        if let Some(Parent(parent)) = scene.get::<Parent>(key) {
            copy.insert(made, Parent(new_key(parent, &keys)));
        }
        if let Some(MaterialSlots(slots)) = scene.get::<MaterialSlots>(key) {
            copy.insert(made, MaterialSlots(slots.iter().map(|&slot| new_key(slot, &keys)).collect()));
        }
    }
    copy
}

#[test]
fn the_first_sync_builds_everything_and_the_second_nothing() {
    let mut scene = stage().scene;
    let mut copied = copy(&scene);
    let mut renderer = Renderer::new();
    let ran: Vec<&str> = renderer.sync(&mut copied).rebuilt.iter().map(|(name, _)| *name).collect();
    assert_eq!(ran, ["transforms", "textures", "materials", "geometry", "instances", "lights", "camera"]);
    assert_eq!(renderer.sync(&mut copied).rebuilt, []);
    assert!(scene.despawn(SceneKey(0)));
}

#[test]
fn writing_the_same_value_rebuilds_nothing() {
    check_edit(
        |s| {
            let material = s.scene.get::<Material>(s.paint).unwrap();
            s.scene.insert(s.paint, material);
        },
        &[],
    );
}

/// A ball in place of the mesh, and what such an edit rebuilds.
fn with_ball(stage: &mut Stage) {
    let entity = stage.scene.entity(stage.object).unwrap();
    stage.scene.world_mut().exchange_one::<Geometry, _>(entity, Shape::Sphere { radius: 1.2 }).unwrap();
}

#[test]
fn a_shape_may_be_put_in_replaced_and_removed() {
    const ALL: [&str; 4] = ["textures", "materials", "geometry", "instances"];
    check_edit(with_ball, &ALL);
    // One after the other on the same renderer: each gives the picture of a fresh load.
    let ball = |s: &mut Stage, radius: f32| {
        let entity = s.scene.entity(s.object).unwrap();
        *s.scene.world_mut().get::<&mut Shape>(entity).unwrap() = Shape::Sphere { radius };
    };
    let resized = |s: &mut Stage| {
        with_ball(s);
        s.renderer.sync(&mut s.scene);
        ball(s, 0.6);
    };
    check_edit(resized, &ALL);
    let same = |s: &mut Stage| {
        with_ball(s);
        s.renderer.sync(&mut s.scene);
        ball(s, 1.2);
    };
    check_edit(same, &[]);
    let removed = |s: &mut Stage| {
        with_ball(s);
        s.renderer.sync(&mut s.scene);
        let entity = s.scene.entity(s.object).unwrap();
        s.scene.world_mut().remove_one::<Shape>(entity).unwrap();
    };
    check_edit(removed, &ALL);
    let despawned = |s: &mut Stage| {
        with_ball(s);
        s.renderer.sync(&mut s.scene);
        assert!(s.scene.despawn(s.object));
    };
    check_edit(despawned, &[&["transforms"], &ALL[..]].concat());
    let shining = |s: &mut Stage| {
        with_ball(s);
        s.renderer.sync(&mut s.scene);
        s.scene.insert(s.object, EmissiveSurface { radiance: Vec3::splat(3.0) });
    };
    check_edit(shining, &["textures", "materials", "lights"]);
}

#[test]
fn a_material_edit_rebuilds_the_material_table_alone() {
    let recolor = |s: &mut Stage| {
        let entity = s.scene.entity(s.paint).unwrap();
        s.scene.world_mut().get::<&mut Material>(entity).unwrap().base_color = Vec3::new(0.9, 0.1, 0.1);
    };
    check_edit(recolor, &["textures", "materials"]);
}

#[test]
fn a_material_that_begins_to_emit_rebuilds_the_lights() {
    let light_up = |s: &mut Stage| {
        let entity = s.scene.entity(s.paint).unwrap();
        s.scene.world_mut().get::<&mut Material>(entity).unwrap().emissive = Vec3::splat(2.0);
    };
    check_edit(light_up, &["textures", "materials", "lights"]);
}

/// What is known of triangles lies in their trees, which are written to again.
#[test]
fn a_surface_that_loses_its_back_or_becomes_a_veil_is_told_to_the_trees() {
    let all = ["textures", "materials", "opacity", "instances"];
    let paint = |s: &mut Stage, material: Material| assert!(s.scene.insert(s.paint, material));
    let [solid, backless] = [true, false].map(|double_sided| Material { double_sided, ..Material::default() });
    check_edit(|s| paint(s, backless.clone()), &all);
    let veil = Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.5, ..Material::default() };
    check_edit(|s| paint(s, veil.clone()), &all);
    // And back, and with another entity that shows the same mesh otherwise.
    check_edit(
        |s| {
            let mesh = s.scene.get::<Geometry>(s.object).unwrap();
            paint(s, veil.clone());
            s.renderer.sync(&mut s.scene);
            paint(s, solid.clone());
            s.renderer.sync(&mut s.scene);
            let backless = s.scene.spawn((backless.clone(),));
            let place = LocalTransform::from_translation(DVec3::X);
            s.scene.spawn((mesh, MaterialSlots::from(backless), place));
        },
        &["transforms", "textures", "materials", "geometry", "instances"],
    );
}

#[test]
fn an_emissive_surface_overrides_the_material_of_its_entity() {
    check_edit(
        |s| {
            s.scene.insert(s.object, EmissiveSurface { radiance: Vec3::new(1.0, 2.0, 3.0) });
        },
        &["textures", "materials", "lights"],
    );
}

#[test]
fn moving_an_object_rebuilds_the_instances() {
    let shift = |s: &mut Stage| {
        s.scene.insert(s.object, LocalTransform::from_translation(DVec3::new(0.5, 0.0, 0.0)));
    };
    check_edit(shift, &["transforms", "instances"]);
}

#[test]
fn moving_a_parent_moves_what_hangs_below_it() {
    let shift = |s: &mut Stage| {
        s.scene.insert(s.parent, LocalTransform::from_translation(DVec3::new(-0.5, 0.3, 0.0)));
    };
    check_edit(shift, &["transforms", "instances"]);
}

#[test]
fn moving_the_camera_rebuilds_the_camera_alone() {
    let step = |s: &mut Stage| {
        s.scene.insert(s.camera, LocalTransform::looking_at(DVec3::new(1.0, 1.0, 6.0), DVec3::ZERO, DVec3::Y));
    };
    check_edit(step, &["transforms", "camera"]);
}

#[test]
fn a_wider_view_rebuilds_the_camera_alone() {
    check_edit(
        |s| {
            s.scene.insert(s.camera, Camera::perspective(1.0));
        },
        &["camera"],
    );
}

#[test]
fn a_lamp_or_sky_edit_rebuilds_the_lights_alone() {
    let brighter = |s: &mut Stage| {
        s.scene.insert(s.lamp, PointLight { color: Vec3::ONE, intensity: Candela(40.0) });
    };
    check_edit(brighter, &["lights"]);
    let bluer = |s: &mut Stage| {
        s.scene.insert(s.sky, Environment::constant(Vec3::new(0.1, 0.1, 0.4)));
    };
    check_edit(bluer, &["lights"]);
    let aside = |s: &mut Stage| {
        s.scene.insert(s.lamp, LocalTransform::from_translation(DVec3::new(-1.0, 3.0, 1.0)));
    };
    check_edit(aside, &["transforms", "lights"]);
}

#[test]
fn replacing_a_mesh_builds_that_mesh_alone() {
    let mut stage = stage();
    stage.scene.insert(stage.object, Geometry(Arc::new(TriMesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5)))));
    let report = stage.renderer.sync(&mut stage.scene);
    assert!(report.rebuilt.contains(&("geometry", 1)), "one of two meshes: {:?}", report.rebuilt);
    check_edit(
        |s| {
            s.scene.insert(s.object, Geometry(Arc::new(TriMesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5)))));
        },
        &["textures", "materials", "geometry", "instances"],
    );
}

#[test]
fn hiding_and_despawning_take_an_object_out() {
    check_edit(
        |s| {
            s.scene.insert(s.parent, Visibility(false));
        },
        &["transforms", "textures", "materials", "geometry", "instances"],
    );
    check_edit(
        |s| {
            s.scene.despawn(s.object);
        },
        &["transforms", "textures", "materials", "geometry", "instances"],
    );
}

/// Another structure, or another quality of the same, and back: the trees are made anew and nothing else.
#[test]
fn another_structure_rebuilds_the_trees_alone() {
    let mut stage = stage();
    let settings = settings(24, 2);
    let want = stage.renderer.render(&settings, &()).picture;
    let columns = |renderer: &Renderer| renderer.scene().meshes.iter().map(|mesh| mesh.positions.as_ptr()).collect();
    let bytes = |renderer: &Renderer| renderer.scene().meshes[0].blas.bytes();
    let before: Vec<_> = columns(&stage.renderer);
    let bytes_before = bytes(&stage.renderer);
    let mut trees = Vec::new();
    for accel in [AccelKind::KdTree, AccelKind::Bvh8(Quality::Best), AccelKind::Brute, AccelKind::default()] {
        stage.renderer.accel = accel;
        assert_eq!(stage.renderer.sync(&mut stage.scene).rebuilt, [("geometry", 2), ("instances", 2)], "{accel:?}");
        assert_eq!(stage.renderer.sync(&mut stage.scene).rebuilt, [], "nothing changed since");
        let after: Vec<_> = columns(&stage.renderer);
        assert!(before == after, "{accel:?}: the vertices stayed where they were");
        trees.push(bytes(&stage.renderer));
        let flat = stage.renderer.scene();
        for (one, mesh) in flat.accel.instances().iter().zip(&flat.instances.mesh) {
            assert!(Arc::ptr_eq(&one.blas, &flat.meshes[*mesh as usize].blas), "{accel:?}: what is placed is new");
        }
        assert!(stage.renderer.render(&settings, &()).picture == want, "{accel:?}");
    }
    assert!(trees[0] != bytes_before && trees[2] != bytes_before && trees[0] != trees[2], "{trees:?}");
    assert_eq!(trees[3], bytes_before);
}

/// With edits at the same time, the picture is still that of a fresh load.
#[test]
fn another_structure_and_edits_go_together() {
    check_edit(
        |s| {
            s.renderer.accel = AccelKind::Octree;
            s.scene.insert(s.object, LocalTransform::from_translation(DVec3::new(0.5, 0.0, 0.0)));
        },
        &["transforms", "geometry", "instances"],
    );
    check_edit(
        |s| {
            s.renderer.accel = AccelKind::Grid;
            s.scene.insert(s.object, Geometry(Arc::new(TriMesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5)))));
        },
        &["textures", "materials", "geometry", "instances"],
    );
    check_edit(
        |s| {
            s.renderer.accel = AccelKind::Bvh2;
            let clear = Material { alpha_mode: AlphaMode::Blend, base_alpha: 0.5, ..Material::default() };
            s.scene.insert(s.paint, clear);
        },
        &["textures", "materials", "geometry", "instances"],
    );
}

/// Instances share their mesh: a thousand entities, one tree.
#[test]
fn entities_that_show_the_same_mesh_share_it() {
    let mut scene = Scene::new();
    let mesh = Arc::new(TriMesh::sphere(Vec3::ZERO, 0.3, 6));
    for i in 0..1000 {
        let place = DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100));
        scene.spawn((Geometry(Arc::clone(&mesh)), LocalTransform::from_translation(place)));
    }
    let mut renderer = Renderer::new();
    let report = renderer.sync(&mut scene);
    assert!(report.rebuilt.contains(&("geometry", 1)));
    assert_eq!((renderer.scene().meshes.len(), renderer.scene().instances.len()), (1, 1000));
}

/// A transform without an inverse, and a cycle of parents: a warning each, and a picture of the rest.
#[test]
fn what_cannot_be_placed_is_left_out_with_a_warning() {
    let mut stage = stage();
    let flat = LocalTransform::Trs {
        translation: DVec3::ZERO,
        rotation: glam::DQuat::IDENTITY,
        scale: DVec3::new(1.0, 0.0, 1.0),
    };
    stage.scene.insert(stage.object, flat);
    let report = stage.renderer.sync(&mut stage.scene);
    assert_eq!(report.warnings.len(), 1, "{:?}", report.warnings);
    assert_eq!(stage.renderer.scene().instances.len(), 1);
    stage.scene.insert(stage.object, LocalTransform::IDENTITY);
    stage.scene.insert(stage.parent, Parent(stage.object));
    let report = stage.renderer.sync(&mut stage.scene);
    assert!(report.warnings.iter().any(|w| w.contains("cycle")), "{:?}", report.warnings);
}
