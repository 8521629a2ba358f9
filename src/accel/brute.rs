//! No structure at all: every triangle is tested. Slow, and right by inspection.

use super::{
    Counters, Nearest, Ray, Structure, TriangleHit, intersect, slab,
    space::{Bounds, blurred},
    triangle::has_area,
};

/// All triangles of a mesh with their rows.
#[derive(Clone, Debug, Default)]
pub struct Brute(Vec<(u32, [[f32; 3]; 3])>);

/// Where a ray meets a triangle and the box around it.
///
/// All structures look at boxes first, or at cells. The triangle's test alone says of one in some 10⁹ pairs of ray and
/// triangle, which are far apart but on one line as the ray sees it, that they meet: all that is left of its edge functions
/// there is rounding, whose signs may agree.
fn met(ray: &Ray, corners: &[[f32; 3]; 3], t_max: f32) -> Option<TriangleHit> {
    let hit = intersect(ray, corners, t_max)?;
    let Bounds { lower, upper } = blurred(corners, 0.0);
    let (near, far) = slab::distances(lower, upper, ray, f32::INFINITY);
    (near <= far).then_some(hit)
}

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
            if let Some(hit) = met(ray, corners, best.t) {
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
            met(ray, corners, t_max).is_some_and(|hit| accept(*row, &hit))
        });
        counters.triangles(tested);
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ray passes 43 m beside the triangle, whose edge it sees.
    #[test]
    fn a_triangle_seen_from_its_edge_is_not_met_from_afar() {
        let corners = [
            [0.573_623_8, 9.120_583, -15.530_3],
            [0.552_179_1, 9.118_267, -15.530_195],
            [0.553_461_1, 9.114_316, -15.525_89],
        ];
        let ray = Ray::new([-33.736_82, 25.164_248, -36.148_735], [0.654_514_55, 0.555_075_76, -0.513_324_14]);
        assert!(intersect(&ray, &corners, f32::INFINITY).is_some(), "then the box is not needed");
        let brute = Brute::build(&[corners]);
        let mut best = Nearest::none(f32::INFINITY);
        brute.nearest(&ray, &mut best, |_, _| true, &mut ());
        assert_eq!(best.triangle, u32::MAX);
        assert!(!brute.occluded(&ray, f32::INFINITY, |_, _| true, &mut ()));
    }
}
