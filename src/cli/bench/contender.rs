//! What is measured: structures over a scene's triangles, each behind a pointer.

use std::sync::Arc;

use wavecast::accel::{
    Accel, AccelKind, Blas, Brute, Bsp, Bvh2, Cell, Counters, Grid, Hit, InstanceRef, KdTree, Nearest, Obb, Octree,
    Quality, Ray, RayList, SideBySide, Solid, Structure, Work,
};

use super::rays::{Corners, OneRay};
use crate::cli::error::CliError;

/// Rays that a wave of the renderer has at hand, and that a thread takes at a time.
pub const WAVE: usize = 2048;

/// What the ray meets: row of the triangle and distance; for rays that are only asked whether, 0 and 0.
pub type Answer = Option<(u32, f32)>;

/// What is asked about a batch of rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Question {
    /// What each meets.
    Nearest,
    /// The same; and rays that follow one another run side by side.
    NearestOfNeighbours,
    /// Only whether each meets anything.
    Any,
}

/// A structure over a scene's triangles. Its loops over rays are compiled for each kind.
pub trait Contender: Send + Sync {
    /// Bytes held.
    fn bytes(&self) -> usize;

    /// References to triangles, where that can be known.
    fn references(&self) -> Option<usize>;

    /// The answer for each ray.
    fn answers(&self, rays: &[OneRay], question: Question, into: &mut [Answer]);

    /// Nodes and triangles that all rays together came to, where that can be known.
    fn work(&self, rays: &[OneRay], question: Question) -> Option<Work>;

    /// The regions that triangles are held in.
    fn cells(&self, visit: &mut dyn FnMut(Cell));

    /// True if the structure is part of what is measured; false for others that it is compared with.
    fn is_ours(&self) -> bool {
        true
    }

    /// True for what is made for rays of this kind.
    fn takes(&self, _kind: &str) -> bool {
        true
    }

    /// True if an answer is as good as the true one.
    fn agrees(&self, truth: &Answer, answer: &Answer) -> bool {
        truth == answer
    }
}

/// Of those that are asked by one ray at a time.
pub struct Single<S>(pub S);

impl<S: Structure> Single<S> {
    #[inline(always)]
    fn ask(
        &self,
        rays: &[OneRay],
        question: Question,
        counters: &mut impl Counters,
        mut done: impl FnMut(usize, Answer),
    ) {
        for (index, &(origin, direction, t_max)) in rays.iter().enumerate() {
            let ray = Ray::new(origin, direction);
            if question == Question::Any {
                done(index, self.0.occluded(&ray, t_max, |_, _| true, counters).then_some((0, 0.0)));
            } else {
                let mut best = Nearest::none(t_max);
                self.0.nearest(&ray, &mut best, |_, _| true, counters);
                done(index, (best.triangle != u32::MAX).then_some((best.triangle, best.t)));
            }
        }
    }
}

impl<S: Structure + Send + Sync> Contender for Single<S> {
    fn bytes(&self) -> usize {
        self.0.bytes()
    }

    fn references(&self) -> Option<usize> {
        Some(self.0.references())
    }

    fn answers(&self, rays: &[OneRay], question: Question, into: &mut [Answer]) {
        self.ask(rays, question, &mut (), |index, answer| into[index] = answer);
    }

    fn work(&self, rays: &[OneRay], question: Question) -> Option<Work> {
        let mut work = Work::default();
        self.ask(rays, question, &mut work, |_, _| ());
        Some(work)
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        self.0.cells(visit);
    }
}

/// The renderer's way: waves of rays through the eight-wide tree.
pub struct Waves {
    /// The tree, under a top level of one instance.
    pub accel: Accel,
    references: usize,
}

impl Waves {
    /// Over triangles.
    pub fn build(triangles: &[Corners], quality: Quality) -> Self {
        let blas = Blas::build_as(AccelKind::Bvh8(quality), triangles);
        let references = blas.references();
        let only = InstanceRef::unmoved(Arc::new(blas));
        Self { accel: Accel::build(vec![only]), references }
    }

    fn ask(&self, rays: &[OneRay], question: Question, counters: &mut impl Counters, into: &mut [Answer]) {
        for (rays, into) in rays.chunks(WAVE).zip(into.chunks_mut(WAVE)) {
            let wave = RayList(rays);
            let met = |index: usize, hit: &Hit| {
                into[index] = (hit.triangle != u32::MAX).then_some((hit.triangle, hit.t));
            };
            match question {
                Question::Nearest => self.accel.nearest_counted(&wave, &Solid, counters, met),
                Question::NearestOfNeighbours => {
                    self.accel.nearest_counted(&SideBySide(wave), &Solid, counters, met);
                }
                Question::Any => {
                    let done = |index: usize, occluded: bool| into[index] = occluded.then_some((0, 0.0));
                    self.accel.occluded_counted(&wave, &Solid, counters, done);
                }
            }
        }
    }
}

impl Contender for Waves {
    fn bytes(&self) -> usize {
        self.accel.instances()[0].blas.bytes()
    }

    fn references(&self) -> Option<usize> {
        Some(self.references)
    }

    fn answers(&self, rays: &[OneRay], question: Question, into: &mut [Answer]) {
        self.ask(rays, question, &mut (), into);
    }

    fn work(&self, rays: &[OneRay], question: Question) -> Option<Work> {
        let mut work = Work::default();
        self.ask(rays, question, &mut work, &mut vec![None; rays.len()]);
        Some(work)
    }

    fn cells(&self, visit: &mut dyn FnMut(Cell)) {
        self.accel.instances()[0].blas.cells(visit);
    }
}

/// How a structure is built.
pub type Build = fn(&[Corners]) -> Box<dyn Contender>;

/// A structure by its name.
pub type Choice = (&'static str, Build);

fn single<S: Structure + Send + Sync + 'static>() -> Choice {
    (S::NAME, |triangles| Box::new(Single(S::build(triangles))))
}

fn waves(quality: Quality) -> Choice {
    let build: Build = match quality {
        Quality::Fast => |triangles| Box::new(Waves::build(triangles, Quality::Fast)),
        Quality::Good => |triangles| Box::new(Waves::build(triangles, Quality::Good)),
        Quality::Best => |triangles| Box::new(Waves::build(triangles, Quality::Best)),
    };
    (Blas::NAME, build)
}

/// All structures by name, the one that renders first.
pub fn structures() -> [Choice; 8] {
    [
        waves(Quality::Good),
        single::<Bvh2>(),
        single::<Obb>(),
        single::<KdTree>(),
        single::<Octree>(),
        single::<Bsp>(),
        single::<Grid>(),
        single::<Brute>(),
    ]
}

/// Those asked for; if none are, all but brute force. The first is built in a quality.
pub fn chosen(names: &[String], quality: Quality) -> Result<Vec<Choice>, CliError> {
    let mut all = structures();
    all[0] = waves(quality);
    pick(all, names)
}

/// Those of `all` that are asked for by name; if none are, all but brute force.
pub fn pick<T, const N: usize>(
    all: [(&'static str, T); N],
    names: &[String],
) -> Result<Vec<(&'static str, T)>, CliError> {
    let known = all.each_ref().map(|&(name, _)| name);
    if let Some(wrong) = names.iter().find(|wanted| !known.contains(&wanted.as_str())) {
        return Err(CliError::Usage(format!("there is no structure {wrong:?}; there is {}", known.join(", "))));
    }
    let wanted = |name: &str| if names.is_empty() { name != Brute::NAME } else { names.iter().any(|n| n == name) };
    Ok(all.into_iter().filter(|(name, _)| wanted(name)).collect())
}

/// A built structure and what building it took.
pub struct Built {
    /// As tables call it.
    pub name: &'static str,
    /// The structure.
    pub structure: Box<dyn Contender>,
    /// Wall-clock time of its build.
    pub seconds: f64,
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// A structure that has lost one triangle in three, and says that it has them all.
    pub struct Lossy<S>(S);

    impl<S: Structure> Structure for Lossy<S> {
        const NAME: &'static str = "lossy";

        fn build(triangles: &[Corners]) -> Self {
            let mut kept = triangles.to_vec();
            kept.iter_mut().step_by(3).for_each(|lost| *lost = [lost[0]; 3]);
            Self(S::build(&kept))
        }

        fn bytes(&self) -> usize {
            self.0.bytes()
        }

        fn references(&self) -> usize {
            self.0.references()
        }

        fn nearest(
            &self,
            ray: &Ray,
            best: &mut Nearest,
            accept: impl Fn(u32, &wavecast::accel::TriangleHit) -> bool,
            counters: &mut impl Counters,
        ) {
            self.0.nearest(ray, best, accept, counters);
        }

        fn occluded(
            &self,
            ray: &Ray,
            t_max: f32,
            accept: impl Fn(u32, &wavecast::accel::TriangleHit) -> bool,
            counters: &mut impl Counters,
        ) -> bool {
            self.0.occluded(ray, t_max, accept, counters)
        }
    }

    /// That of a structure, by its type.
    pub fn broken<S: Structure + Send + Sync + 'static>() -> Choice {
        single::<Lossy<S>>()
    }
}
