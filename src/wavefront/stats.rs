//! What the stages did, counted per worker and added up at the end.

use std::{
    ops::AddAssign,
    time::{Duration, Instant},
};

use crate::render::{RayCounts, RenderStats, StageStats};
use crate::simd::LANES;

/// The stages, in the order they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Camera rays.
    Generate,
    /// Nearest hits.
    Intersect,
    /// Counting sort by shading class.
    Sort,
    /// Absorption inside solids.
    Absorb,
    /// Albedo, normals and the like at first hits.
    Layers,
    /// The environment behind everything.
    Sky,
    /// Emitting surfaces.
    Emit,
    /// Unlit surfaces.
    Unlit,
    /// Scattering.
    Shade,
    /// Shadow rays.
    Connect,
    /// Roulette and compaction.
    Bounce,
    /// Paths of neighbouring pixels.
    Join,
    /// Light paths, all of their stages.
    Caustics,
}

impl Stage {
    const ALL: [(Self, &'static str); 13] = [
        (Self::Generate, "generate"),
        (Self::Intersect, "intersect"),
        (Self::Sort, "sort"),
        (Self::Absorb, "absorb"),
        (Self::Layers, "layers"),
        (Self::Sky, "sky"),
        (Self::Emit, "emit"),
        (Self::Unlit, "unlit"),
        (Self::Shade, "shade"),
        (Self::Connect, "connect"),
        (Self::Bounce, "bounce"),
        (Self::Join, "join"),
        (Self::Caustics, "caustics"),
    ];
}

/// Names of all stages, in the order they run.
pub const STAGES: [&str; Stage::ALL.len()] = {
    let mut names = [""; Stage::ALL.len()];
    let mut stage = 0;
    while stage < names.len() {
        names[stage] = Stage::ALL[stage].1;
        stage += 1;
    }
    names
};

/// Blocks of eight lanes that a stage ran.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Blocks {
    /// How many.
    pub count: u64,
    /// Their lanes that held work.
    pub lanes: u64,
}

impl Blocks {
    /// Of rows that lie side by side.
    pub fn of(rows: usize) -> Self {
        Self { count: rows.div_ceil(LANES) as u64, lanes: rows as u64 }
    }

    /// One, with so many lanes that hold work.
    #[inline(always)]
    pub fn one(lanes: u32) -> Self {
        Self { count: 1, lanes: lanes.into() }
    }
}

impl AddAssign for Blocks {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.count += other.count;
        self.lanes += other.lanes;
    }
}

/// Work of one stage.
#[derive(Clone, Copy, Debug, Default)]
struct Work {
    time: Duration,
    rows: u64,
    /// None for stages that take rows one at a time.
    blocks: Blocks,
}

/// Counts of one worker.
#[derive(Clone, Debug, Default)]
pub struct Counters {
    stages: [Work; Stage::ALL.len()],
    /// Rays traced.
    pub rays: RayCounts,
    /// Look-ups by shading and emission.
    pub texture_lookups: u64,
    /// Look-ups by light sampling: textures of emitters, environment.
    pub light_lookups: [u64; 2],
    /// Camera or scattered rays that saw the environment map.
    pub environment_lookups: u64,
    /// Hits whose coverage depended on alpha.
    pub alpha_tests: u64,
    /// Paths that ran inside an absorbing solid.
    pub absorbed: u64,
    /// Contributions that were not finite.
    pub discarded: u64,
}

impl Counters {
    /// Times a stage that takes `rows` rows one at a time.
    pub fn time<T>(&mut self, stage: Stage, rows: usize, work: impl FnOnce(&mut Self) -> T) -> T {
        let start = Instant::now();
        let result = work(self);
        let done = &mut self.stages[stage as usize];
        done.time += start.elapsed();
        done.rows += rows as u64;
        result
    }

    /// Times a stage that takes `rows` rows in blocks of eight, and says what was in them.
    pub fn time_blocks(&mut self, stage: Stage, rows: usize, work: impl FnOnce(&mut Self) -> Blocks) {
        let blocks = self.time(stage, rows, work);
        self.stages[stage as usize].blocks += blocks;
    }

    /// Counts rows of a stage that were not known when its time began.
    pub fn add_rows(&mut self, stage: Stage, rows: usize) {
        self.stages[stage as usize].rows += rows as u64;
    }

    /// Adds another worker's counts.
    pub fn add(&mut self, other: &Self) {
        for (mine, theirs) in self.stages.iter_mut().zip(&other.stages) {
            mine.time += theirs.time;
            mine.rows += theirs.rows;
            mine.blocks += theirs.blocks;
        }
        self.rays.camera += other.rays.camera;
        self.rays.bounce += other.rays.bounce;
        self.rays.shadow += other.rays.shadow;
        self.texture_lookups += other.texture_lookups;
        self.light_lookups[0] += other.light_lookups[0];
        self.light_lookups[1] += other.light_lookups[1];
        self.environment_lookups += other.environment_lookups;
        self.alpha_tests += other.alpha_tests;
        self.absorbed += other.absorbed;
        self.discarded += other.discarded;
    }

    /// All rays.
    pub fn all_rays(&self) -> u64 {
        self.rays.camera + self.rays.bounce + self.rays.shadow
    }

    /// What ran, for the user.
    pub fn report(&self, stats: &mut RenderStats) {
        stats.rays = self.rays;
        stats.paths = self.rays.camera;
        stats.stages = Stage::ALL
            .iter()
            .filter(|(stage, _)| self.stages[*stage as usize].rows > 0)
            .map(|&(stage, name)| {
                let work = &self.stages[stage as usize];
                let Blocks { count, lanes } = work.blocks;
                let lane_fill = if count == 0 { 1.0 } else { lanes as f64 / (count * LANES as u64) as f64 };
                StageStats { name, seconds: work.time.as_secs_f64(), rows: work.rows, blocks: count, lane_fill }
            })
            .collect();
        let counters = [
            ("texture_lookups", self.texture_lookups + self.light_lookups[0]),
            ("environment_lookups", self.environment_lookups + self.light_lookups[1]),
            ("alpha_tests", self.alpha_tests),
            ("absorbed_paths", self.absorbed),
        ];
        stats.counters = counters.into_iter().filter(|(_, count)| *count > 0).collect();
        stats.discarded = if self.discarded > 0 { vec![("not finite", self.discarded)] } else { Vec::new() };
    }
}
