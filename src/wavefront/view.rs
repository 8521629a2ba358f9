//! A surface that was met from one direction, as it looks along another.

use super::surface::{Surface, flip, valid_normal};
use crate::{
    bsdf::Params,
    simd::{Frame, Mask, Real, V3},
};

/// How a surface looks along one direction.
#[derive(Clone, Copy, Debug)]
pub struct View<F: Real> {
    /// The direction in the shading frame; z above 0.
    pub to_local: V3<F>,
    /// Geometric normal on this side.
    pub ng: V3<F>,
    /// Shading frame on this side.
    pub frame: Frame<F>,
    /// The shading normal had to be bent.
    pub bent: F::Mask,
    /// It is the side that the surface was not met from.
    pub other_side: F::Mask,
    /// Appearance from this side.
    pub params: Params<F>,
}

impl<F: Real> Surface<F> {
    /// As a path that arrived along `to` would have it, which is a unit vector away from the surface; unless `bends`, with the
    /// shading normal as it is.
    #[inline(always)]
    pub fn view(&self, to: V3<F>, bends: bool) -> View<F> {
        let zero = F::zero();
        let other_side = to.dot(self.ng).lt(zero);
        let (ng, mut ns) = (flip::<F>(other_side, self.ng), flip::<F>(other_side, self.ns));
        let mut bent = F::Mask::splat(false);
        if self.smooth.any() {
            let (valid, below) = valid_normal(ns, ng, to);
            let towards = flip::<F>(ns.dot(to).lt(zero), ns);
            ns = V3::select(self.smooth, if bends { valid } else { towards }, ns);
            bent = below & self.smooth;
        }
        let frame = Frame::new(ns);
        let mut to_local = frame.to_local(to);
        to_local.z = to_local.z.max(F::splat(1e-6));
        let mut params = self.params;
        let inside = params.inside;
        params.inside = params.solid & ((inside & !other_side) | (!inside & other_side));
        View { to_local, ng, frame, bent, other_side, params }
    }
}
