//! What rays really meet: no time counts before the answers have been held against this.

use rayon::prelude::*;
use wavecast::accel::{Brute, Structure};

use super::{
    contender::{Answer, Contender, Single, WAVE},
    rays::{Batch, Corners},
};

/// Triangles times rays that brute force is asked about: some seconds for each kind of rays.
const ASKED: usize = 1_000_000_000;
/// Rays that brute force is asked about, however many triangles there are.
const FEWEST: usize = 16;

/// What is known of a ray's true answer.
#[derive(Clone, Copy, PartialEq)]
enum Known {
    /// Nothing, or what too many structures do not agree on.
    Nothing,
    /// What one structure says.
    Said(Answer),
    /// What all say, who are two or more.
    Agreed(Answer),
    /// What brute force says.
    True(Answer),
}

/// The true answers to a batch, as far as they are known.
pub struct Truth<'a> {
    /// The rays.
    pub batch: &'a Batch,
    triangles: &'a [Corners],
    known: Vec<Known>,
    /// Rays that brute force was asked about at first.
    asked: usize,
    /// Disputes that it may still settle.
    left: usize,
}

impl<'a> Truth<'a> {
    /// Asks brute force about rays from all over the batch: fewer where there are more triangles.
    pub fn ask(triangles: &'a [Corners], batch: &'a Batch) -> Self {
        Self::ask_at_most(triangles, batch, (ASKED / triangles.len().max(1)).max(FEWEST))
    }

    fn ask_at_most(triangles: &'a [Corners], batch: &'a Batch, most: usize) -> Self {
        let count = batch.rays.len();
        let everywhere: Vec<usize> = (0..count).step_by(count.div_ceil(most).max(1)).collect();
        let known = vec![Known::Nothing; count];
        let mut truth = Self { batch, triangles, known, asked: everywhere.len(), left: most };
        truth.settle(&everywhere);
        truth
    }

    /// Takes note of a structure's answers. Where it does not agree with those before, brute force is asked, if that is not
    /// too often; where two or more agree, and brute force was not asked, that is taken for the truth.
    pub fn hear(&mut self, answers: &[Answer]) {
        let mut disputed = Vec::new();
        for (ray, (known, answer)) in self.known.iter_mut().zip(answers).enumerate() {
            match *known {
                Known::Nothing => *known = Known::Said(*answer),
                Known::Said(other) if other == *answer => *known = Known::Agreed(other),
                Known::Said(_) => disputed.push(ray),
                Known::Agreed(other) if other != *answer => disputed.push(ray),
                Known::Agreed(_) | Known::True(_) => {}
            }
        }
        let settled = disputed.len().min(self.left);
        self.left -= settled;
        disputed[settled..].iter().for_each(|&ray| self.known[ray] = Known::Nothing);
        self.settle(&disputed[..settled]);
    }

    /// Asks brute force.
    fn settle(&mut self, rows: &[usize]) {
        if rows.is_empty() {
            return;
        }
        let brute = Single(Brute::build(self.triangles));
        let rays: Vec<_> = rows.iter().map(|&row| self.batch.rays[row]).collect();
        let mut found = vec![None; rays.len()];
        let pieces = rays.par_chunks(16).zip(found.par_chunks_mut(16));
        pieces.for_each(|(rays, into)| brute.answers(rays, self.batch.question, into));
        rows.iter().zip(found).for_each(|(&row, answer)| self.known[row] = Known::True(answer));
    }

    fn answers(&self) -> impl Iterator<Item = Option<&Answer>> {
        self.known.iter().map(|known| match known {
            Known::Nothing | Known::Said(_) => None,
            Known::Agreed(answer) | Known::True(answer) => Some(answer),
        })
    }

    /// How many rays brute force was asked about, whatever the structures say.
    pub fn asked(&self) -> usize {
        self.asked
    }

    /// How many are known.
    pub fn known(&self) -> usize {
        self.answers().flatten().count()
    }

    /// How many answers are not as good as the truth.
    pub fn mismatches(&self, answers: &[Answer], agrees: impl Fn(&Answer, &Answer) -> bool) -> usize {
        let wrong = |(truth, answer): &(Option<&Answer>, &Answer)| truth.is_some_and(|truth| !agrees(truth, answer));
        self.answers().zip(answers).filter(wrong).count()
    }
}

/// All answers of a structure, by all threads.
pub fn answers_of(structure: &dyn Contender, batch: &Batch) -> Vec<Answer> {
    let mut answers = vec![None; batch.rays.len()];
    let pieces = batch.rays.par_chunks(WAVE).zip(answers.par_chunks_mut(WAVE));
    pieces.for_each(|(rays, into)| structure.answers(rays, batch.question, into));
    answers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::bench::contender::Question;

    /// A hundred rays that all meet one triangle; brute force is asked about four of them, and in four disputes.
    #[test]
    fn what_comes_later_settles_what_was_said_before() {
        let triangles = [[[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]]];
        let rays = vec![([0.0, 0.0, 2.0], [0.0, 0.0, -1.0], f32::INFINITY); 100];
        let batch = Batch { kind: "primary", question: Question::Nearest, rays };
        let equal = |truth: &Answer, answer: &Answer| truth == answer;
        let (right, mut wrong) = (vec![Some((0, 2.0)); 100], vec![Some((0, 2.0)); 100]);
        wrong[10..13].fill(None);

        let mut truth = Truth::ask_at_most(&triangles, &batch, 4);
        assert_eq!((truth.asked(), truth.known()), (4, 4));
        truth.hear(&wrong);
        assert_eq!((truth.known(), truth.mismatches(&wrong, equal)), (4, 0), "nobody else has been heard");
        truth.hear(&right);
        assert_eq!((truth.known(), truth.mismatches(&wrong, equal), truth.mismatches(&right, equal)), (100, 3, 0));

        let mut truth = Truth::ask_at_most(&triangles, &batch, 4);
        (0..2).for_each(|_| truth.hear(&wrong));
        assert_eq!(truth.mismatches(&right, equal), 3, "two agree");
        truth.hear(&right);
        assert_eq!((truth.mismatches(&wrong, equal), truth.mismatches(&right, equal)), (3, 0), "brute force is asked");

        let mut truth = Truth::ask_at_most(&triangles, &batch, 4);
        truth.hear(&right);
        truth.hear(&vec![None; 100]);
        assert_eq!(truth.known(), 8, "more is disputed than brute force is asked about");
    }
}
