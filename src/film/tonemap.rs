//! From scene light to display light: exposure, tone curves and the sRGB transfer function.
//!
//! In flows radiance in nit, out flow numbers in [0, 1] for a display. Nothing
//! else in the program exposes or tone-maps.

use std::str::FromStr;

use super::Picture;

/// How much light is white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Exposure {
    /// Radiance times 2^stops; with 0 stops a nit is 1.
    Stops(f32),
    /// Exposure value at ISO 100: radiance over 1.2 · 2^EV (saturation-based sensitivity;
    /// Lagarde and de Rousiers 2014, "Moving Frostbite to Physically Based Rendering", 5.1.1).
    Ev100(f32),
    /// The log-average luminance becomes 0.18 (Reinhard et al. 2002, "Photographic Tone
    /// Reproduction for Digital Images", eq. 1 and 2).
    ///
    /// Pixels without coverage, without finite light, or darker than a millionth of the brightest
    /// are left out, so that a black background changes nothing.
    Auto,
}

impl Default for Exposure {
    fn default() -> Self {
        Self::Stops(0.0)
    }
}

impl Exposure {
    /// What the radiance of this picture is multiplied by.
    pub fn factor(self, picture: &Picture) -> f32 {
        match self {
            Self::Stops(stops) => stops.exp2(),
            Self::Ev100(ev) => 1.0 / (1.2 * ev.exp2()),
            Self::Auto => auto_factor(picture),
        }
    }
}

/// Middle grey over the log-average luminance; 1 for a black picture.
fn auto_factor(picture: &Picture) -> f32 {
    let seen = |i: usize| picture.alpha.as_ref().is_none_or(|alpha| alpha[i] > 0.0);
    let luminances: Vec<f64> = (0..picture.rgb.len())
        .filter(|&i| seen(i))
        .map(|i| luminance(picture.rgb[i].map(f64::from)))
        .filter(|y| y.is_finite() && *y > 0.0)
        .collect();
    let floor = 1e-6 * luminances.iter().copied().fold(0.0, f64::max);
    let (sum, count) =
        luminances.iter().filter(|&&y| y >= floor).fold((0.0, 0_usize), |(sum, count), y| (sum + y.ln(), count + 1));
    if count == 0 { 1.0 } else { (0.18 / (sum / count as f64).exp()) as f32 }
}

/// Luminance of linear Rec.709 light, in its unit.
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// How exposed light becomes display light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToneMap {
    /// Khronos PBR Neutral 2024: base colours lit by 1 stay true, only highlights are compressed.
    #[default]
    Neutral,
    /// AgX (Sobotka; Blender's Rec.2020 version with the polynomial fit of its default look).
    Agx,
    /// Stephen Hill's fit of ACES's RRT and ODT, as the Khronos sample viewer has it, without
    /// that viewer's optional boost of 1/0.6.
    Aces,
    /// Clipped at 1, then the sRGB transfer function.
    Srgb,
    /// Clipped at 1 and stored linearly: no transfer function (the PNG says gamma 1).
    None,
}

impl ToneMap {
    /// Every curve with its name on the command line.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Neutral, "neutral"),
        (Self::Agx, "agx"),
        (Self::Aces, "aces"),
        (Self::Srgb, "srgb"),
        (Self::None, "none"),
    ];

    /// As on the command line.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(map, _)| *map == self).map_or("", |(_, name)| name)
    }

    /// Linear display light in [0, 1] of exposed light. Light below 0 or not a number counts as 0.
    pub fn map(self, rgb: [f32; 3]) -> [f32; 3] {
        // Beyond 2^30 every curve is flat, and infinity would turn into 0 · ∞.
        let light = rgb.map(|c| if c > 0.0 { c.min(1_073_741_824.0) } else { 0.0 });
        let mapped = match self {
            Self::Neutral => neutral(light),
            Self::Agx => agx(light),
            Self::Aces => aces(light),
            Self::Srgb | Self::None => light,
        };
        mapped.map(|c| c.clamp(0.0, 1.0))
    }

    /// The number to store, in [0, 1], of exposed light.
    pub fn encode(self, rgb: [f32; 3]) -> [f32; 3] {
        let display = self.map(rgb);
        if self == Self::None { display } else { display.map(srgb_encode) }
    }
}

impl FromStr for ToneMap {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL.iter().find(|(_, n)| *n == name).map(|(map, _)| *map).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|(_, name)| *name).collect();
            format!("expected one of {}", names.join(", "))
        })
    }
}

/// The sRGB transfer function (IEC 61966-2-1), linear to stored.
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`], stored to linear.
pub fn srgb_decode(stored: f32) -> f32 {
    if stored <= 0.040_45 { stored / 12.92 } else { ((stored + 0.055) / 1.055).powf(2.4) }
}

/// Khronos 2024, "PBR Neutral Tone Mapper Specification".
fn neutral([r, g, b]: [f32; 3]) -> [f32; 3] {
    const F90: f32 = 0.04;
    const START: f32 = 0.8 - F90;
    const DESATURATION: f32 = 0.15;
    let least = r.min(g).min(b);
    let offset = if least < 2.0 * F90 { least - least * least / (4.0 * F90) } else { F90 };
    let light = [r - offset, g - offset, b - offset];
    let peak = light[0].max(light[1]).max(light[2]);
    if peak < START {
        return light;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let colour = 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    light.map(|c| c * (new_peak / peak) * colour + new_peak * (1.0 - colour))
}

/// Hill 2016, "BakingLab", ACES.hlsl: sRGB to AP1 with the RRT's saturation, curve, and back.
fn aces(rgb: [f32; 3]) -> [f32; 3] {
    const IN: [[f32; 3]; 3] = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]];
    const OUT: [[f32; 3]; 3] =
        [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]];
    let curve = |v: f32| (v * (v + 0.024_578_6) - 0.000_090_537) / (v * (0.983_729 * v + 0.432_951) + 0.238_081);
    transform(&OUT, transform(&IN, rgb).map(curve))
}

/// AgX as in Filament and three.js: Rec.2020, inset, log2 curve, outset, power 2.2, Rec.709.
fn agx(rgb: [f32; 3]) -> [f32; 3] {
    const REC2020: [[f32; 3]; 3] = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]];
    const REC709: [[f32; 3]; 3] = [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]];
    const INSET: [[f32; 3]; 3] = [
        [0.856_627_15, 0.095_121_24, 0.048_251_606],
        [0.137_318_97, 0.761_242, 0.101_439_04],
        [0.111_898_21, 0.076_799_42, 0.811_302_4],
    ];
    const OUTSET: [[f32; 3]; 3] = [
        [1.127_100_6, -0.110_606_64, -0.016_493_939],
        [-0.141_329_76, 1.157_823_7, -0.016_493_939],
        [-0.141_329_76, -0.110_606_64, 1.251_936_4],
    ];
    // Middle grey 0.18 less 10 stops, and plus 6.5 stops.
    const LEAST: f32 = -12.473_93;
    const MOST: f32 = 4.026_069;
    let curve = |v: f32| {
        let x = ((v.max(1e-10).log2() - LEAST) / (MOST - LEAST)).clamp(0.0, 1.0);
        let (x2, x4) = (x * x, x * x * x * x);
        15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232
    };
    let display = transform(&OUTSET, transform(&INSET, transform(&REC2020, rgb)).map(curve));
    transform(&REC709, display.map(|v| v.max(0.0).powf(2.2)))
}

fn transform(rows: &[[f32; 3]; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    rows.map(|[a, b, c]| a * x + b * y + c * z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_near(got: [f32; 3], want: [f32; 3], tolerance: f32) {
        let worst = (0..3).map(|c| (got[c] - want[c]).abs()).fold(0.0, f32::max);
        assert!(worst <= tolerance, "got {got:?}, want {want:?}");
    }

    /// Specification: below 0.8 − F90 every channel is lowered by one offset, F90 = 0.04 where
    /// all channels are at least 2·F90, and x − x²/(4·F90) of the least channel x where not.
    #[test]
    fn neutral_only_lowers_colours_that_need_no_compression() {
        check_near(ToneMap::Neutral.map([0.5, 0.3, 0.1]), [0.46, 0.26, 0.06], 1e-6);
        check_near(ToneMap::Neutral.map([0.02, 0.02, 0.02]), [0.0025; 3], 1e-7);
        let offset = 0.04 - 0.04 * 0.04 / 0.16;
        check_near(ToneMap::Neutral.map([0.7, 0.04, 0.4]), [0.7 - offset, 0.04 - offset, 0.4 - offset], 1e-6);
        check_near(ToneMap::Neutral.map([0.0, 0.0, 0.0]), [0.0; 3], 0.0);
    }

    /// White: 0.96 after the offset, d = 0.24: 1 − d²/(0.96 + d − 0.76) = 0.869 090 9…
    /// A saturated (10, 0, 0): peak 10, p = 1 − d²/(10 − 0.52), g = 1 − 1/(0.15(10 − p) + 1).
    #[test]
    fn neutral_compresses_highlights_as_specified() {
        check_near(ToneMap::Neutral.map([1.0; 3]), [0.869_090_9; 3], 1e-6);
        let p = 1.0 - 0.0576 / 9.48_f32;
        let g = 1.0 - 1.0 / (0.15 * (10.0 - p) + 1.0);
        check_near(ToneMap::Neutral.map([10.0, 0.0, 0.0]), [p * (1.0 - g) + p * g, p * g, p * g], 1e-5);
    }

    /// The specification's own inverse, section "Inverse": undoes the curve.
    #[test]
    fn neutral_is_undone_by_its_published_inverse() {
        let inverse = |c: [f32; 3]| {
            let peak = c[0].max(c[1]).max(c[2]);
            let c = if peak > 0.76 {
                let d = 0.24;
                let old = d * d / (1.0 - peak) - d + 0.76;
                let f = 0.15 * (old - peak) + 1.0;
                c.map(|c| ((c - peak) * f + peak) * (old / peak))
            } else {
                c
            };
            let y = c[0].min(c[1]).min(c[2]);
            let offset = if y < 0.04 { (y / 6.25).sqrt() - y } else { 0.04 };
            c.map(|c| c + offset)
        };
        for light in [[0.2, 0.4, 0.6], [1.5, 0.9, 0.3], [0.01, 0.5, 3.0], [0.8, 0.8, 0.8]] {
            check_near(inverse(ToneMap::Neutral.map(light)), light, 2e-5);
        }
    }

    /// Both matrices keep grey, so grey v gives the curve (v(v + 0.0245786) − 0.000090537) /
    /// (v(0.983729 v + 0.432951) + 0.238081): 0.105 591 for 0.18, 0.616 304 for 1.
    #[test]
    fn aces_maps_grey_by_hills_curve() {
        check_near(ToneMap::Aces.map([0.18; 3]), [0.105_591; 3], 2e-5);
        check_near(ToneMap::Aces.map([1.0; 3]), [1.024_488_1 / 1.654_761; 3], 2e-5);
        check_near(ToneMap::Aces.map([0.0; 3]), [0.0; 3], 0.0);
        check_near(ToneMap::Aces.map([1e9; 3]), [1.0; 3], 0.0);
    }

    /// AgX's curve puts middle grey at half the code range: 0.5^2.2 in light, which the
    /// published polynomial meets to within 0.004 in code.
    #[test]
    fn agx_puts_middle_grey_in_the_middle() {
        for c in ToneMap::Agx.map([0.18; 3]) {
            assert!((c.powf(1.0 / 2.2) - 0.5).abs() < 0.006, "{c}");
        }
        check_near(ToneMap::Agx.map([0.0; 3]), [0.0; 3], 1e-5);
        check_near(ToneMap::Agx.map([1e6; 3]), [1.0; 3], 0.02);
    }

    #[test]
    fn every_curve_keeps_order_and_range_and_survives_bad_light() {
        for (map, name) in ToneMap::ALL {
            let mut last = -1.0;
            for i in -40..60 {
                let grey = map.map([(i as f32 * 0.25).exp2(); 3])[1];
                assert!(grey >= last - 1e-4 && (0.0..=1.0).contains(&grey), "{name}: {grey} after {last}");
                last = grey;
            }
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0] {
                assert!(map.encode([bad, 0.5, 0.5]).iter().all(|c| (0.0..=1.0).contains(c)), "{name} of {bad}");
            }
            assert_eq!(name.parse(), Ok(map));
        }
    }

    /// IEC 61966-2-1: 0.5 linear is 0.735 357 stored; 0.214 041 linear is 0.5 stored.
    #[test]
    fn srgb_has_the_standards_values_and_inverts() {
        assert!((srgb_encode(0.5) - 0.735_357).abs() < 1e-6);
        assert!((srgb_decode(0.5) - 0.214_041).abs() < 1e-6);
        for i in 0..=255 {
            let stored = i as f32 / 255.0;
            assert!((srgb_encode(srgb_decode(stored)) - stored).abs() < 1e-6);
        }
    }

    /// A picture of one luminance Y gets 0.18 / Y, whatever its black background; EV 0 makes 1.2 nit white.
    #[test]
    fn exposure_factors_follow_their_formulas() {
        let mut picture = Picture { width: 2, height: 1, rgb: vec![[40.0; 3], [0.0; 3]], ..Picture::default() };
        assert!((Exposure::Auto.factor(&picture) - 0.18 / 40.0).abs() < 1e-7);
        picture.rgb[1] = [10.0; 3];
        assert!((Exposure::Auto.factor(&picture) - 0.18 / 20.0).abs() < 1e-7);
        picture.alpha = Some(vec![1.0, 0.0]);
        assert!((Exposure::Auto.factor(&picture) - 0.18 / 40.0).abs() < 1e-7);
        assert_eq!(Exposure::Stops(3.0).factor(&picture), 8.0);
        assert!((Exposure::Ev100(0.0).factor(&picture) - 1.0 / 1.2).abs() < 1e-7);
        assert_eq!(Exposure::Auto.factor(&Picture::default()), 1.0);
    }
}
