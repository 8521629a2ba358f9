//! Structural similarity.

use rayon::prelude::*;

/// Pixels on either side of the window's centre.
const RADIUS: usize = 5;
/// Standard deviation of the window, pixels.
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Mean structural similarity of the lumas of two display-referred pictures, 1 for equal ones.
///
/// Values are in [0, 1] as stored (sRGB-encoded), rows from the top; luma weighs them as
/// 0.2126, 0.7152, 0.0722. Gaussian window of 11 × 11 pixels, σ = 1.5, population
/// covariance, windows that lie inside the picture: scikit-image's `structural_similarity` with
/// `gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1`.
/// `None` for pictures smaller than the window.
///
/// Wang, Bovik, Sheikh, Simoncelli 2004, "Image Quality Assessment: From Error Visibility to
/// Structural Similarity", eq. 13.
pub fn ssim(x: &[[f32; 3]], reference: &[[f32; 3]], width: usize) -> Option<f64> {
    let height = x.len().checked_div(width)?;
    if width < 2 * RADIUS + 1 || height < 2 * RADIUS + 1 {
        return None;
    }
    let (a, b) = (lumas(x), lumas(reference));
    let product = |p: &[f64], q: &[f64]| p.iter().zip(q).map(|(p, q)| p * q).collect::<Vec<_>>();
    let columns = [product(&a, &a), product(&b, &b), product(&a, &b), a, b];
    let [aa, bb, ab, a, b] = columns.map(|column| windowed(&column, width));
    let sum: f64 = (0..a.len())
        .map(|i| {
            let (ua, ub) = (a[i], b[i]);
            let (va, vb, vab) = (aa[i] - ua * ua, bb[i] - ub * ub, ab[i] - ua * ub);
            ((2.0 * ua * ub + C1) * (2.0 * vab + C2)) / ((ua * ua + ub * ub + C1) * (va + vb + C2))
        })
        .sum();
    Some(sum / a.len() as f64)
}

fn lumas(rgb: &[[f32; 3]]) -> Vec<f64> {
    rgb.iter().map(|rgb| crate::film::luminance(rgb.map(f64::from))).collect()
}

/// Weighted means over all windows inside the picture, rows from the top.
fn windowed(values: &[f64], width: usize) -> Vec<f64> {
    let weights = window();
    let inside = width - 2 * RADIUS;
    let along: Vec<f64> = values
        .par_chunks_exact(width)
        .flat_map_iter(|row| row.windows(weights.len()).map(|part| dot(part.iter(), &weights)))
        .collect();
    let rows = along.len() / inside - 2 * RADIUS;
    (0..rows)
        .into_par_iter()
        .flat_map_iter(|y| {
            let (along, weights) = (&along, &weights);
            (0..inside).map(move |x| dot(along[y * inside + x..].iter().step_by(inside), weights))
        })
        .collect()
}

fn dot<'a>(values: impl Iterator<Item = &'a f64>, weights: &[f64]) -> f64 {
    values.zip(weights).map(|(value, weight)| value * weight).sum()
}

fn window() -> [f64; 2 * RADIUS + 1] {
    let mut weights = std::array::from_fn(|i| {
        let x = i as f64 - RADIUS as f64;
        (-0.5 * x * x / (SIGMA * SIGMA)).exp()
    });
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two flat pictures a and b: (2ab + C₁)/(a² + b² + C₁), the structure term being C₂/C₂.
    #[test]
    fn flat_pictures_compare_by_luminance_alone() {
        let (a, b) = (0.25, 0.75);
        let want = (2.0 * a * b + C1) / (a * a + b * b + C1);
        let got = ssim(&[[a as f32; 3]; 400], &[[b as f32; 3]; 400], 20).unwrap();
        assert!((got - want).abs() < 1e-9, "{got} {want}");
    }

    #[test]
    fn a_picture_is_like_itself_and_too_small_a_one_like_nothing() {
        let picture: Vec<_> = (0..300).map(|i| [(i * i % 17) as f32 / 16.0, 0.5, 0.1]).collect();
        assert!((ssim(&picture, &picture, 20).unwrap() - 1.0).abs() < 1e-12);
        assert_eq!(ssim(&picture[..200], &picture[..200], 20), None, "ten rows");
        assert_eq!(ssim(&picture[..200], &picture[..200], 10), None, "ten columns");
        assert_eq!(ssim(&[], &[], 0), None);
    }
}
