//! Test models that show by themselves whether they are right: the parts that must look alike are compared.
//!
//! Places are those of the models' own coordinates; what each must show is in its README.

use glam::{DVec3, Vec3};
use wavecast::{
    render::{LayerKind, Renderer},
    world::{Geometry, LocalTransform, Name, Scene},
};

use super::judge::{Model, Patch, SIDE};
use crate::common::{asset, load_scene, settings};

/// Asserts that two patches show the same, and that it is something.
#[track_caller]
fn alike(what: &str, test: &Patch, sample: &Patch, tolerance: f32, contrast: f32) {
    let (difference, seen) = (test.difference(sample), sample.contrast());
    println!("{what}: difference {difference:.4}, contrast {seen:.4}");
    assert!(difference <= tolerance, "{what}: {difference} apart");
    assert!(seen >= contrast, "{what}: the sample shows nothing, {seen}");
}

/// Wrap modes, and which side of a polygon is there: eight rows of test and sample.
#[test]
fn texture_settings() {
    let Some(mut model) = Model::open("TextureSettingsTest/glTF-Binary/TextureSettingsTest.glb") else { return };
    for (row, y) in [2.54, 1.52, 0.47, -0.57, -1.6, -2.64, -3.68, -4.71].into_iter().enumerate() {
        let [test, sample] = [0.45, 2.6].map(|x| model.albedo([x, y], 0.42));
        let clamp = row == 2 || row == 3;
        alike(&format!("row {row}"), &test, &sample, 0.02, if clamp { 0.0 } else { 0.05 });
        let [r, g, b] = sample.mean();
        assert!(!clamp || g > 3.0 * r.max(b), "clamped to green: {:?}", sample.mean());
    }
}

/// Winding and culling under mirroring transforms, then spheres that must be lit the same.
#[test]
fn negative_scale() {
    let Some(mut model) = Model::open("NegativeScaleTest/glTF-Binary/NegativeScaleTest.glb") else { return };
    for y in [2.68, 1.52] {
        let sample = model.albedo([3.83, y], 0.4);
        for (what, x) in [("front", 0.01), ("back", 1.9)] {
            alike(what, &model.albedo([x, y], 0.4), &sample, 0.03, 0.05);
        }
    }
    for (what, y) in [("white", -1.0), ("dark", -2.25), ("metal", -3.5)] {
        let [plain, mirrored] = [1.0, 3.0].map(|x| model.light([x, y], 0.4, 256));
        let brightness = plain.mean()[1];
        alike(what, &mirrored, &plain, 0.05 * brightness + 0.01, 0.0);
    }
}

/// Which corner of the image is which.
#[test]
fn texture_coordinates() {
    let Some(mut model) = Model::open("TextureCoordinateTest/glTF-Binary/TextureCoordinateTest.glb") else { return };
    let mut corner = |x: f64, y: f64| model.albedo([x, y], 0.2).mean();
    let [yellow, red] = [corner(-0.7, 0.7), corner(0.7, 0.7)];
    let [blue, green] = [corner(-0.7, -0.7), corner(0.7, -0.7)];
    println!("{yellow:?} {red:?} {blue:?} {green:?}");
    assert!(yellow[0] > 0.3 && yellow[1] > 0.3 && yellow[2] < 0.1);
    assert!(red[0] > 0.3 && red[1] < 0.5 * red[0] && red[2] < 0.1);
    assert!(blue[2] > 0.3 && blue[0] < 0.1 && blue[1] < 0.5 * blue[2]);
    assert!(green[1] > 0.3 && green[0] < 0.1 && green[2] < 0.3 * green[1]);
}

/// Vertex colours leave one channel each of checkmarks that have crosses in the others.
#[test]
fn vertex_colors() {
    let Some(mut model) = Model::open("VertexColorTest/glTF-Binary/VertexColorTest.glb") else { return };
    for (channel, x) in [-0.55, 0.0, 0.59].into_iter().enumerate() {
        let [test, sample] = [0.34, -0.53].map(|y| model.albedo([x, y], 0.22));
        alike(&format!("channel {channel}"), &test, &sample, 0.02, 0.03);
        let mean = test.mean();
        let others = mean.iter().sum::<f32>() - mean[channel];
        assert!(others < 0.2 * mean[channel], "{mean:?}");
    }
}

/// Offset, rotation and scale of texture coordinates: colours above, tips of arrows below.
#[test]
fn texture_transforms() {
    let Some(mut model) = Model::open("TextureTransformTest/glTF/TextureTransformTest.gltf") else { return };
    for (x, want) in [(-1.1, [false, true, false]), (0.0, [false, false, true]), (1.1, [false, true, true])] {
        // The edge of the picture, where no checkmark is.
        let mean = model.albedo([x - 0.38, 0.55 + 0.3], 0.05).mean();
        println!("offset {x}: {mean:?}");
        let most = mean.into_iter().fold(0.0, f32::max);
        let got = mean.map(|c| c > 0.3 * most);
        assert_eq!(got, want, "{mean:?}");
    }
    // Along the way from the quad's upper left corner, which transforms leave where it is, to a marker.
    let mut toward = |quad: [f64; 2], marker: [f64; 2], share: f64| {
        let at = |axis: usize, corner: f64| quad[axis] + corner + share * (marker[axis] - corner);
        model.albedo([at(0, -0.5), at(1, 0.5)], 0.02).mean()[1]
    };
    let rotated = [-1.1, -0.55];
    let (right, none, wrong) = ([-0.08, -0.52], [0.28, -0.28], [0.52, 0.08]);
    let found = [right, none, wrong].map(|marker| toward(rotated, marker, 0.8));
    println!("rotation: {found:?}");
    assert!(found[0] < 0.1 && found[1] > 0.4 && found[2] > 0.4, "rotation: {found:?}");
    let scaled = [0.8, 1.25].map(|share| toward([0.0, -0.55], [0.02, -0.02], share));
    println!("scale: {scaled:?}");
    assert!(scaled[0] < 0.1 && scaled[1] > 0.4, "scale: {scaled:?}");
}

/// Transforms and the second set of coordinates in each kind of texture: three tiles in a row must be alike.
#[test]
fn transforms_and_sets_of_every_texture() {
    let path = "TextureTransformMultiTest/glTF-Binary/TextureTransformMultiTest.glb";
    let Some(mut model) = Model::open(path) else { return };
    let mut row = |what: &str, tolerance: f32, contrast: f32, look: &mut dyn FnMut(&mut Model, f64) -> Patch| {
        let [uv0, uv1, sample] = [0.1, 0.35, 0.6].map(|x| look(&mut model, x));
        alike(&format!("{what} 0"), &uv0, &sample, tolerance, contrast);
        alike(&format!("{what} 1"), &uv1, &sample, tolerance, contrast);
    };
    row("base colour", 0.02, 0.1, &mut |model, x| model.albedo([x, 0.75], 0.09));
    row("emission", 0.1, 0.1, &mut |model, x| model.light([x, 0.5], 0.09, 64));
    row("normal", 0.03, 0.03, &mut |model, x| model.layer(LayerKind::Normal, [x, 0.25], 0.09));
    row("metal, roughness", 0.1, 0.1, &mut |model, x| model.light([x, 0.0], 0.09, 64));
    row("unlit", 0.02, 0.1, &mut |model, x| model.light([x, -0.5], 0.09, 64));
}

/// Factors, and textures that say the same, with and without colour profiles that must be ignored.
#[test]
fn texture_encodings() {
    let Some(mut model) = Model::open("TextureEncodingTest/glTF-Binary/TextureEncodingTest.glb") else { return };
    for (what, y) in [("base colour", 2.0), ("emission", -1.0), ("metal, roughness", -4.0)] {
        let [factor, plain, gamma, profile] = [-2.75, 0.25, 3.25, 6.25].map(|x| model.light([x, y], 0.6, 64));
        let tolerance = 0.02 * factor.mean()[1];
        for (with, sphere) in [("texture", plain), ("gamma", gamma), ("profile", profile)] {
            alike(&format!("{what}, {with}"), &sphere, &factor, tolerance, 0.0);
        }
    }
}

/// Interpolation follows decoding: the middle of a black and a green texel is half of linear green.
#[test]
fn linear_interpolation() {
    let path = "TextureLinearInterpolationTest/glTF-Binary/TextureLinearInterpolationTest.glb";
    let Some(mut model) = Model::open(path) else { return };
    let [factor, texture] = [-1.5, 1.5].map(|x| model.light([x, -1.0], 0.1, 64).mean());
    println!("{factor:?} {texture:?}");
    assert!((factor[1] - texture[1]).abs() < 0.04 * factor[1], "{factor:?} {texture:?}");
}

/// Alpha falls by 1/4 for every 0.48 from 1 at y = 0.11: each mode covers its share of a strip.
#[test]
fn alpha_modes() {
    let Some(mut model) = Model::open("AlphaBlendModeTest/glTF-Binary/AlphaBlendModeTest.glb") else { return };
    let mut covered = |x: f64| {
        let ids = model.entities([x, 1.07], 0.7);
        let strip = |row: u32| (0..SIDE).filter(|column| (9..15).contains(column)).map(move |c| row * SIDE + c);
        let own = ids[((SIDE - 1) * SIDE + SIDE / 2) as usize];
        let count = (0..SIDE).flat_map(strip).filter(|&i| ids[i as usize] == own).count();
        count as f64 / f64::from(6 * SIDE)
    };
    // From 0.37 to 1.77.
    let share = |cutoff: f64| (2.03 - 1.92 * cutoff - 0.37) / 1.4;
    let found = [-3.0, -1.5, 0.0, 1.5, 3.0].map(&mut covered);
    println!("opaque, blended, masked at 0.25, 0.5, 0.75: {found:?}");
    for (found, want) in found.into_iter().zip([1.0, 0.5, share(0.25), share(0.5), share(0.75)]) {
        assert!((found - want).abs() < 0.06, "{found} is covered, expected {want}");
    }
}

/// Means of the normals of the four halves of a square: left, right, top, bottom.
fn halves(patch: &Patch) -> [Vec3; 4] {
    let half = SIDE / 2;
    [
        patch.mean_where(|x, _| x < half),
        patch.mean_where(|x, _| x >= half),
        patch.mean_where(|_, y| y < half),
        patch.mean_where(|_, y| y >= half),
    ]
    .map(Vec3::from)
}

/// Domes beside quads with a normal map of a dome, turned and mirrored: normals must point the same ways.
#[track_caller]
fn check_domes(path: &str, groups: &[f64], cells: usize, pitch: f64) {
    let Some(mut model) = Model::open(path) else { return };
    let mut worst = 0.0_f32;
    for row in 0..5 {
        for &x in groups {
            let y = 0.79 - 0.405 * f64::from(row);
            let real = halves(&model.layer(LayerKind::Normal, [x, y], 0.1));
            assert!(real[0].x < -0.1 && real[1].x > 0.1 && real[2].y > 0.1 && real[3].y < -0.1, "{real:?}");
            for cell in 1..cells {
                let mapped = halves(&model.layer(LayerKind::Normal, [x + pitch * cell as f64, y], 0.1));
                let apart = real.iter().zip(mapped).map(|(a, b)| (*a - b).length()).fold(0.0, f32::max);
                worst = worst.max(apart);
                println!("row {row}, {x} cell {cell}: {apart:.3}");
            }
        }
    }
    println!("{path}: {worst}");
    assert!(worst < 0.1, "{path}: {worst}");
}

#[test]
fn normal_maps_with_tangents_made_here() {
    check_domes("NormalTangentTest/glTF-Binary/NormalTangentTest.glb", &[-0.95, -0.155, 0.645], 2, 0.315);
}

#[test]
fn normal_maps_with_tangents_of_the_file() {
    check_domes("NormalTangentMirrorTest/glTF-Binary/NormalTangentMirrorTest.glb", &[-1.26, 0.47], 4, 0.315);
}

/// Arrows placed by quaternions and matrices point at targets that are in place by their vertices.
#[test]
fn arrows_point_at_their_targets() {
    let Some(path) = asset("OrientationTest/glTF-Binary/OrientationTest.glb") else { return };
    let scene = load_scene(&path);
    let find = |name: String| {
        let named = |key: &_| scene.get::<Name>(*key).is_some_and(|found| *found.0 == *name);
        scene.keys_with::<Geometry>().into_iter().find(named).unwrap_or_else(|| panic!("no {name}"))
    };
    for (arrow, axis) in [("X1", DVec3::Y), ("X2", DVec3::Y), ("Y1", DVec3::NEG_Z), ("Y2", DVec3::Z)]
        .into_iter()
        .chain([("Z1", DVec3::Y), ("Z2", DVec3::Y)])
    {
        let transform = scene.get::<LocalTransform>(find(format!("Arrow{arrow}"))).unwrap().to_affine();
        let target = scene.get::<Geometry>(find(format!("Target{arrow}"))).unwrap().0;
        let low = target.positions.iter().copied().reduce(Vec3::min).unwrap();
        let high = target.positions.iter().copied().reduce(Vec3::max).unwrap();
        let way = (0.5 * (low + high)).as_dvec3() - transform.translation;
        let cos = transform.transform_vector3(axis).normalize().dot(way.normalize());
        assert!(cos > 0.999, "{arrow}: {cos}");
    }
}

/// A picture of a file as the framing camera shows it, in white light.
fn framed(path: &str) -> Option<Patch> {
    let mut scene: Scene = load_scene(&asset(path)?);
    let mut renderer = Renderer::new();
    assert!(renderer.sync(&mut scene).warnings.is_empty());
    Some(Patch(renderer.render(&settings(SIDE, 64), &()).picture.rgb))
}

/// The same model in several containers and encodings.
#[test]
fn variants_agree() {
    let exact: [&[&str]; 6] = [
        &["Box/glTF/Box.gltf", "Box/glTF-Binary/Box.glb", "Box/glTF-Embedded/Box.gltf"],
        &["BoxTextured/glTF/BoxTextured.gltf", "BoxTextured/glTF-Binary/BoxTextured.glb"],
        &["BoxVertexColors/glTF/BoxVertexColors.gltf", "BoxVertexColors/glTF-Binary/BoxVertexColors.glb"],
        &["Duck/glTF/Duck.gltf", "Duck/glTF-Binary/Duck.glb", "Duck/glTF-Embedded/Duck.gltf"],
        &["Triangle/glTF/Triangle.gltf", "Triangle/glTF-Embedded/Triangle.gltf"],
        &[
            "SimpleSparseAccessor/glTF/SimpleSparseAccessor.gltf",
            "SimpleSparseAccessor/glTF-Embedded/SimpleSparseAccessor.gltf",
        ],
    ];
    for variants in exact {
        let Some(first) = framed(variants[0]) else { return };
        assert!(first.contrast() > 0.01, "{}", variants[0]);
        for other in &variants[1..] {
            let difference = first.difference(&framed(other).unwrap());
            assert!(difference <= 1e-3, "{other}: {difference}");
        }
    }
    for [plain, quantized] in [
        ["Duck/glTF/Duck.gltf", "Duck/glTF-Quantized/Duck.gltf"],
        ["AnimatedMorphCube/glTF/AnimatedMorphCube.gltf", "AnimatedMorphCube/glTF-Quantized/AnimatedMorphCube.gltf"],
    ] {
        let (plain, quantized) = (framed(plain).unwrap(), framed(quantized).unwrap());
        let difference = plain.difference(&quantized);
        println!("quantised: {difference}");
        assert!(difference < 0.01 * plain.mean()[0].max(plain.mean()[1]), "{difference}");
    }
}
