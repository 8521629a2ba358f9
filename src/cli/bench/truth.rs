//! What rays really meet: no time counts before the answers have been held against this.

use rayon::prelude::*;
use wavecast::accel::{Brute, Structure};

use super::{
    contender::{Answer, Contender, Single, WAVE},
    rays::{Batch, Corners},
};

/// Triangles times rays that brute force is asked about.
const ASKED: usize = 1_000_000_000;

/// The true answers to a batch, as far as they are known.
pub struct Truth(Vec<Option<Answer>>);

impl Truth {
    /// Brute force is asked about rays from all over the batch, and about those that the structures do not agree on, if
    /// they are not too many. Where two or more agree, and brute force is not asked, that is taken for the truth.
    pub fn find(triangles: &[Corners], batch: &Batch, answers: &[Vec<Answer>]) -> Self {
        let count = batch.rays.len();
        let asked = (ASKED / triangles.len().max(1)).max(16);
        let mut truth: Vec<Option<Answer>> = match answers {
            [first, others @ ..] if !others.is_empty() => {
                let agreed = |ray: usize| others.iter().all(|other| other[ray] == first[ray]);
                (0..count).map(|ray| agreed(ray).then(|| first[ray])).collect()
            }
            _ => vec![None; count],
        };
        let everywhere = (0..count).step_by(count.div_ceil(asked).max(1));
        let disputed = (0..count).filter(|&ray| answers.len() > 1 && truth[ray].is_none());
        let rows: Vec<usize> = everywhere.chain(disputed.take(asked)).collect();
        let brute = Single(Brute::build(triangles));
        let rays: Vec<_> = rows.iter().map(|&row| batch.rays[row]).collect();
        let mut found = vec![None; rays.len()];
        let pieces = rays.par_chunks(16).zip(found.par_chunks_mut(16));
        pieces.for_each(|(rays, into)| brute.answers(rays, batch.question, into));
        rows.into_iter().zip(found).for_each(|(row, answer)| truth[row] = Some(answer));
        Self(truth)
    }

    /// How many are known.
    pub fn known(&self) -> usize {
        self.0.iter().flatten().count()
    }

    /// How many answers are not as good as the truth.
    pub fn mismatches(&self, structure: &dyn Contender, answers: &[Answer]) -> usize {
        let wrong = |(truth, answer): (&Option<Answer>, &Answer)| {
            truth.as_ref().is_some_and(|truth| !structure.agrees(truth, answer))
        };
        self.0.iter().zip(answers).filter(|&pair| wrong(pair)).count()
    }
}

/// All answers of a structure, by all threads.
pub fn answers_of(structure: &dyn Contender, batch: &Batch) -> Vec<Answer> {
    let mut answers = vec![None; batch.rays.len()];
    let pieces = batch.rays.par_chunks(WAVE).zip(answers.par_chunks_mut(WAVE));
    pieces.for_each(|(rays, into)| structure.answers(rays, batch.question, into));
    answers
}
