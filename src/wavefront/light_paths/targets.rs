//! What light paths are aimed at: balls that hold all mirrors and clear glass.

use glam::Vec3;

use crate::flat::{FlatScene, NONE};

/// Most balls. Each light path looks at all of them.
const MOST: usize = 32;

/// Surfaces with a delta, of one material slot of one instance.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// Index into [`FlatScene::material_rows`].
    slot: u32,
    lower: Vec3,
    upper: Vec3,
}

/// A ball as seen from a point.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    /// Unit direction of its centre; none from inside it.
    pub towards: Option<Vec3>,
    /// 1 − cos of the half-angle that it fills.
    pub one_minus_cos: f32,
    /// How much it counts; 0 for what is below the horizon.
    pub weight: f32,
}

/// Balls with the surfaces that they hold; a surface belongs to one.
#[derive(Clone, Debug, Default)]
pub struct Targets {
    center: Vec<Vec3>,
    radius: Vec<f32>,
    /// The ball of each entry of [`FlatScene::material_rows`], or `NONE`.
    of_slot: Vec<u32>,
}

impl Targets {
    /// Those of a scene: what is made of materials with one of these flags.
    pub fn new(scene: &FlatScene, of: u32) -> Self {
        let mut parts = Vec::new();
        for instance in 0..scene.instances.len() {
            let mesh = &scene.meshes[scene.instances.mesh[instance] as usize];
            let base = scene.instances.material_base[instance];
            for slot in (0..mesh.slot_count.max(1)).filter(|&slot| is_one(scene, base + slot, of)) {
                parts.extend(bounds(scene, instance, slot).map(|(lower, upper)| Part {
                    slot: base + slot,
                    lower,
                    upper,
                }));
            }
        }
        let mut targets = Self { of_slot: vec![NONE; scene.material_rows.len()], ..Self::default() };
        for (row, group) in groups(parts).iter().enumerate() {
            let (lower, upper) = hull(group);
            targets.center.push(0.5 * (lower + upper));
            // A little more, for the rounding of hits.
            targets.radius.push(0.5 * (upper - lower).length() * 1.001);
            group.iter().for_each(|part| targets.of_slot[part.slot as usize] = row as u32);
        }
        targets
    }

    /// Balls.
    pub fn len(&self) -> usize {
        self.center.len()
    }

    /// Centres and radii.
    pub fn balls(&self) -> impl Iterator<Item = (Vec3, f32)> {
        self.center.iter().copied().zip(self.radius.iter().copied())
    }

    /// The ball that a triangle belongs to, or `NONE`.
    #[inline]
    pub fn of(&self, scene: &FlatScene, instance: u32, triangle: u32) -> u32 {
        let mesh = &scene.meshes[scene.instances.mesh[instance as usize] as usize];
        let slot = mesh.slots.get(triangle as usize).copied().unwrap_or(0);
        self.of_slot[scene.instances.material_base[instance as usize] as usize + slot as usize]
    }

    /// A ball as seen from a point of a surface with this normal.
    #[inline]
    pub fn aim(&self, row: usize, p: Vec3, n: Vec3) -> Aim {
        let to = self.center[row] - p;
        let (distance2, radius) = (to.length_squared(), self.radius[row]);
        let sin2 = radius * radius / distance2;
        // From inside, from so near that it fills half of the sky or more, and of what has no end.
        let outside = sin2 < 0.75;
        if !outside {
            return Aim { towards: None, one_minus_cos: 1.0, weight: 1.0 };
        }
        let towards = to / distance2.sqrt();
        let one_minus_cos = sin2 / (1.0 + (1.0 - sin2).sqrt());
        // Of the ball the part above the horizon is known to be there as long as its centre is not a radius below.
        let (cos, sin) = (towards.dot(n), sin2.sqrt());
        let weight = if cos > -sin { one_minus_cos * (cos + sin) / (1.0 + sin) } else { 0.0 };
        Aim { towards: Some(towards), one_minus_cos, weight }
    }
}

fn is_one(scene: &FlatScene, slot: u32, of: u32) -> bool {
    scene.materials.flags[scene.material_rows[slot as usize] as usize] & of != 0
}

/// Corners of the box around the triangles of a slot in the world; none if there are none.
fn bounds(scene: &FlatScene, instance: usize, slot: u32) -> Option<(Vec3, Vec3)> {
    let mesh = &scene.meshes[scene.instances.mesh[instance] as usize];
    if mesh.shape.is_some() || mesh.slot_count <= 1 {
        return Some(scene.box_of(instance));
    }
    let mut hull = None;
    for (triangle, _) in mesh.slots.iter().enumerate().filter(|&(_, &of)| u32::from(of) == slot) {
        for corner in mesh.corners(triangle as u32) {
            let p = scene.placed(instance, Vec3::from(corner));
            let (lower, upper): (Vec3, Vec3) = hull.unwrap_or((p, p));
            hull = Some((lower.min(p), upper.max(p)));
        }
    }
    hull
}

fn hull(parts: &[Part]) -> (Vec3, Vec3) {
    parts.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), part| (lo.min(part.lower), hi.max(part.upper)))
}

/// Neighbours together, in [`MOST`] groups at most: the widest is halved until there are as many.
fn groups(parts: Vec<Part>) -> Vec<Vec<Part>> {
    let mut groups = if parts.is_empty() { Vec::new() } else { vec![parts] };
    let extent = |group: &Vec<Part>| {
        let (lower, upper) = hull(group);
        if group.len() > 1 { (upper - lower).max_element() } else { 0.0 }
    };
    while groups.len() < MOST {
        let widest = (0..groups.len()).max_by(|&a, &b| extent(&groups[a]).total_cmp(&extent(&groups[b])));
        let Some(widest) = widest.filter(|&row| groups[row].len() > 1) else { break };
        let (lower, upper) = hull(&groups[widest]);
        let axis = if (upper - lower).is_finite() { (upper - lower).max_position() } else { 0 };
        let middle = |part: &Part| part.lower[axis] + part.upper[axis];
        groups[widest].sort_by(|a, b| middle(a).total_cmp(&middle(b)));
        let half = groups[widest].len() / 2;
        let rest = groups[widest].split_off(half);
        groups.push(rest);
    }
    groups
}
