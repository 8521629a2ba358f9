//! Where on the film a sample of a pixel lies.

use std::sync::LazyLock;

use crate::{render::PixelFilter, simd::Real};

/// Cells of a table.
const CELLS: usize = 512;

/// The inverse of a filter's distribution along one axis.
///
/// The filters are symmetric and a product of two axes. Entry k is the distance from the centre, in pixels, beyond
/// which lies the share (k/512)² of the filter; between entries it is linear in k. The square makes the cells fine
/// where the filter is thin.
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
        let distance = F::from_fn(|i| {
            let place = place.lane(i);
            let cell = (place as usize).min(CELLS - 1);
            entries[cell] + (entries[cell + 1] - entries[cell]) * (place - cell as f32)
        });
        distance.copysign(side)
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
