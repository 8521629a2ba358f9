//! What light paths went through, for scenes in which solids absorb, and for layers that tell what happened to light.
//!
//! Which solid a ray is inside is known by the way that the camera's paths came: so it is found out, vertex by vertex back to
//! the emitter, when the camera sees one.

use crate::{
    film::{Automaton, Event},
    flat::{FlatScene, NONE, flags},
    wavefront::{absorb::medium_of, shade::medium_behind},
};

/// A vertex of a light path.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// The vertex before it, or `NONE` for one on an emitter.
    pub before: u32,
    /// Row of the material; `NONE` where the path has only passed a surface that has no back.
    pub material: u32,
    /// The camera's side is the back.
    pub back: bool,
    /// Light went through the surface.
    pub transmitted: bool,
    /// From the vertex before, m.
    pub t: f32,
    /// What the surface did, by channel; where layers tell.
    pub events: [Event; 3],
}

/// Vertices of all paths of a wave.
#[derive(Clone, Debug, Default)]
pub struct History(pub Vec<Node>);

impl History {
    /// Adds a vertex.
    pub fn push(&mut self, node: Node) -> u32 {
        self.0.push(node);
        self.0.len() as u32 - 1
    }

    /// States of the automaton after all that happened, from the camera on.
    pub fn way(&self, automaton: &Automaton, last: Node) -> [u16; 3] {
        let (mut states, mut node) = ([Automaton::START; 3], last);
        while node.before != NONE {
            if node.material != NONE {
                (0..3).for_each(|c| states[c] = automaton.after(states[c], node.events[c]));
            }
            node = self.0[node.before as usize];
        }
        states
    }

    /// Share of light that arrives at the camera, `distance` m away from the vertex `last`.
    pub fn transmittance(&self, scene: &FlatScene, last: Node, distance: f32) -> [f32; 3] {
        let (mut optical, mut carried, mut node, mut t) = ([0.0_f32; 3], NONE, last, distance);
        loop {
            if node.before == NONE && node.material == NONE {
                // From the sky to the first surface nothing absorbs.
                return optical.map(|x| (-x).exp());
            }
            let medium = medium_of(scene, carried, node.material, node.back);
            if medium != NONE {
                let absorption = scene.materials.absorption[medium as usize];
                (0..3).for_each(|i| optical[i] += absorption[i] * t);
            }
            if node.before == NONE {
                return optical.map(|x| (-x).exp());
            }
            let solid = scene.materials.flags[node.material as usize] & flags::SOLID != 0;
            carried = medium_behind(carried, node.material, solid, solid && node.back, node.transmitted);
            (t, node) = (node.t, self.0[node.before as usize]);
            while node.material == NONE && node.before != NONE {
                (t, node) = (t + node.t, self.0[node.before as usize]);
            }
        }
    }
}
