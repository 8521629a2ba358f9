//! No structure at all: every triangle is tested. Slow, and right by inspection.

use super::{Counters, Nearest, Ray, Structure, TriangleHit, intersect, triangle::has_area};

/// All triangles of a mesh with their rows.
#[derive(Clone, Debug, Default)]
pub struct Brute(Vec<(u32, [[f32; 3]; 3])>);

impl Structure for Brute {
    const NAME: &'static str = "brute";

    fn build(triangles: &[[[f32; 3]; 3]]) -> Self {
        Self((0..).zip(triangles.iter().copied()).filter(|(_, corners)| has_area(corners)).collect())
    }

    fn bytes(&self) -> usize {
        size_of_val(self.0.as_slice())
    }

    fn references(&self) -> usize {
        self.0.len()
    }

    fn nearest(
        &self,
        ray: &Ray,
        best: &mut Nearest,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) {
        counters.triangles(self.0.len());
        for (row, corners) in &self.0 {
            if let Some(hit) = intersect(ray, corners, best.t) {
                best.offer(*row, &hit, &accept);
            }
        }
    }

    fn occluded(
        &self,
        ray: &Ray,
        t_max: f32,
        accept: impl Fn(u32, &TriangleHit) -> bool,
        counters: &mut impl Counters,
    ) -> bool {
        let mut tested = 0;
        let found = self.0.iter().any(|(row, corners)| {
            tested += 1;
            intersect(ray, corners, t_max).is_some_and(|hit| accept(*row, &hit))
        });
        counters.triangles(tested);
        found
    }
}
