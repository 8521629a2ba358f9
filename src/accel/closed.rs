//! Meshes without boundary, for rays from inside that must hit something.
//!
//! A mesh may stand far from the world's origin, where coordinates are coarse; it is then so large that its shortest edge
//! is 64 units in the last place.

use std::f64::consts::TAU;

/// Where meshes stand.
pub const OFFSETS: [[f64; 3]; 3] = [[0.0; 3], [1000.0, -778.0, 500.0], [1e5, -77_800.0, 50_000.0]];

/// Length of the shortest edge, at least, in units of the last place of the largest coordinate.
pub(super) const SHORTEST: f64 = 64.0;

/// A mesh without boundary.
#[derive(Clone, Debug)]
pub struct Closed {
    /// What it is.
    pub name: &'static str,
    /// Corners; neighbours have the same to the last bit.
    pub triangles: Vec<[[f32; 3]; 3]>,
    /// Middles of boxes that lie deep inside.
    pub(super) hearts: Vec<[f64; 3]>,
    /// Half the edge of these boxes.
    pub(super) room: f64,
}

/// A mesh in double precision.
struct Shape {
    name: &'static str,
    points: Vec<[f64; 3]>,
    triangles: Vec<[usize; 3]>,
    hearts: Vec<[f64; 3]>,
    room: f64,
    /// Each triangle is divided at a point close to the middle of an edge, so that one of the three is nearly a line.
    caps: bool,
}

pub(super) fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(super) fn mix(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
}

fn length(a: [f64; 3]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

pub(super) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    length(std::array::from_fn(|i| b[i] - a[i]))
}

/// An icosahedron whose faces have been divided into four so many times.
fn sphere(times: u32) -> Shape {
    let g = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let unit = |p: [f64; 3]| p.map(|x| x / length(p));
    let mut points: Vec<[f64; 3]> = [1.0, -1.0]
        .into_iter()
        .flat_map(|a| [g, -g].into_iter().flat_map(move |b| [[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]))
        .map(unit)
        .collect();
    // Faces are the triples of points at the edges' length from each other.
    let near = |i: usize, j: usize, points: &[[f64; 3]]| distance(points[i], points[j]) < 1.2;
    let mut triangles = Vec::new();
    for i in 0..12 {
        for j in i + 1..12 {
            for k in j + 1..12 {
                if near(i, j, &points) && near(j, k, &points) && near(i, k, &points) {
                    triangles.push([i, j, k]);
                }
            }
        }
    }
    for _ in 0..times {
        let mut middles = std::collections::HashMap::new();
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(i, j)| {
                    *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                        points.push(unit(add(points[i], points[j])));
                        points.len() - 1
                    })
                });
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Shape { name: "sphere", points, triangles, hearts: vec![[0.0; 3]], room: 0.4, caps: false }
}

/// Radii 1 and 0.4.
fn torus(around: usize, about: usize) -> Shape {
    let share = |i: usize, n: usize| TAU * (i % n) as f64 / n as f64;
    let index = |i: usize, j: usize| i % around * about + j % about;
    let place = |i: usize, j: usize| {
        let (a, b) = (share(i, around), share(j, about));
        let r = 1.0 + 0.4 * b.cos();
        [r * a.cos(), r * a.sin(), 0.4 * b.sin()]
    };
    let cells = || (0..around).flat_map(|i| (0..about).map(move |j| (i, j)));
    let triangles = cells().flat_map(|(i, j)| {
        let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    Shape {
        name: "torus",
        points: cells().map(|(i, j)| place(i, j)).collect(),
        triangles: triangles.collect(),
        hearts: (0..around).map(|i| [share(i, around).cos(), share(i, around).sin(), 0.0]).collect(),
        room: 0.15,
        caps: false,
    }
}

/// The unit cube about the origin, turned, its faces cut into slivers along their borders.
fn slivers() -> Shape {
    let cuts: [f64; 8] = [-0.5, -0.492, -0.484, -0.2, 0.3, 0.484, 0.492, 0.5];
    let last = cuts.len() - 1;
    // Turned about an axis askew, so that nothing is parallel to an axis.
    let rows = [[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]];
    let mut indices = std::collections::HashMap::new();
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for side in [0, last] {
            for (i, j) in (0..last).flat_map(|i| (0..last).map(move |j| (i, j))) {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| {
                    let mut key = [side; 3];
                    key[(axis + 1) % 3] = i;
                    key[(axis + 2) % 3] = j;
                    *indices.entry(key).or_insert_with(|| {
                        let p = key.map(|cut| cuts[cut]);
                        points.push(rows.map(|row: [f64; 3]| (0..3).map(|k| row[k] * p[k]).sum()));
                        points.len() - 1
                    })
                });
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    Shape { name: "slivers", points, triangles, hearts: vec![[0.0; 3]], room: 0.2, caps: false }
}

/// A sphere whose triangles are divided at a point eight units in the last place beside the middle of an edge.
fn caps() -> Shape {
    Shape { name: "caps", caps: true, ..sphere(2) }
}

impl Shape {
    /// Enlarged and rounded to where it stands.
    fn at(self, offset: [f64; 3]) -> Closed {
        let edges = self.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let shortest = edges.map(|(i, j)| distance(self.points[i], self.points[j])).fold(f64::INFINITY, f64::min);
        let shortest = if self.caps { 0.5 * shortest } else { shortest };
        // The largest coordinate grows with the scale; 2 units about the middle are more than any shape has.
        let farthest = offset.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let unit_at = |scale: f64| f64::from(f32::EPSILON) * (farthest + 2.0 * scale);
        let mut scale = 1.0;
        while shortest * scale < 1.1 * SHORTEST * unit_at(scale) {
            scale *= 1.1;
        }
        let place = |p: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| offset[i] + scale * p[i]) };
        let round = |p: [f64; 3]| place(p).map(|x| x as f32);
        let triangles = self.triangles.iter().flat_map(|rows| {
            let [a, b, c] = rows.map(|row| self.points[row]);
            if self.caps {
                let middle = mix(a, b, 0.5);
                let height = 8.0 * unit_at(scale) / scale;
                let tip = mix(middle, c, height / distance(middle, c));
                vec![[a, b, tip].map(round), [b, c, tip].map(round), [c, a, tip].map(round)]
            } else {
                vec![[a, b, c].map(round)]
            }
        });
        Closed {
            name: self.name,
            triangles: triangles.collect(),
            hearts: self.hearts.iter().map(|&heart| place(heart)).collect(),
            room: scale * self.room,
        }
    }
}

impl Closed {
    /// A few hundred triangles, for tests one triangle after the other.
    pub fn small(offset: [f64; 3]) -> Self {
        sphere(2).at(offset)
    }

    /// Sphere, torus, a box with slivers, and a sphere with triangles that are nearly lines.
    pub fn all(offset: [f64; 3]) -> [Self; 4] {
        [sphere(4).at(offset), torus(48, 24).at(offset), slivers().at(offset), caps().at(offset)]
    }
}
