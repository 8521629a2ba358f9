//! Cut-outs and partial coverage: leaves, cloth, a paper rosette and mist.

use glam::{Quat, Vec3, vec3};

use super::{
    document::{Attributes, Document, Place},
    gallery::facing,
    images,
    material::Material,
    noise::Draws,
    shape::Shape,
};

/// A potted plant of masked leaves before a wall, a woven screen, blended rosettes and mist.
pub fn scene() -> Document {
    let mut scene = Document::default();
    let floor = scene.material(Material::dielectric("floor", [0.50, 0.46, 0.41], 0.5));
    let wall = scene.material(Material::lambert("wall", [0.76, 0.73, 0.68]));
    scene.show("floor", &Shape::quad(vec3(-5.0, 0.0, 4.0), Vec3::X * 10.0, Vec3::NEG_Z * 5.5), floor);
    scene.show("wall", &Shape::quad(vec3(-5.0, 0.0, -1.5), Vec3::X * 10.0, Vec3::Y * 5.0), wall);
    plant(&mut scene);

    let weave = scene.texture("weave", &images::weave());
    let cloth = Material::lambert("cloth", [0.85, 0.55, 0.30]).textured(weave, [14.0, 20.0]).masked(0.5).double_sided();
    let cloth = scene.material(cloth);
    let sheet = Shape::quad(vec3(-0.55, 0.0, 0.0), Vec3::X * 1.1, Vec3::Y * 1.6);
    let turn = Quat::from_rotation_y(-32f32.to_radians());
    scene.show_with("woven screen", &sheet.placed(turn, vec3(1.55, 0.08, -0.35)), Attributes::Textured, cloth);
    let oak = scene.material(Material::dielectric("oak", [0.30, 0.17, 0.085], 0.45));
    let bar = |x: f32, y: f32, w: f32, h: f32| Shape::block(vec3(x, y, 0.0), vec3(w, h, 0.045));
    let frame = [
        bar(-0.575, 0.86, 0.05, 1.72),
        bar(0.575, 0.86, 0.05, 1.72),
        bar(0.0, 0.055, 1.1, 0.05),
        bar(0.0, 1.695, 1.1, 0.05),
    ];
    scene.show("screen frame", &Shape::joined(frame).placed(turn, vec3(1.55, 0.0, -0.35)), oak);

    let rosette = scene.clamped_texture("rosette", &images::rosette());
    let sharp = Material::lambert("cut paper", [1.0; 3]).textured(rosette, [1.0, 1.0]).masked(0.5).double_sided();
    let sheer = Material::lambert("sheer paper", [1.0; 3]).textured(rosette, [1.0, 1.0]).blended(0.6).double_sided();
    let [sharp, sheer] = [sharp, sheer].map(|material| scene.material(material));
    let disc = scene.shape(&Shape::quad(vec3(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y), Attributes::Textured);
    for (name, material, size, at, degrees) in [
        ("cut rosette", sharp, 0.85, vec3(-1.95, 1.95, -0.9), 14.0),
        ("sheer rosette", sheer, 0.7, vec3(-1.35, 1.15, -0.3), -12.0),
    ] {
        let mesh = scene.mesh(name, &[(&disc, material)]);
        let place = Place { translation: at, scale: Vec3::splat(size), ..Place::ORIGIN };
        scene.place(name, mesh, place.turned(degrees));
    }

    let mist = scene.clamped_texture("mist", &images::mist());
    let mist = Material::lambert("mist", [0.86, 0.90, 0.95]).textured(mist, [1.0, 1.0]).blended(0.75).double_sided();
    let mist = scene.material(mist);
    let layer = Shape::quad(vec3(-0.8, 0.0, 0.0), Vec3::X * 1.6, Vec3::Y * 0.75);
    let layers = [[-2.1, -0.55, 10.0], [-1.95, -0.25, 4.0], [-2.2, 0.05, -3.0]];
    for (i, [x, z, degrees]) in layers.into_iter().enumerate() {
        let layer = layer.clone().placed(Quat::from_rotation_y(f32::to_radians(degrees)), vec3(x, 0.001, z));
        scene.show_with(&format!("mist {i}"), &layer, Attributes::Textured, mist);
    }
    let red = scene.material(Material::dielectric("red ball", [0.58, 0.06, 0.05], 0.2));
    scene.show("ball in mist", &Shape::sphere(0.3, 32).at(-2.05, 0.3, -0.4), red);
    let steel = scene.material(Material::metal("steel", [0.6, 0.6, 0.62], 0.12));
    scene.show("ball behind cloth", &Shape::sphere(0.36, 32).at(1.55, 0.36, -0.95), steel);

    let key = scene.material(Material::emitter("key light", [1.0, 0.95, 0.87], 5.5));
    scene.show("key light", &facing(vec3(-3.4, 4.6, 4.2), vec3(0.0, 1.0, 0.0), 2.6, 1.8), key);
    let sun = Place::looking(vec3(4.2, 4.6, 5.2), vec3(0.0, 1.0, -0.8));
    scene.spot_light("sun", [1.0, 0.80, 0.55], 190.0, [16.0, 27.0], sun);
    scene.camera("camera", 32.0, 3.0 / 2.0, Place::looking(vec3(-0.25, 1.75, 6.0), vec3(-0.2, 1.12, -0.5)));
    scene
}

/// A stem that carries leaves in a spiral, in a pot.
fn plant(scene: &mut Document) {
    let clay = scene.material(Material::dielectric("clay", [0.42, 0.18, 0.10], 0.65));
    let earth = scene.material(Material::lambert("earth", [0.07, 0.05, 0.035]));
    let bark = scene.material(Material::dielectric("bark", [0.16, 0.19, 0.07], 0.7));
    let pot = [
        [0.0, 0.0],
        [0.2, 0.0],
        [0.2, 0.0],
        [0.29, 0.36],
        [0.29, 0.36],
        [0.325, 0.36],
        [0.325, 0.36],
        [0.335, 0.44],
        [0.335, 0.44],
        [0.29, 0.44],
        [0.29, 0.44],
        [0.285, 0.38],
    ];
    scene.show("pot", &Shape::lathe(&pot, 48), clay);
    scene.show("earth", &Shape::lathe(&[[0.286, 0.4], [0.0, 0.41]], 32), earth);

    let leaf = scene.clamped_texture("leaf", &images::leaf());
    let material = Material::dielectric("leaf", [1.0; 3], 0.45).textured(leaf, [1.0, 1.0]).masked(0.5).double_sided();
    let material = scene.material(material);
    // Bent along its length and hollow across: two quads wide, four long, its stem at the origin, growing along +Y.
    let (columns, rows) = (2u32, 4u32);
    let mut blade = Shape::default();
    for i in 0..=rows {
        for j in 0..=columns {
            let (u, t) = (j as f32 / columns as f32, i as f32 / rows as f32);
            let x = (u - 0.5) * 0.6;
            blade.positions.push(vec3(x, t * (1.0 - 0.12 * t), 0.28 * x.abs() - 0.38 * t * t));
            blade.uvs.push(glam::vec2(u, 1.0 - t));
        }
    }
    for i in 0..rows {
        for j in 0..columns {
            let a = i * (columns + 1) + j;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            blade.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let shape = scene.shape(&blade.smooth(), Attributes::Textured);
    let mesh = scene.mesh("leaf", &[(&shape, material)]);
    let mut draws = Draws::new(11);
    let mut stems = Shape::default();
    let mut leaves = Vec::new();
    let stalks = [[0.0, 0.0, 1.75], [0.10, 0.05, 1.35], [-0.09, 0.06, 1.45], [0.02, -0.11, 1.15], [0.05, 0.12, 0.9]];
    for [x, z, height] in stalks {
        let lean = vec3(x * 2.2, height, z * 2.2);
        let rotation = Quat::from_rotation_arc(Vec3::Y, lean.normalize());
        let foot = vec3(x, 0.4, z);
        stems.append(&Shape::frustum(0.016, 0.006, lean.length(), 10).placed(rotation, foot));
        let count = (height * 13.0) as u32;
        for k in 0..count {
            let t = 0.22 + 0.78 * (k as f32 + 0.5) / count as f32;
            let around = k as f32 * 2.399_963 + x * 40.0;
            let lift = (84.0 - 40.0 * t + draws.between(-9.0, 9.0)).to_radians();
            let rotation = Quat::from_rotation_y(around) * Quat::from_rotation_x(lift);
            let size = (0.52 - 0.22 * t) * draws.between(0.85, 1.15);
            // Every other leaf is the mirror image of its neighbour.
            let scale = vec3(if k % 2 == 0 { size } else { -size }, size, size);
            leaves.push(scene.child(
                &format!("leaf {}", leaves.len()),
                mesh,
                Place { translation: foot + lean * t, rotation, scale },
            ));
        }
    }
    scene.show("stems", &stems, bark);
    scene.group("leaves", Place::ORIGIN, &leaves);
}
