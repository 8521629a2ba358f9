//! Mean errors over pixels and channels, in f64.
//!
//! `x` is the picture under test, `reference` what it should be; one value per pixel each.
//! A number that is not finite makes every mean that meets it not finite: nothing is hidden.

/// Share of the pixels that `relmse_trimmed` leaves out, wherever it is told.
pub const TRIMMED: f64 = 0.001;

/// Mean over pixels and channels of (x − ref)².
pub fn mse(x: &[[f32; 3]], reference: &[[f32; 3]]) -> f64 {
    mean(pairs(x, reference).map(|(x, r)| (x - r) * (x - r)))
}

/// Mean over pixels and channels of (x − ref)² / (ref² + 0.01·m²), m the mean of the reference.
///
/// It does not depend on the scene's scale. A value that is right is no error even where the
/// reference is all black; a wrong one there is infinite.
pub fn rel_mse(x: &[[f32; 3]], reference: &[[f32; 3]]) -> f64 {
    mean(pixel_rel_se(x, reference).into_iter())
}

/// [`rel_mse`] with the worst `share` of the pixels left out, rounded down to whole pixels.
pub fn rel_mse_trimmed(x: &[[f32; 3]], reference: &[[f32; 3]], share: f64) -> f64 {
    let mut errors = pixel_rel_se(x, reference);
    let kept = kept(errors.len(), share);
    errors.sort_unstable_by(f64::total_cmp);
    mean(errors[..kept].iter().copied())
}

/// 10·log₁₀(peak²/MSE), dB; infinite for equal pictures.
pub fn psnr(mse: f64, peak: f64) -> f64 {
    10.0 * (peak * peak / mse).log10()
}

/// Pixels of which a channel is not finite.
pub fn non_finite(x: &[[f32; 3]]) -> usize {
    x.iter().filter(|rgb| rgb.iter().any(|c| !c.is_finite())).count()
}

/// Each pixel's relative error, the mean of its channels.
fn pixel_rel_se(x: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f64> {
    let floor = floor(reference);
    let error = |x: f32, r: f32| {
        let (x, r) = (f64::from(x), f64::from(r));
        if x == r { 0.0 } else { (x - r) * (x - r) / (r * r + floor) }
    };
    let pixel = |(x, r): (&[f32; 3], &[f32; 3])| (error(x[0], r[0]) + error(x[1], r[1]) + error(x[2], r[2])) / 3.0;
    x.iter().zip(reference).map(pixel).collect()
}

/// 0.01·m², m the mean of the reference: what keeps relative errors of dark pixels finite.
pub(super) fn floor(reference: &[[f32; 3]]) -> f64 {
    let m = mean(reference.iter().flatten().map(|&r| f64::from(r)));
    0.01 * m * m
}

/// How many pixels are left if the worst `share` of them, rounded down to whole pixels, is left out.
pub(super) fn kept(pixels: usize, share: f64) -> usize {
    pixels - (pixels as f64 * share) as usize
}

fn pairs<'a>(x: &'a [[f32; 3]], reference: &'a [[f32; 3]]) -> impl Iterator<Item = (f64, f64)> + 'a {
    debug_assert_eq!(x.len(), reference.len(), "pictures of one size");
    x.iter().flatten().zip(reference.iter().flatten()).map(|(&x, &r)| (f64::from(x), f64::from(r)))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value, count + 1));
    sum / count as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x = (1 + δ)·ref with a constant reference: MSE (δ·ref)², relMSE δ²/1.01.
    #[test]
    fn a_scaled_constant_has_the_error_of_its_formula_at_any_scale() {
        for scale in [1e-3_f32, 1.0, 1e4] {
            let reference = vec![[scale; 3]; 100];
            let x = vec![[scale * 1.5; 3]; 100];
            let want = 0.25 * f64::from(scale) * f64::from(scale);
            assert!((mse(&x, &reference) / want - 1.0).abs() < 1e-6);
            assert!((rel_mse(&x, &reference) - 0.25 / 1.01).abs() < 1e-6);
        }
    }

    /// One channel of one pixel in 2000 is off by 3 where ref = 1: relMSE 9/1.01/6000, and nothing
    /// once the worst 0.1 % = 2 pixels are left out.
    #[test]
    fn trimming_leaves_out_a_firefly_and_no_more() {
        let reference = vec![[1.0; 3]; 2000];
        let mut x = reference.clone();
        x[77][1] = 4.0;
        assert!((rel_mse(&x, &reference) - 9.0 / 1.01 / 6000.0).abs() < 1e-12);
        assert_eq!(rel_mse_trimmed(&x, &reference, 0.001), 0.0);
        x[..3].fill([2.0, 1.0, 1.0]);
        // Four pixels are wrong; the firefly and one of the other three are left out.
        assert!((rel_mse_trimmed(&x, &reference, 0.001) - 2.0 / 1.01 / 3.0 / 1998.0).abs() < 1e-12);
    }

    /// Half the channels 0, half 2: m = 1. Off by 0.1 everywhere: (0.01/0.01 + 0.01/4.01)/2.
    #[test]
    fn dark_pixels_are_held_by_the_mean_of_the_reference() {
        let reference: Vec<_> = (0..64).map(|i| [if i % 2 == 0 { 0.0 } else { 2.0 }; 3]).collect();
        let x: Vec<_> = reference.iter().map(|v| v.map(|c| c + 0.1)).collect();
        assert!((rel_mse(&x, &reference) - f64::midpoint(1.0, 0.01 / 4.01)).abs() < 1e-6);
    }

    #[test]
    fn nothing_is_hidden() {
        let black = vec![[0.0; 3]; 4];
        assert_eq!((mse(&black, &black), rel_mse(&black, &black)), (0.0, 0.0));
        assert_eq!(rel_mse(&[[1.0; 3]; 4], &black), f64::INFINITY);
        assert!(rel_mse(&[[f32::NAN; 3]; 4], &[[1.0; 3]; 4]).is_nan());
        assert_eq!(non_finite(&[[0.0, f32::NAN, 1.0], [f32::INFINITY; 3], [0.0; 3]]), 2);
    }

    /// An error of 0.1 against peak 1 is 20 dB.
    #[test]
    fn psnr_counts_decibels() {
        assert!((psnr(0.01, 1.0) - 20.0).abs() < 1e-12);
        assert!((psnr(0.01, 10.0) - 40.0).abs() < 1e-12);
        assert_eq!(psnr(0.0, 1.0), f64::INFINITY);
    }
}
