//! Photometric and radiometric quantities as types, so that a number that enters the scene wears its unit.
//!
//! Light is carried as linear Rec.709 RGB in photometric units throughout; the
//! one conversion from radiometric units is here.
//!
//! | quantity | photometric | radiometric |
//! |---|---|---|
//! | energy Q | [`LumenSeconds`], lm·s | [`Joules`], J = W·s |
//! | flux Φ = dQ/dt | [`Lumens`], lm | [`Watts`], W |
//! | intensity I = dΦ/dω | [`Candela`], cd = lm/sr | [`WattsPerSteradian`] |
//! | illuminance, irradiance E = dΦ/dA | [`Lux`], lx = lm/m² | [`WattsPerSquareMetre`] |
//! | luminance, radiance L = d²Φ/(dω dA cos θ) | [`Nit`], cd/m² | [`WattsPerSteradianSquareMetre`] |
//!
//! What may be multiplied with and divided by what follows from this, with [`Steradians`], [`SquareMetres`] and [`Seconds`]; all else does
//! not compile. A lamp of 815 lm that shines alike to all sides has 65 cd, and gives as many lux to what faces it at 1 m:
//!
//! ```
//! use wavecast::world::units::{Candela, Lumens, Lux, Steradians};
//!
//! let intensity: Candela = Lumens(815.0) / Steradians::SPHERE;
//! assert_eq!(intensity, Lumens(815.0).over_sphere());
//! assert!((intensity.0 - 64.86).abs() < 0.01);
//! // Inverse square, and the cosine to the normal.
//! assert!((intensity.at_distance(1.0).0 - 64.86).abs() < 0.01);
//! assert!((intensity.at_distance(2.0).0 - 16.21).abs() < 0.01);
//! assert!((intensity.at_distance(1.0).tilted(60_f32.to_radians()).0 - 32.43).abs() < 0.01);
//! ```
//!
//! Lux are not nit, though both come from lumens:
//!
//! ```compile_fail
//! use wavecast::world::units::{Lux, Nit};
//! let sum = Lux(1.0) + Nit(1.0);
//! ```
//!
//! "Intensity 10" says nothing: 10 what? Candela are no lumens,
//!
//! ```compile_fail
//! use wavecast::world::units::{Candela, Lumens};
//! let flux: Lumens = Candela(10.0);
//! ```
//!
//! and become some only over a solid angle:
//!
//! ```
//! use wavecast::world::units::{Candela, Lumens, Steradians};
//! let flux: Lumens = Candela(10.0) * Steradians(2.0);
//! assert_eq!(flux, Lumens(20.0));
//! ```
//!
//! Watts become lumens by the efficacy of light, and in no other way:
//!
//! ```compile_fail
//! use wavecast::world::units::{Lumens, Watts};
//! let flux = Lumens(1.0) + Watts(1.0);
//! ```
//!
//! ```
//! use wavecast::world::units::{Lumens, Watts};
//! assert_eq!(Lumens::from(Watts(2.0)), Lumens(1366.0));
//! ```

use std::ops::{Add, Div, Mul, Sub};

/// Luminous efficacy used to turn watts into lumens, lm/W.
///
/// The value at 555 nm, which is what glTF exporters and Blender use.
pub const LUMENS_PER_WATT: f32 = 683.0;

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name(pub f32);

        impl Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }

        impl Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }

        impl Mul<f32> for $name {
            type Output = Self;
            fn mul(self, times: f32) -> Self {
                Self(self.0 * times)
            }
        }
    };
}

/// `$a * $b = $product`, in both orders, and back by division.
macro_rules! product {
    ($a:ident * $b:ident = $product:ident) => {
        impl Mul<$b> for $a {
            type Output = $product;
            fn mul(self, other: $b) -> $product {
                $product(self.0 * other.0)
            }
        }

        impl Mul<$a> for $b {
            type Output = $product;
            fn mul(self, other: $a) -> $product {
                $product(self.0 * other.0)
            }
        }

        impl Div<$b> for $product {
            type Output = $a;
            fn div(self, other: $b) -> $a {
                $a(self.0 / other.0)
            }
        }
    };
}

unit! {
    /// Luminous intensity, cd = lm/sr.
    Candela
}
unit! {
    /// Illuminance, lx = lm/m².
    Lux
}
unit! {
    /// Luminous flux, lm.
    Lumens
}
unit! {
    /// Luminance, nit = cd/m².
    Nit
}
unit! {
    /// Luminous energy, lm·s.
    LumenSeconds
}
unit! {
    /// Radiant flux, W.
    Watts
}
unit! {
    /// Radiant intensity, W/sr.
    WattsPerSteradian
}
unit! {
    /// Irradiance, W/m².
    WattsPerSquareMetre
}
unit! {
    /// Radiance, W/(sr·m²).
    WattsPerSteradianSquareMetre
}
unit! {
    /// Radiant energy, J.
    Joules
}
unit! {
    /// Solid angle, sr. As the weight of an integral over directions, with the cosine to a surface in it where there is one.
    Steradians
}
unit! {
    /// Area, m².
    SquareMetres
}
unit! {
    /// Time, s.
    Seconds
}
unit! {
    /// Luminous exposure, lx·s: what a film or sensor is given.
    LuxSeconds
}

product!(Candela * Steradians = Lumens);
product!(Lux * SquareMetres = Lumens);
product!(Nit * Steradians = Lux);
product!(Nit * SquareMetres = Candela);
product!(Lumens * Seconds = LumenSeconds);
product!(Lux * Seconds = LuxSeconds);
product!(LuxSeconds * SquareMetres = LumenSeconds);
product!(WattsPerSteradian * Steradians = Watts);
product!(WattsPerSquareMetre * SquareMetres = Watts);
product!(WattsPerSteradianSquareMetre * Steradians = WattsPerSquareMetre);
product!(WattsPerSteradianSquareMetre * SquareMetres = WattsPerSteradian);
product!(Watts * Seconds = Joules);

impl Steradians {
    /// All directions.
    pub const SPHERE: Self = Self(4.0 * std::f32::consts::PI);
    /// Those on one side of a plane.
    pub const HEMISPHERE: Self = Self(2.0 * std::f32::consts::PI);
    /// ∫ cos θ dω over a hemisphere: what turns the luminance of an even sky into illuminance.
    pub const COSINE_HEMISPHERE: Self = Self(std::f32::consts::PI);
}

impl Lumens {
    /// Intensity of a point light that sends this flux evenly over the sphere.
    pub fn over_sphere(self) -> Candela {
        Candela(self.0 / (4.0 * std::f32::consts::PI))
    }

    /// Luminance of a Lambertian emitter of `area` m² and one side that sends this flux.
    pub fn over_area(self, area: f32) -> Nit {
        Nit(self.0 / (std::f32::consts::PI * area))
    }
}

impl Candela {
    /// Illuminance of a plane that faces the light from so many metres away: the inverse square law.
    pub fn at_distance(self, metres: f32) -> Lux {
        Lux(self.0 / (metres * metres))
    }
}

impl Lux {
    /// On a plane that is turned away by an angle, rad: Lambert's cosine law.
    pub fn tilted(self, angle: f32) -> Self {
        Self(self.0 * angle.cos().max(0.0))
    }

    /// Luminance of a matt surface of such an albedo in this light: ρE/π, from every side.
    pub fn off_lambert(self, albedo: f32) -> Nit {
        Nit(self.0 * albedo / std::f32::consts::PI)
    }
}

macro_rules! photometric {
    ($($radiometric:ident => $photometric:ident),+) => {
        $(impl From<$radiometric> for $photometric {
            fn from(radiometric: $radiometric) -> Self {
                Self(radiometric.0 * LUMENS_PER_WATT)
            }
        })+
    };
}

photometric!(
    Watts => Lumens,
    WattsPerSteradian => Candela,
    WattsPerSquareMetre => Lux,
    WattsPerSteradianSquareMetre => Nit,
    Joules => LumenSeconds
);

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;

    /// A source of 4π lm has 1 cd; a watt is 683 lm; a Lambertian square metre of π lm has 1 nit.
    #[test]
    fn flux_turns_into_intensity_and_luminance() {
        assert_eq!(Lumens(4.0 * PI).over_sphere(), Candela(1.0));
        assert_eq!(Lumens::from(Watts(2.0)), Lumens(1366.0));
        assert_eq!(Lumens(PI).over_area(1.0), Nit(1.0));
    }

    /// Each way round a triangle of units comes back to where it began.
    #[test]
    fn units_multiply_and_divide_as_dimensions_do() {
        let flux = Lumens(12.0);
        assert_eq!(flux / Steradians(3.0) * Steradians(3.0), flux);
        assert_eq!(SquareMetres(2.0) * (flux / SquareMetres(2.0)), flux);
        // An even sky of 1 nit gives π lx; a square metre that faces the eye has as many candela as nit.
        assert_eq!(Nit(1.0) * Steradians::COSINE_HEMISPHERE, Lux(PI));
        assert_eq!(Nit(5.0) * SquareMetres(1.0), Candela(5.0));
        assert_eq!(flux * Seconds(2.0) / Seconds(2.0), flux);
        assert_eq!(Lux(4.0) * Seconds(0.5) * SquareMetres(2.0), LumenSeconds(4.0));
        assert_eq!(Candela::from(WattsPerSteradian(1.0)) * Steradians(2.0), Lumens::from(Watts(2.0)));
        assert_eq!(Watts(3.0) * Seconds(2.0), Joules(6.0));
        assert_eq!((Lux(1.0) + Lux(2.0) - Lux(0.5)) * 2.0, Lux(5.0));
        assert!((Lux(PI).off_lambert(0.5).0 - 0.5).abs() < 1e-7);
    }
}
