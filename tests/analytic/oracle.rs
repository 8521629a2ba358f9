//! The formulas, in f64 and apart from both renderers.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use wavecast::world::TriMesh;

/// Exactly what the f32 vector says.
pub fn exact(v: Vec3) -> DVec3 {
    v.as_dvec3()
}

/// Corners of a mesh's triangles.
pub fn corners(mesh: &TriMesh) -> Vec<[DVec3; 3]> {
    mesh.triangles.iter().map(|t| t.map(|i| exact(mesh.positions[i as usize]))).collect()
}

/// Surface of a mesh, m².
pub fn area(mesh: &TriMesh) -> f64 {
    corners(mesh).iter().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
}

/// The part of a polygon above the plane through `p` with normal `n` (Sutherland, Hodgman 1974).
fn above(p: DVec3, n: DVec3, polygon: &[DVec3]) -> Vec<DVec3> {
    let mut kept = Vec::new();
    for (i, &a) in polygon.iter().enumerate() {
        let b = polygon[(i + 1) % polygon.len()];
        let (da, db) = ((a - p).dot(n), (b - p).dot(n));
        if da >= 0.0 {
            kept.push(a);
        }
        if da * db < 0.0 {
            kept.push(a + (b - a) * (da / (da - db)));
        }
    }
    kept
}

/// Irradiance at `p` per radiance of a polygon, sr; the part below the horizon does not count.
///
/// Lambert 1760, "Photometria"; Arvo 1994, "The Irradiance Jacobian for Partially Occluded Polyhedral Sources", eq. 2.
pub fn polygon_irradiance(p: DVec3, n: DVec3, polygon: &[DVec3]) -> f64 {
    let rays: Vec<DVec3> = above(p, n, polygon).iter().map(|v| (v - p).normalize()).collect();
    let edge = |i: usize| {
        let (a, b) = (rays[i], rays[(i + 1) % rays.len()]);
        let cross = a.cross(b);
        let sin = cross.length();
        if sin < 1e-14 { 0.0 } else { sin.atan2(a.dot(b)) * cross.dot(n) / sin }
    };
    (0.5 * (0..rays.len()).map(edge).sum::<f64>()).abs()
}

/// Irradiance at `p` per radiance of the fronts of convex meshes, sr.
pub fn mesh_irradiance(p: DVec3, n: DVec3, mesh: &TriMesh) -> f64 {
    let faces = |[a, b, c]: &[DVec3; 3]| (b - a).cross(c - a).dot(p - a) > 0.0;
    corners(mesh).iter().filter(|t| faces(t)).map(|t| polygon_irradiance(p, n, t)).sum()
}

/// ∫ f(ω) dω over directions about +Y, by midpoints in azimuth and in the squared sine; `f` has its cosine left out
/// because dω cosθ = dφ d(sin²θ) / 2.
pub fn over_hemisphere(f: impl Fn(DVec3) -> f64) -> f64 {
    const AROUND: u32 = 1000;
    const UP: u32 = 2000;
    let mut sum = 0.0;
    for i in 0..UP {
        let sin2 = (f64::from(i) + 0.5) / f64::from(UP);
        let (sin, cos) = (sin2.sqrt(), (1.0 - sin2).sqrt());
        for j in 0..AROUND {
            let phi = TAU * (f64::from(j) + 0.5) / f64::from(AROUND);
            sum += f(DVec3::new(sin * phi.cos(), cos, sin * phi.sin()));
        }
    }
    sum * PI / f64::from(UP * AROUND)
}

/// ∫ f(point) dA over a parallelogram, by midpoints.
pub fn over_quad(origin: DVec3, u: DVec3, v: DVec3, f: impl Fn(DVec3) -> f64) -> f64 {
    const STEPS: u32 = 1500;
    let mut sum = 0.0;
    for i in 0..STEPS {
        for j in 0..STEPS {
            let [s, t] = [i, j].map(|k| (f64::from(k) + 0.5) / f64::from(STEPS));
            sum += f(origin + s * u + t * v);
        }
    }
    sum * u.cross(v).length() / f64::from(STEPS * STEPS)
}

/// Unpolarised Fresnel reflectance from index 1 to index `eta` by the angles of Snell's law.
pub fn fresnel(eta: f64, cos: f64) -> f64 {
    let sin_t = (1.0 - cos * cos).sqrt() / eta;
    if sin_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin_t * sin_t).sqrt();
    let s = (cos - eta * cos_t) / (cos + eta * cos_t);
    let p = (cos_t - eta * cos) / (cos_t + eta * cos);
    0.5 * (s * s + p * p)
}

/// Schlick's reflectance with f90 = 1.
pub fn schlick(f0: f64, cos: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - cos).powi(5)
}

/// GGX on the plane with normal +Y.
#[derive(Clone, Copy)]
pub struct Ggx(pub f64);

impl Ggx {
    /// Density of facet normals (glTF 2.0, appendix B.3.2).
    pub fn d(self, h: DVec3) -> f64 {
        let a2 = self.0 * self.0;
        a2 / (PI * (h.y * h.y * (a2 - 1.0) + 1.0).powi(2))
    }

    /// Height-correlated masking and shadowing (Heitz 2014, eq. 99).
    pub fn g(self, a: DVec3, b: DVec3) -> f64 {
        let lambda = |w: DVec3| 0.5 * ((1.0 + self.0 * self.0 * (1.0 / (w.y * w.y) - 1.0)).sqrt() - 1.0);
        1.0 / (1.0 + lambda(a) + lambda(b))
    }

    /// D·G / (4 |n·wo| |n·wi|) for reflection.
    pub fn dv(self, wo: DVec3, wi: DVec3) -> f64 {
        self.d((wo + wi).normalize()) * self.g(wo, wi) / (4.0 * (wo.y * wi.y).abs())
    }
}

/// sRGB to linear (IEC 61966-2-1).
pub fn srgb(byte: u8) -> f64 {
    let c = f64::from(byte) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Where a ray first meets a mesh: the point, and the normal towards the ray's start.
pub fn meet(mesh: &TriMesh, origin: DVec3, direction: DVec3) -> (DVec3, DVec3) {
    let mut nearest = (f64::INFINITY, DVec3::ZERO);
    for [a, b, c] in corners(mesh) {
        let n = (b - a).cross(c - a);
        let t = (a - origin).dot(n) / direction.dot(n);
        let q = origin + t * direction;
        let within = [(a, b), (b, c), (c, a)].iter().all(|(s, e)| (e - s).cross(q - s).dot(n) >= 0.0);
        if t > 0.0 && t < nearest.0 && within {
            nearest = (t, n.normalize() * -n.dot(direction).signum());
        }
    }
    (origin + nearest.0 * direction, nearest.1)
}

/// A disc of radius r at height h, faced by the plane below its centre: E = π r² / (r² + h²). A square of side 2 at
/// height 1: the form factor of Howell's catalogue, C-11, four times. A hemisphere: π.
#[test]
fn polygon_irradiance_agrees_with_the_catalogue() {
    let disc: Vec<DVec3> =
        (0..20_000).map(|i| TAU * f64::from(i) / 20_000.0).map(|a| DVec3::new(a.cos(), 2.0, a.sin())).collect();
    let got = polygon_irradiance(DVec3::ZERO, DVec3::Y, &disc);
    assert!((got / (PI / 5.0) - 1.0).abs() < 1e-6, "{got}");
    let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, z)| DVec3::new(x, 1.0, z));
    let root = 2f64.sqrt();
    let corner = (1.0 / root) * (1.0 / root).atan() * 2.0 / TAU;
    let got = polygon_irradiance(DVec3::ZERO, DVec3::Y, &square);
    assert!((got / (4.0 * PI * corner) - 1.0).abs() < 1e-12, "{got}");
    // A wall that goes on below the floor counts as one that ends there.
    let wall = |foot: f64| [(foot, -1.0), (foot, 1.0), (3.0, 1.0), (3.0, -1.0)].map(|(y, z)| DVec3::new(1.0, y, z));
    let [cut, whole] = [0.0, -5.0].map(|foot| polygon_irradiance(DVec3::ZERO, DVec3::Y, &wall(foot)));
    assert!((cut / whole - 1.0).abs() < 1e-12, "{cut} {whole}");
}

/// The hemisphere has the projected solid angle π; D of GGX times the cosine is 1 over it.
#[test]
fn quadratures_know_the_hemisphere() {
    assert!((over_hemisphere(|_| 1.0) / PI - 1.0).abs() < 1e-12);
    assert!((over_hemisphere(|w| Ggx(0.25).d(w)) - 1.0).abs() < 1e-4);
    assert!((over_quad(DVec3::ZERO, DVec3::X, 2.0 * DVec3::Z, |q| q.x * q.z) - 1.0).abs() < 1e-12);
}
