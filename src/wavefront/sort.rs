//! Orders the hits of a wave by what shading they need.

use std::ops::Range;

use super::{ahead, queues::HitQueue};
use crate::flat::{FlatScene, NONE, ShadingClass, flags};

/// Key of paths that met nothing; those of hits are their shading class.
pub const MISS: usize = ShadingClass::COUNT;

/// Rows of a wave by key, piece by piece, and where each key's run starts.
#[derive(Clone, Debug, Default)]
pub struct Order {
    /// Rows of the wave, in each piece first all of class 0, then of class 1, …, then the misses.
    pub rows: Vec<u32>,
    /// Material row of each row of the wave.
    pub materials: Vec<u32>,
    /// Rows whose material emits.
    pub emissive: Vec<u32>,
    keys: Vec<u8>,
    /// Of each piece.
    starts: Vec<Starts>,
}

type Starts = [u32; MISS + 2];

impl Order {
    /// Makes room for waves of so many rows in pieces of so many.
    pub fn reserve(&mut self, rows: usize, piece: usize) {
        let columns = [&mut self.rows, &mut self.materials, &mut self.emissive];
        columns.into_iter().for_each(|column| column.reserve(rows.saturating_sub(column.len())));
        self.keys.reserve(rows.saturating_sub(self.keys.len()));
        self.starts.reserve(rows.div_ceil(piece.max(1)).saturating_sub(self.starts.len()));
    }

    /// Pieces that were sorted each for itself.
    pub fn pieces(&self) -> impl Iterator<Item = Piece<'_>> {
        self.starts.iter().map(|starts| Piece { rows: &self.rows, starts })
    }

    /// Rows with this key, by piece; only pieces that have some.
    pub fn runs(&self, key: usize) -> impl Iterator<Item = &[u32]> {
        self.pieces().map(move |piece| piece.run(key)).filter(|run| !run.is_empty())
    }

    /// Number of rows with this key.
    pub fn count(&self, key: usize) -> usize {
        self.runs(key).map(<[u32]>::len).sum()
    }
}

/// Rows that were sorted together.
#[derive(Clone, Copy)]
pub struct Piece<'a> {
    rows: &'a [u32],
    starts: &'a Starts,
}

impl<'a> Piece<'a> {
    /// Rows with this key.
    pub fn run(&self, key: usize) -> &'a [u32] {
        &self.rows[self.starts[key] as usize..self.starts[key + 1] as usize]
    }
}

/// Counting sort of each piece of so many rows: two passes over the keys, stable.
pub fn sort(scene: &FlatScene, hits: &HitQueue, piece: usize, asks_ahead: bool, order: &mut Order) {
    order.emissive.clear();
    order.starts.clear();
    order.rows.resize(hits.len(), 0);
    order.keys.resize(hits.len(), 0);
    order.materials.resize(hits.len(), NONE);
    if asks_ahead {
        ahead::rows(scene, hits);
    }
    for first in (0..hits.len()).step_by(piece.max(1)) {
        sort_piece(scene, hits, first..hits.len().min(first.saturating_add(piece)), order);
    }
}

fn sort_piece(scene: &FlatScene, hits: &HitQueue, piece: Range<usize>, order: &mut Order) {
    let mut counts = [0; MISS + 1];
    let rows = piece.clone().zip(&hits.instance[piece.clone()]).zip(&hits.triangle[piece.clone()]);
    let found = order.keys[piece.clone()].iter_mut().zip(&mut order.materials[piece.clone()]);
    for (((row, &instance), &triangle), (found_key, found_material)) in rows.zip(found) {
        let (mut key, mut material) = (MISS, NONE);
        if instance != NONE {
            material = scene.material_of(instance, triangle);
            if scene.materials.flags[material as usize] & flags::EMISSIVE != 0 {
                order.emissive.push(row as u32);
            }
            key = scene.materials.class[material as usize] as usize;
        }
        counts[key] += 1;
        (*found_key, *found_material) = (key as u8, material);
    }
    let mut next = [0; MISS + 1];
    let mut starts = [piece.start as u32; MISS + 2];
    for key in 0..=MISS {
        next[key] = starts[key];
        starts[key + 1] = starts[key] + counts[key];
    }
    order.starts.push(starts);
    for (row, &key) in piece.clone().zip(&order.keys[piece]) {
        let next = &mut next[key as usize];
        order.rows[*next as usize] = row as u32;
        *next += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wavefront::queues::HitRow;

    #[test]
    fn runs_hold_every_row_once_in_order_of_class() {
        let mut scene = FlatScene::default();
        for (instance, class) in [2, 0, 1].into_iter().enumerate() {
            scene.meshes.push(Default::default());
            scene.instances.push(crate::flat::Instance {
                mesh: instance as u32,
                material_base: instance as u32,
                ..Default::default()
            });
            scene.material_rows.push(instance as u32);
            scene.materials.push(crate::flat::MaterialRow { class, ..Default::default() });
        }
        let mut hits = HitQueue::default();
        for instance in [0, NONE, 1, 2, 0, NONE, 1] {
            hits.push(HitRow { instance, ..HitRow::default() });
        }
        let mut order = Order::default();
        let runs = |order: &Order, key| order.runs(key).map(<[u32]>::to_vec).collect::<Vec<_>>();
        sort(&scene, &hits, hits.len(), true, &mut order);
        let all = [0, 1, 2, MISS].map(|key| runs(&order, key));
        assert_eq!(all, [[[2, 6].to_vec()], [[3].to_vec()], [[0, 4].to_vec()], [[1, 5].to_vec()]]);
        assert_eq!(order.materials, [0, NONE, 1, 2, 0, NONE, 1]);
        // In pieces of three rows.
        sort(&scene, &hits, 3, true, &mut order);
        assert_eq!(order.pieces().count(), 3);
        assert_eq!(runs(&order, 0), [[2], [6]]);
        assert_eq!(runs(&order, MISS), [[1], [5]]);
        assert_eq!(order.count(2), 2);
        assert_eq!(order.materials, [0, NONE, 1, 2, 0, NONE, 1]);
    }
}
