//! Where on the film a sample of a pixel lies.

use std::sync::LazyLock;

use crate::{
    render::PixelFilter,
    simd::{LANES, Real},
};

/// Cells of a table.
const CELLS: usize = 512;

/// The inverse of a filter's distribution along one axis.
///
/// The filters are symmetric and a product of two axes. Entry k is the distance from the centre, in pixels, beyond
/// which lies the share (k/512)² of the filter; between entries it is linear in k. The square makes the cells fine
/// where the filter is thin. The share below an offset is off by at most 1e-6.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterTable {
    /// Distances from the centre, falling from the radius to 0.
    pub distance: Vec<f32>,
}

/// Radius of the Gaussian and of Blackman–Harris, pixels.
const RADIUS: f64 = 1.5;

/// Value of a filter at a distance from the centre, up to a factor; radius in pixels.
fn profile(kind: PixelFilter) -> (fn(f64) -> f64, f64) {
    match kind {
        PixelFilter::Box => (|_| 1.0, 0.5),
        PixelFilter::Gaussian => (|x| (-2.0 * x * x).exp(), RADIUS),
        // Harris 1978, "On the Use of Windows for Harmonic Analysis", the minimum four-term window.
        PixelFilter::BlackmanHarris => (
            |x| {
                let t = std::f64::consts::PI * x / RADIUS;
                0.358_75 + 0.488_29 * t.cos() + 0.141_28 * (2.0 * t).cos() + 0.011_68 * (3.0 * t).cos()
            },
            RADIUS,
        ),
    }
}

impl FilterTable {
    /// The table of a filter.
    pub fn new(kind: PixelFilter) -> Self {
        const STEPS: usize = 16_384;
        let (density, radius) = profile(kind);
        let h = radius / STEPS as f64;
        // Share beyond each of the steps, from the edge inwards, by Simpson's rule.
        let mut beyond = vec![0.0; STEPS + 1];
        for i in (0..STEPS).rev() {
            let x = i as f64 * h;
            beyond[i] = beyond[i + 1] + (density(x) + 4.0 * density(x + 0.5 * h) + density(x + h)) * h / 6.0;
        }
        let total = beyond[0];
        let mut step = STEPS;
        let distance = (0..=CELLS)
            .map(|k| {
                let share = total * (k as f64 / CELLS as f64).powi(2);
                while step > 0 && beyond[step] < share {
                    step -= 1;
                }
                let inside =
                    if step < STEPS { (beyond[step] - share) / (beyond[step] - beyond[step + 1]) } else { 0.0 };
                ((step as f64 + inside) * h) as f32
            })
            .collect();
        Self { distance }
    }

    /// Signed distance from the centre, pixels, rising with `u`.
    #[inline(always)]
    pub fn offset<F: Real>(&self, u: F) -> F {
        let side = u.mul_add(F::splat(2.0), F::splat(-1.0));
        let place = (F::one() - side.abs()).safe_sqrt() * F::splat(CELLS as f32);
        let entries: &[f32; CELLS + 1] = self.distance.first_chunk().expect("a table is made whole");
        let mut places = [0.0; LANES];
        place.store(&mut places);
        let distance = F::from_fn(|i| {
            let place = places[i];
            let cell = (place as usize).min(CELLS - 1);
            entries[cell] + (entries[cell + 1] - entries[cell]) * (place - cell as f32)
        });
        distance.copysign(side)
    }
}

/// The density of a filter along one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct FilterDensity {
    /// Distance beyond which it is zero, pixels.
    pub radius: f32,
    /// By distance in 512ths of the radius, per pixel; between entries it is linear, within 1e-5 of the true one.
    at: Vec<f32>,
}

impl FilterDensity {
    /// That of a filter.
    pub fn new(kind: PixelFilter) -> Self {
        let (density, radius) = profile(kind);
        let h = radius / CELLS as f64;
        let simpson =
            |i: usize| density(i as f64 * h) + 4.0 * density((i as f64 + 0.5) * h) + density((i as f64 + 1.0) * h);
        let half: f64 = (0..CELLS).map(simpson).sum::<f64>() * h / 6.0;
        let at = (0..=CELLS).map(|i| (density(i as f64 * h) / (2.0 * half)) as f32).collect();
        Self { radius: radius as f32, at }
    }

    /// At a signed distance from a pixel's centre, pixels.
    #[inline]
    pub fn at(&self, distance: f32) -> f32 {
        let place = distance.abs() * (CELLS as f32 / self.radius);
        let cell = place as usize;
        if cell >= CELLS {
            return 0.0;
        }
        self.at[cell] + (self.at[cell + 1] - self.at[cell]) * (place - cell as f32)
    }
}

static GAUSSIAN: LazyLock<FilterTable> = LazyLock::new(|| FilterTable::new(PixelFilter::Gaussian));
static BLACKMAN_HARRIS: LazyLock<FilterTable> = LazyLock::new(|| FilterTable::new(PixelFilter::BlackmanHarris));

/// Offset from a pixel's centre, in pixels, distributed as the filter; rises with both numbers.
#[inline(always)]
pub fn filter_offset<F: Real>(kind: PixelFilter, u: (F, F)) -> (F, F) {
    let table = match kind {
        PixelFilter::Box => return (u.0 - F::splat(0.5), u.1 - F::splat(0.5)),
        PixelFilter::Gaussian => &*GAUSSIAN,
        PixelFilter::BlackmanHarris => &*BLACKMAN_HARRIS,
    };
    (table.offset(u.0), table.offset(u.1))
}

#[cfg(test)]
mod tests {
    use wide::f32x8;

    use super::*;
    use crate::sampling::tests::check_warp;

    const KINDS: [PixelFilter; 3] = [PixelFilter::Box, PixelFilter::Gaussian, PixelFilter::BlackmanHarris];

    /// Share of the filter below x, by Simpson's rule.
    fn share_below(kind: PixelFilter, x: f64) -> f64 {
        const STEPS: usize = 512;
        let (density, radius) = profile(kind);
        let integral = |to: f64| {
            let h = to / STEPS as f64;
            let at =
                |i: usize| density((i as f64 + 0.5) * h) * 4.0 + density(i as f64 * h) + density((i + 1) as f64 * h);
            (0..STEPS).map(at).sum::<f64>() * h / 6.0
        };
        0.5 + 0.5 * x.signum() * integral(x.abs()) / integral(radius)
    }

    /// The share of what lies between two distances is the integral of the density.
    #[test]
    fn densities_are_those_of_the_offsets() {
        for kind in KINDS {
            let (density, (_, radius)) = (FilterDensity::new(kind), profile(kind));
            let steps = 30_000;
            let h = radius / f64::from(steps);
            let mut sum = 0.5;
            for step in 0..steps {
                if step % 3000 == 0 {
                    let want = share_below(kind, f64::from(step) * h);
                    assert!((sum - want).abs() < 1e-5, "{kind:?} {step}: {sum} {want}");
                }
                sum += h * f64::from(density.at(((f64::from(step) + 0.5) * h) as f32));
            }
            assert!((sum - 1.0).abs() < 1e-5, "{kind:?}: {sum}");
            assert_eq!(density.at(radius as f32 * 1.001), 0.0);
        }
    }

    #[test]
    fn offsets_follow_the_filters() {
        for kind in KINDS {
            let (density, radius) = profile(kind);
            let steps = 20_000;
            let total: f64 = 2.0 * radius / f64::from(steps)
                * (0..steps)
                    .map(|i| density(2.0 * radius * (f64::from(i) + 0.5) / f64::from(steps) - radius))
                    .sum::<f64>();
            check_warp(
                &format!("{kind:?}"),
                [[-radius, radius]; 2],
                |u| {
                    let (x, y) = filter_offset(kind, u);
                    [f64::from(x), f64::from(y)]
                },
                |[x, y]| density(x) * density(y) / (total * total),
            );
        }
    }

    /// The true share below the offset of u is u, within 1e-6: the error of the table.
    #[test]
    fn tables_invert_the_distribution_within_one_in_a_million() {
        for kind in [PixelFilter::Gaussian, PixelFilter::BlackmanHarris] {
            let (mut worst, mut last) = (0.0f64, f32::NEG_INFINITY);
            for i in 0..1 << 14 {
                let u = (i as f32 + 0.5) / (1 << 14) as f32;
                let (x, _) = filter_offset(kind, (u, u));
                assert!(x >= last, "rises");
                last = x;
                worst = worst.max((share_below(kind, f64::from(x)) - f64::from(u)).abs());
            }
            assert!(worst < 1e-6, "{kind:?}: {worst}");
        }
    }

    #[test]
    fn offsets_stay_within_the_radius_and_lanes_agree() {
        let u = [0.0, f32::MIN_POSITIVE, 0.25, 0.5, 0.75, 0.999, 1.0 - f32::EPSILON, 1.0 - f32::EPSILON / 2.0];
        for kind in KINDS {
            let (_, radius) = profile(kind);
            let lanes = filter_offset(kind, (f32x8::new(u), f32x8::new(u)));
            for (i, u) in u.into_iter().enumerate() {
                let (x, y) = filter_offset(kind, (u, u));
                assert_eq!(x, y);
                assert!(f64::from(x.abs()) <= radius, "{kind:?} {u}: {x}");
                assert!((Real::lane(lanes.0, i) - x).abs() < 1e-6);
            }
            assert_eq!(filter_offset(kind, (0.5, 0.5)), (0.0, 0.0));
        }
    }
}
