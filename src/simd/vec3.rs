//! Vectors and colours of lanes.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::Real;

/// Three numbers per lane: a point, a direction or a colour.
#[derive(Clone, Copy, Debug)]
pub struct V3<F> {
    /// First.
    pub x: F,
    /// Second.
    pub y: F,
    /// Third.
    pub z: F,
}

/// A colour: x, y, z are red, green, blue.
pub type Rgb<F> = V3<F>;

impl<F: Real> V3<F> {
    /// From components.
    #[inline(always)]
    pub fn new(x: F, y: F, z: F) -> Self {
        Self { x, y, z }
    }
    /// The same in all components and lanes.
    #[inline(always)]
    pub fn splat(value: f32) -> Self {
        Self::all(F::splat(value))
    }
    /// The same in all components.
    #[inline(always)]
    pub fn all(value: F) -> Self {
        Self::new(value, value, value)
    }
    /// The same vector in all lanes.
    #[inline(always)]
    pub fn from_array(v: [f32; 3]) -> Self {
        Self::new(F::splat(v[0]), F::splat(v[1]), F::splat(v[2]))
    }
    /// Lane `i` from `f(i)`.
    #[inline(always)]
    pub fn from_fn(mut f: impl FnMut(usize) -> [f32; 3]) -> Self {
        let [x, y, z, _] = F::columns_of_four(|lane| {
            let [x, y, z] = f(lane);
            [x, y, z, 0.0]
        });
        Self::new(x, y, z)
    }
    /// From columns, at a slice start.
    #[inline(always)]
    pub fn load(x: &[f32], y: &[f32], z: &[f32]) -> Self {
        Self::new(F::load(x), F::load(y), F::load(z))
    }
    /// The vector in lane `i`.
    #[inline(always)]
    pub fn lane(self, i: usize) -> [f32; 3] {
        [self.x.lane(i), self.y.lane(i), self.z.lane(i)]
    }
    /// Inner product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> F {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }
    /// Vector product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self::new(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }
    /// Squared length.
    #[inline(always)]
    pub fn length_squared(self) -> F {
        self.dot(self)
    }
    /// Of unit length; not finite for a zero vector.
    #[inline(always)]
    pub fn normalize(self) -> Self {
        self * (F::one() / self.length_squared().sqrt())
    }
    /// Component by component.
    #[inline(always)]
    pub fn map(self, f: impl Fn(F) -> F) -> Self {
        Self::new(f(self.x), f(self.y), f(self.z))
    }
    /// Component by component, of two.
    #[inline(always)]
    pub fn zip(self, o: Self, f: impl Fn(F, F) -> F) -> Self {
        Self::new(f(self.x, o.x), f(self.y, o.y), f(self.z, o.z))
    }
    /// `self · s + o`.
    #[inline(always)]
    pub fn scale_add(self, s: F, o: Self) -> Self {
        Self::new(self.x.mul_add(s, o.x), self.y.mul_add(s, o.y), self.z.mul_add(s, o.z))
    }
    /// `yes` where `mask` holds, `no` elsewhere.
    #[inline(always)]
    pub fn select(mask: F::Mask, yes: Self, no: Self) -> Self {
        yes.zip(no, |yes, no| F::select(mask, yes, no))
    }
    /// `self` where `mask` holds, 0 elsewhere.
    #[inline(always)]
    pub fn masked(self, mask: F::Mask) -> Self {
        self.map(|v| v.masked(mask))
    }
    /// The largest component.
    #[inline(always)]
    pub fn max_element(self) -> F {
        self.x.max(self.y).max(self.z)
    }
    /// Magnitudes of the components.
    #[inline(always)]
    pub fn abs(self) -> Self {
        self.map(F::abs)
    }
    /// Luminance of a linear Rec.709 colour.
    #[inline(always)]
    pub fn luminance(self) -> F {
        self.x.mul_add(F::splat(0.212_671), self.y.mul_add(F::splat(0.715_160), self.z * F::splat(0.072_169)))
    }
}

impl<F: Real> Add for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(o, |a, b| a + b)
    }
}

impl<F: Real> Sub for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(o, |a, b| a - b)
    }
}

impl<F: Real> Mul for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(o, |a, b| a * b)
    }
}

impl<F: Real> Mul<F> for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: F) -> Self {
        self.map(|v| v * s)
    }
}

impl<F: Real> Div<F> for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn div(self, s: F) -> Self {
        self * (F::one() / s)
    }
}

impl<F: Real> Neg for V3<F> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|v| -v)
    }
}

/// A right-handed orthonormal frame whose z axis is a normal.
#[derive(Clone, Copy, Debug)]
pub struct Frame<F> {
    /// Tangent.
    pub s: V3<F>,
    /// Bitangent.
    pub t: V3<F>,
    /// Normal.
    pub n: V3<F>,
}

impl<F: Real> Frame<F> {
    /// About a unit normal (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    #[inline(always)]
    pub fn new(n: V3<F>) -> Self {
        let sign = F::one().copysign(n.z);
        let a = -F::one() / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            s: V3::new(F::one() + sign * n.x * n.x * a, sign * b, -sign * n.x),
            t: V3::new(b, sign + n.y * n.y * a, -n.y),
            n,
        }
    }
    /// From world to this frame.
    #[inline(always)]
    pub fn to_local(&self, v: V3<F>) -> V3<F> {
        V3::new(v.dot(self.s), v.dot(self.t), v.dot(self.n))
    }
    /// From this frame to world.
    #[inline(always)]
    pub fn to_world(&self, v: V3<F>) -> V3<F> {
        self.s.scale_add(v.x, self.t.scale_add(v.y, self.n * v.z))
    }
}
