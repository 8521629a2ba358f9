//! Photometric quantities as types, so that a number that enters the scene wears its unit.
//!
//! Light is carried as linear Rec.709 RGB in photometric units throughout; the
//! one conversion from radiometric units is here.

/// Luminous efficacy used to turn watts into lumens, lm/W.
///
/// The value at 555 nm, which is what glTF exporters and Blender use.
pub const LUMENS_PER_WATT: f32 = 683.0;

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name(pub f32);
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
    /// Radiant flux, W.
    Watts
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

impl From<Watts> for Lumens {
    fn from(watts: Watts) -> Self {
        Self(watts.0 * LUMENS_PER_WATT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A source of 4π lm has 1 cd; a watt is 683 lm; a Lambertian square metre of π lm has 1 nit.
    #[test]
    fn flux_turns_into_intensity_and_luminance() {
        assert_eq!(Lumens(4.0 * std::f32::consts::PI).over_sphere(), Candela(1.0));
        assert_eq!(Lumens::from(Watts(2.0)), Lumens(1366.0));
        assert_eq!(Lumens(std::f32::consts::PI).over_area(1.0), Nit(1.0));
    }
}
