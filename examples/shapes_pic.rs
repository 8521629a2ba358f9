use glam::{DAffine3, DQuat, DVec3, Vec2, Vec3};
use std::sync::Arc;
use wavecast::{film, render::*, world::*};
fn main() {
    let size: u32 = std::env::args().nth(1).map_or(480, |a| a.parse().unwrap());
    let spp: u32 = std::env::args().nth(2).map_or(128, |a| a.parse().unwrap());
    let mut texels = Vec::new();
    for y in 0..16u32 {
        for x in 0..16u32 {
            let on = (x + y) % 2 == 0;
            texels.push(if on { [230, 120 + 8 * x as u8, 60 + 8 * y as u8, 255] } else { [40, 60, 90, 255] });
        }
    }
    let image = Arc::new(Image { name: "c".into(), width: 16, height: 16, texels: Texels::Rgba8(texels) });
    let tex = || Texture { filter: Filter::Nearest, ..Texture::new(Arc::clone(&image)) };
    for shapes in [true, false] {
        let mut scene = Scene::new();
        let mut add = |shape: Shape, m: Material, at: DAffine3| {
            let m = scene.spawn((m,));
            let slots = MaterialSlots::from(m);
            let t = LocalTransform::Matrix(at);
            if shapes {
                scene.spawn((shape, slots, t));
                return;
            }
            let mesh = match shape {
                Shape::Sphere { radius } => TriMesh::sphere(Vec3::ZERO, radius, 256),
                Shape::Plane => TriMesh {
                    uvs: vec![vec![
                        Vec2::new(-40., 40.),
                        Vec2::new(40., 40.),
                        Vec2::new(40., -40.),
                        Vec2::new(-40., -40.),
                    ]],
                    ..TriMesh::quad(Vec3::new(-40., 0., 40.), Vec3::X * 80., Vec3::NEG_Z * 80.)
                },
                Shape::Disc { radius } => {
                    let mut d = TriMesh::disc(Vec3::ZERO, radius, 512);
                    d.uvs = vec![d.positions.iter().map(|p| 0.5 + 0.5 * Vec2::new(p.x, p.z) / radius).collect()];
                    d
                }
                Shape::Cylinder { radius, half_height } => {
                    let n = 512u32;
                    let mut mesh = TriMesh::default();
                    let mut uv = vec![];
                    for i in 0..=n {
                        let phi = std::f64::consts::TAU * f64::from(i % n) / f64::from(n);
                        let nn = Vec3::new(phi.cos() as f32, 0., phi.sin() as f32);
                        for s in [1.0f32, -1.0] {
                            mesh.positions.push(radius * nn + Vec3::Y * s * half_height);
                            mesh.normals.push(nn);
                            uv.push(Vec2::new(i as f32 / n as f32, 0.5 - 0.5 * s));
                        }
                    }
                    mesh.uvs = vec![uv];
                    mesh.triangles =
                        (0..n).flat_map(|i| [[2 * i, 2 * i + 2, 2 * i + 3], [2 * i, 2 * i + 3, 2 * i + 1]]).collect();
                    mesh
                }
            };
            scene.spawn((Geometry(Arc::new(mesh)), slots, t));
        };
        let mv = |x: f64, y: f64, z: f64| DAffine3::from_translation(DVec3::new(x, y, z));
        add(
            Shape::Plane,
            Material {
                base_color_texture: Some(Texture {
                    transform: UvTransform { scale: [0.125, 0.125], ..Default::default() },
                    ..tex()
                }),
                ..Material::lambert(Vec3::splat(0.8))
            },
            DAffine3::IDENTITY,
        );
        add(
            Shape::Sphere { radius: 0.7 },
            Material { base_color_texture: Some(tex()), roughness: 0.3, metallic: 0.0, ..Material::default() },
            mv(-1.3, 0.7, 0.0),
        );
        add(Shape::Sphere { radius: 0.6 }, Material::glass(1.5), mv(0.25, 0.6, 1.0));
        add(
            Shape::Sphere { radius: 0.5 },
            Material { base_color: Vec3::new(1.0, 0.8, 0.4), roughness: 0.15, ..Material::default() },
            DAffine3::from_scale_rotation_translation(
                DVec3::new(1.4, 0.6, 0.8),
                DQuat::from_rotation_z(0.4),
                DVec3::new(1.6, 0.55, 0.9),
            ),
        );
        add(
            Shape::Cylinder { radius: 0.4, half_height: 0.6 },
            Material {
                base_color_texture: Some(tex()),
                double_sided: true,
                roughness: 0.5,
                metallic: 0.0,
                ..Material::default()
            },
            DAffine3::from_rotation_translation(DQuat::from_rotation_x(0.5), DVec3::new(1.0, 0.75, -0.9)),
        );
        add(
            Shape::Disc { radius: 0.6 },
            Material { base_color_texture: Some(tex()), double_sided: true, ..Material::lambert(Vec3::splat(0.8)) },
            DAffine3::from_rotation_translation(DQuat::from_rotation_x(1.1), DVec3::new(-0.2, 0.9, -0.9)),
        );
        add(
            Shape::Sphere { radius: 0.35 },
            Material { emissive: Vec3::new(25.0, 22.0, 18.0), ..Material::lambert(Vec3::ZERO) },
            mv(-0.4, 2.6, 0.8),
        );
        scene.spawn((Environment::constant(Vec3::new(0.12, 0.16, 0.22)),));
        scene.spawn((
            Camera::perspective(0.62),
            LocalTransform::looking_at(DVec3::new(0.2, 1.9, 6.0), DVec3::new(0.1, 0.75, 0.0), DVec3::Y),
        ));
        let mut r = Renderer::new();
        println!("{:?}", r.sync(&mut scene).warnings);
        let start = std::time::Instant::now();
        let out =
            r.render(&RenderSettings { width: size, height: size * 3 / 4, spp: Some(spp), ..Default::default() }, &());
        let mean: f64 = out.picture.rgb.iter().map(|c| f64::from(c[1])).sum::<f64>() / out.picture.rgb.len() as f64;
        println!("{shapes}: {:?} mean {mean:.5} discarded {:?}", start.elapsed(), out.stats.discarded);
        let name = if shapes { "shapes" } else { "meshes" };
        film::write(
            std::path::Path::new(&format!("/tmp/shapes/{name}.png")),
            &out.picture,
            &film::WriteOptions::default(),
        )
        .unwrap();
        film::write(
            std::path::Path::new(&format!("/tmp/shapes/{name}.hdr")),
            &out.picture,
            &film::WriteOptions::default(),
        )
        .unwrap();
    }
}
