//! Orders the hits of a wave by what shading they need.

use super::{ahead, queues::HitQueue};
use crate::flat::{FlatScene, NONE, ShadingClass, flags};

/// Key of paths that met nothing; those of hits are their shading class.
pub const MISS: usize = ShadingClass::COUNT;

/// Rows of a wave by key, and where each key's run starts.
#[derive(Clone, Debug, Default)]
pub struct Order {
    /// Rows of the wave: first all of class 0, then of class 1, …, then the misses.
    pub rows: Vec<u32>,
    /// Material row of each row of the wave.
    pub materials: Vec<u32>,
    /// Rows whose material emits.
    pub emissive: Vec<u32>,
    keys: Vec<u8>,
    starts: [usize; MISS + 2],
}

impl Order {
    /// Makes room for waves of so many rows.
    pub fn reserve(&mut self, rows: usize) {
        let columns = [&mut self.rows, &mut self.materials, &mut self.emissive];
        columns.into_iter().for_each(|column| column.reserve(rows.saturating_sub(column.len())));
        self.keys.reserve(rows.saturating_sub(self.keys.len()));
    }

    /// Rows with this key.
    pub fn run(&self, key: usize) -> &[u32] {
        &self.rows[self.starts[key]..self.starts[key + 1]]
    }
}

/// Counting sort: two passes over the keys, stable.
pub fn sort(scene: &FlatScene, hits: &HitQueue, asks_ahead: bool, order: &mut Order) {
    order.keys.clear();
    order.materials.clear();
    order.emissive.clear();
    let mut counts = [0_usize; MISS + 1];
    for i in 0..hits.len() {
        let instance = hits.instance[i];
        let (key, material) = if instance == NONE {
            (MISS, NONE)
        } else {
            let material = scene.material_of(instance, hits.triangle[i]);
            if asks_ahead {
                ahead::row(scene, instance, hits.triangle[i]);
            }
            if scene.materials.flags[material as usize] & flags::EMISSIVE != 0 {
                order.emissive.push(i as u32);
            }
            (scene.materials.class[material as usize] as usize, material)
        };
        counts[key] += 1;
        order.keys.push(key as u8);
        order.materials.push(material);
    }
    let mut next = [0; MISS + 1];
    order.starts[0] = 0;
    for key in 0..=MISS {
        next[key] = order.starts[key];
        order.starts[key + 1] = order.starts[key] + counts[key];
    }
    order.rows.resize(hits.len(), 0);
    for (row, &key) in order.keys.iter().enumerate() {
        order.rows[next[key as usize]] = row as u32;
        next[key as usize] += 1;
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
        sort(&scene, &hits, true, &mut order);
        assert_eq!(order.run(0), [2, 6]);
        assert_eq!(order.run(1), [3]);
        assert_eq!(order.run(2), [0, 4]);
        assert_eq!(order.run(MISS), [1, 5]);
        assert_eq!(order.materials, [0, NONE, 1, 2, 0, NONE, 1]);
    }
}
