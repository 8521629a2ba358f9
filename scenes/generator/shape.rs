//! Triangle meshes: counter-clockwise seen from the front, with unit normals.

use glam::{Mat4, Quat, Vec2, Vec3};

/// A mesh with one normal, texture coordinate and (where they make sense) tangent per vertex.
#[derive(Clone, Default)]
pub struct Shape {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// Unit.
    pub normals: Vec<Vec3>,
    /// Unit, along growing u; the bitangent n × t points up in the image.
    pub tangents: Vec<Vec3>,
    /// v downwards, as in glTF.
    pub uvs: Vec<Vec2>,
    /// Rows of the corners.
    pub triangles: Vec<[u32; 3]>,
}

/// One vertex of a turned profile: distance from the axis and height, and the normal there.
type Ring = (Vec2, Vec2);

impl Shape {
    /// The parallelogram `origin`, `+ u`, `+ u + v`, `+ v`, facing `u × v`, its image upright along `v`.
    pub fn quad(origin: Vec3, u: Vec3, v: Vec3) -> Self {
        Self {
            positions: vec![origin, origin + u, origin + u + v, origin + v],
            normals: vec![u.cross(v).normalize(); 4],
            tangents: vec![u.normalize(); 4],
            uvs: vec![Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    /// What an outer parallelogram has around an inner one in its plane, each given as a [`quad`](Self::quad).
    pub fn frame(outer: &Self, inner: &Self) -> Self {
        let positions = outer.positions.iter().chain(&inner.positions).copied().collect();
        let triangles = (0..4u32).flat_map(|i| {
            let j = (i + 1) % 4;
            [[i, j, j + 4], [i, j + 4, i + 4]]
        });
        Self { positions, triangles: triangles.collect(), normals: vec![outer.normals[0]; 8], ..Self::default() }
    }

    /// m².
    pub fn area(&self) -> f64 {
        let corners = |triangle: &[u32; 3]| triangle.map(|i| self.positions[i as usize].as_dvec3());
        self.triangles.iter().map(corners).map(|[p, q, r]| (q - p).cross(r - p).length() / 2.0).sum()
    }

    /// A box whose six faces look outwards; textures cover a metre per unit.
    pub fn cuboid(min: Vec3, max: Vec3) -> Self {
        let d = max - min;
        let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
        let faces =
            [(min + z, x, y), (max - y, -z, y), (max - y - z, -x, y), (min, z, y), (max - x, x, -z), (min, x, z)];
        let mut shape = Self::default();
        for (origin, u, v) in faces {
            let mut face = Self::quad(origin, u, v);
            face.uvs.iter_mut().for_each(|uv| *uv *= Vec2::new(u.length(), v.length()));
            shape.append(&face);
        }
        shape
    }

    /// A box by its centre and size.
    pub fn block(center: Vec3, size: Vec3) -> Self {
        Self::cuboid(center - size / 2.0, center + size / 2.0)
    }

    /// A sphere about the origin with exact normals, `2·rings` segments around.
    pub fn sphere(radius: f32, rings: u32) -> Self {
        let ring = |i| {
            let (sin, cos) = angle(i, 2 * rings);
            let n = if i == 0 || i == rings { Vec2::new(0.0, -cos) } else { Vec2::new(sin, -cos) };
            (n * radius, n)
        };
        Self::turned(&(0..=rings).map(ring).collect::<Vec<_>>(), 2 * rings)
    }

    /// A ring of mean radius `radius` about the Y axis, `tube` thick to each side.
    pub fn torus(radius: f32, tube: f32, around: u32, across: u32) -> Self {
        let ring = |i| {
            let (sin, cos) = angle(i, across);
            let n = Vec2::new(cos, sin);
            (Vec2::new(radius, 0.0) + n * tube, n)
        };
        Self::turned(&(0..=across).map(ring).collect::<Vec<_>>(), around)
    }

    /// The surface that a profile `[distance, height]` sweeps about the Y axis; upwards is outwards.
    ///
    /// A point given twice is a crease; all others are smooth.
    pub fn lathe(profile: &[[f32; 2]], segments: u32) -> Self {
        let points: Vec<Vec2> = profile.iter().map(|&p| Vec2::from(p)).collect();
        let outwards = |from: Vec2, to: Vec2| Vec2::new(to.y - from.y, from.x - to.x).normalize_or_zero();
        let ring = |(i, &p): (usize, &Vec2)| {
            let before = if i == 0 { Vec2::ZERO } else { outwards(points[i - 1], p) };
            let after = points.get(i + 1).map_or(Vec2::ZERO, |&next| outwards(p, next));
            let mut n = (before + after).normalize();
            // On the axis a smooth surface is level.
            if p.x == 0.0 && n.y.abs() > 0.9 {
                n = Vec2::new(0.0, n.y.signum());
            }
            (p, n)
        };
        Self::turned(&points.iter().enumerate().map(ring).collect::<Vec<_>>(), segments)
    }

    /// An upright cylinder on y = 0, closed above and below.
    pub fn cylinder(radius: f32, height: f32, segments: u32) -> Self {
        Self::frustum(radius, radius, height, segments)
    }

    /// A cylinder that narrows (or widens) to `top`; `top` 0 is a cone.
    pub fn frustum(bottom: f32, top: f32, height: f32, segments: u32) -> Self {
        let mut profile = vec![[0.0, 0.0], [bottom, 0.0], [bottom, 0.0], [top, height]];
        if top > 0.0 {
            profile.extend([[top, height], [0.0, height]]);
        }
        Self::lathe(&profile, segments)
    }

    fn turned(rings: &[Ring], segments: u32) -> Self {
        let mut shape = Self::default();
        for (i, &(p, n)) in rings.iter().enumerate() {
            for j in 0..=segments {
                let (sin, cos) = angle(j, segments);
                shape.positions.push(Vec3::new(p.x * sin, p.y, p.x * cos));
                shape.normals.push(Vec3::new(n.x * sin, n.y, n.x * cos).normalize());
                shape.tangents.push(Vec3::new(cos, 0.0, -sin));
                let v = 1.0 - i as f32 / (rings.len() - 1) as f32;
                shape.uvs.push(Vec2::new(j as f32 / segments as f32, v));
            }
        }
        for (i, pair) in (0u32..).zip(rings.windows(2)) {
            let [(low, _), (high, _)] = [pair[0], pair[1]];
            if low == high {
                continue;
            }
            for j in 0..segments {
                let a = i * (segments + 1) + j;
                let (b, c, d) = (a + 1, a + segments + 2, a + segments + 1);
                if low.x > 0.0 {
                    shape.triangles.push([a, b, c]);
                }
                if high.x > 0.0 {
                    shape.triangles.push([a, c, d]);
                }
            }
        }
        shape.used()
    }

    /// An icosahedron divided `levels` times, its vertices moved to `radius(direction)`, smooth.
    pub fn blob(levels: u32, radius: impl Fn(Vec3) -> f32) -> Self {
        let g = (1.0 + 5f32.sqrt()) / 2.0;
        let corners = [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)];
        let mut points: Vec<Vec3> = corners.map(|(a, b)| Vec3::new(a, b, 0.0)).to_vec();
        points.extend(corners.map(|(a, b)| Vec3::new(0.0, a, b)));
        points.extend(corners.map(|(a, b)| Vec3::new(b, 0.0, a)));
        points.iter_mut().for_each(|p| *p = p.normalize());
        let mut triangles: Vec<[u32; 3]> = vec![
            [0, 11, 5],
            [0, 5, 1],
            [0, 1, 7],
            [0, 7, 10],
            [0, 10, 11],
            [1, 5, 9],
            [5, 11, 4],
            [11, 10, 2],
            [10, 7, 6],
            [7, 1, 8],
            [3, 9, 4],
            [3, 4, 2],
            [3, 2, 6],
            [3, 6, 8],
            [3, 8, 9],
            [4, 9, 5],
            [2, 4, 11],
            [6, 2, 10],
            [8, 6, 7],
            [9, 8, 1],
        ];
        for _ in 0..levels {
            let mut middles = std::collections::BTreeMap::new();
            let mut finer = Vec::new();
            for [a, b, c] in triangles {
                let mut middle = |i: u32, j: u32| {
                    *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                        points.push((points[i as usize] + points[j as usize]).normalize());
                        points.len() as u32 - 1
                    })
                };
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            triangles = finer;
        }
        let positions = points.iter().map(|&p| p * radius(p)).collect();
        Self { positions, triangles, ..Self::default() }.smooth()
    }

    /// Heights over the square of `size` m about the origin, `cells` to a side, smooth.
    pub fn terrain(size: f32, cells: u32, height: impl Fn(f32, f32) -> f32) -> Self {
        let mut shape = Self::default();
        let at = |i: u32| (i as f32 / cells as f32 - 0.5) * size;
        for row in 0..=cells {
            for column in 0..=cells {
                let (x, z) = (at(column), at(row));
                shape.positions.push(Vec3::new(x, height(x, z), z));
            }
        }
        for row in 0..cells {
            for column in 0..cells {
                let a = row * (cells + 1) + column;
                let (b, c, d) = (a + 1, a + cells + 2, a + cells + 1);
                shape.triangles.extend([[a, d, c], [a, c, b]]);
            }
        }
        shape.smooth()
    }

    /// With normals that average the triangles around each vertex, by area.
    pub fn smooth(mut self) -> Self {
        self.normals = vec![Vec3::ZERO; self.positions.len()];
        for &[a, b, c] in &self.triangles {
            let [p, q, r] = [a, b, c].map(|i| self.positions[i as usize]);
            for i in [a, b, c] {
                self.normals[i as usize] += (q - p).cross(r - p);
            }
        }
        self.normals.iter_mut().for_each(|n| *n = n.normalize());
        self
    }

    /// With flat triangles that share no vertex, and neither texture coordinates nor tangents.
    pub fn faceted(&self) -> Self {
        let mut shape = Self::default();
        for triangle in &self.triangles {
            let [p, q, r] = triangle.map(|i| self.positions[i as usize]);
            let first = shape.positions.len() as u32;
            shape.positions.extend([p, q, r]);
            shape.normals.extend([(q - p).cross(r - p).normalize(); 3]);
            shape.triangles.push([first, first + 1, first + 2]);
        }
        shape
    }

    /// Adds the triangles of another shape that carries the same attributes.
    pub fn append(&mut self, other: &Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.normals.extend(&other.normals);
        self.tangents.extend(&other.tangents);
        self.uvs.extend(&other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
    }

    /// This shape and another as one.
    pub fn with(mut self, other: Self) -> Self {
        self.append(&other);
        self
    }

    /// The shapes as one.
    pub fn joined(shapes: impl IntoIterator<Item = Self>) -> Self {
        shapes.into_iter().fold(Self::default(), Self::with)
    }

    /// Moved.
    pub fn at(self, x: f32, y: f32, z: f32) -> Self {
        self.placed(Quat::IDENTITY, Vec3::new(x, y, z))
    }

    /// Turned about the origin, then moved.
    pub fn placed(mut self, rotation: Quat, offset: Vec3) -> Self {
        let matrix = Mat4::from_rotation_translation(rotation, offset);
        self.positions.iter_mut().for_each(|p| *p = matrix.transform_point3(*p));
        for v in self.normals.iter_mut().chain(&mut self.tangents) {
            *v = matrix.transform_vector3(*v).normalize();
        }
        self
    }

    /// The same triangles seen from the other side.
    pub fn inside_out(mut self) -> Self {
        self.normals.iter_mut().for_each(|n| *n = -*n);
        self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// Without vertices that no triangle uses.
    fn used(mut self) -> Self {
        let mut rows = vec![u32::MAX; self.positions.len()];
        let mut kept = Vec::new();
        for index in self.triangles.iter_mut().flatten() {
            let row = &mut rows[*index as usize];
            if *row == u32::MAX {
                *row = kept.len() as u32;
                kept.push(*index as usize);
            }
            *index = *row;
        }
        self.positions = kept.iter().map(|&i| self.positions[i]).collect();
        self.normals = kept.iter().map(|&i| self.normals[i]).collect();
        self.tangents = kept.iter().map(|&i| self.tangents[i]).collect();
        self.uvs = kept.iter().map(|&i| self.uvs[i]).collect();
        self
    }
}

/// Sine and cosine of the `i`-th of `n` steps around a circle; the last step is exactly the first.
fn angle(i: u32, n: u32) -> (f32, f32) {
    let (sin, cos) = (std::f64::consts::TAU * f64::from(i % n) / f64::from(n)).sin_cos();
    (sin as f32, cos as f32)
}
