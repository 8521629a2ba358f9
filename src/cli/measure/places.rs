//! Where meters stand: on grids, over surfaces, behind pixels.

use wavecast::{
    flat::FlatScene,
    glam::DVec3,
    measure::meter::{Effort, Meters, read},
    render::Renderer,
    world::Scene,
};

use super::{Answer, Args, bake, entity, text_of};
use crate::cli::{args::Size, error::CliError, progress::Watcher};

/// Points that are read at once.
const MOST_POINTS: u64 = 1 << 20;
/// Points on a surface.
const POINTS_ON: usize = 1024;

/// Points along an edge: EN 12464-1 (2021, 4.4): p = 0.2 · 5^(log₁₀ d), d being the length of the edge, and at most 10 m.
fn points_along(length: f64) -> u32 {
    let spacing = (0.2 * 5_f64.powf(length.max(1e-3).log10())).min(10.0);
    ((length / spacing).round() as u32).max(1)
}

/// Illuminance on a grid over a parallelogram.
pub fn on_plane(
    flat: &FlatScene,
    [corner, u, v]: [DVec3; 3],
    grid: Option<Size>,
    effort: &Effort,
    watcher: &Watcher,
) -> Result<Answer, CliError> {
    let [columns, rows] = grid.map_or_else(
        || {
            // By the longer edge, unless the plane is much longer than wide; then along each by itself (as there).
            let (long, short) = (u.length().max(v.length()), u.length().min(v.length()));
            let of = |edge: f64| {
                if long / short < 2.0 {
                    (edge / (long / f64::from(points_along(long)))).round() as u32
                } else {
                    points_along(edge)
                }
            };
            [of(u.length()).max(1), of(v.length()).max(1)]
        },
        |size| size.0,
    );
    check_points("--lux-plane", [columns, rows])?;
    let n = u.cross(v).normalize();
    let at = |i: usize| {
        let (x, y) = (i as u32 % columns, i as u32 / columns);
        corner + u * ((f64::from(x) + 0.5) / f64::from(columns)) + v * ((f64::from(y) + 0.5) / f64::from(rows))
    };
    let places = (0..(columns * rows) as usize).map(|i| (at(i), n)).collect();
    let readings = read(flat, &Meters::Planes(places), effort, watcher);
    let name = format!("{} along {} and {}, {columns} × {rows} points", text_of(corner), text_of(u), text_of(v));
    Ok(Answer::new("lux-plane", name, "lx", readings).over([columns, rows], |i| text_of(at(i))))
}

/// Refuses more points than are read at once.
pub fn check_points(option: &str, [columns, rows]: [u32; 2]) -> Result<(), CliError> {
    let points = u64::from(columns) * u64::from(rows);
    if points <= MOST_POINTS {
        return Ok(());
    }
    Err(CliError::Usage(format!("{option}: {points} points are more than the {MOST_POINTS} that are read at once")))
}

/// Illuminance over an entity's surface.
pub fn on_entity(
    scene: &Scene,
    flat: &FlatScene,
    args: &Args,
    name: &str,
    effort: &Effort,
    watcher: &Watcher,
) -> Result<Answer, CliError> {
    let key = entity(scene, args, name)?;
    let instance = flat.instances.key.iter().position(|&other| other == key.0);
    let mesh = instance.map(|row| &flat.meshes[flat.instances.mesh[row] as usize]);
    let (Some(instance), Some(mesh)) = (instance, mesh.filter(|mesh| !mesh.triangles.is_empty())) else {
        return Err(CliError::Usage(format!("--on {name}: it has no triangles that are shown")));
    };
    let m = flat.instances.world_from_local[instance].map(f64::from);
    let world = |p: [f32; 3]| {
        let p = p.map(f64::from);
        let row = |i: usize| m[i] * p[0] + m[i + 1] * p[1] + m[i + 2] * p[2] + m[i + 3];
        DVec3::new(row(0), row(4), row(8))
    };
    let corners = |triangle: usize| mesh.corners(triangle as u32).map(world);
    // Evenly by area: one point in each of so many equal parts of the whole, and the golden ratio's sequence within.
    let mut areas = Vec::with_capacity(mesh.triangles.len());
    let mut total = 0.0;
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = corners(triangle);
        total += 0.5 * (b - a).cross(c - a).length();
        areas.push(total);
    }
    if total <= 0.0 {
        return Err(CliError::Usage(format!("--on {name}: it has no area")));
    }
    let place = |i: usize| {
        let at = (i as f64 + 0.5) / POINTS_ON as f64 * total;
        let triangle = areas.partition_point(|&sum| sum < at).min(areas.len() - 1);
        let before = if triangle == 0 { 0.0 } else { areas[triangle - 1] };
        let (r, s) = ((at - before) / (areas[triangle] - before), (0.5 + i as f64 * 0.618_033_988_75).fract());
        let root = r.sqrt();
        (triangle as u32, [(root * (1.0 - s)) as f32, (root * s) as f32])
    };
    let places: Vec<_> = (0..POINTS_ON).map(place).collect();
    let at = |i: usize| {
        let (triangle, [b1, b2]) = places[i];
        let [a, b, c] = corners(triangle as usize);
        text_of(a + (b - a) * f64::from(b1) + (c - a) * f64::from(b2))
    };
    let readings = read(flat, &Meters::On(instance as u32, places.clone()), effort, watcher);
    let at_name = format!("{name}, {POINTS_ON} points on {total:.4} m²");
    let mut answer = Answer::new("on", at_name, "lx", readings).over([POINTS_ON as u32, 1], at);
    if let Some(Size(size)) = args.bake {
        answer.baked = Some(bake::bake(flat, instance, name, size, effort, watcher)?);
    }
    Ok(answer)
}

/// Luminance of a part of the camera's picture.
pub fn of_region(
    renderer: &Renderer,
    [x, y, w, h]: [u32; 4],
    size: [u32; 2],
    effort: &Effort,
    watcher: &Watcher,
) -> Result<Answer, CliError> {
    let inside = |first: u32, length: u32, all: u32| first.checked_add(length).is_some_and(|end| end <= all);
    if !inside(x, w, size[0]) || !inside(y, h, size[1]) {
        return Err(CliError::Usage(format!(
            "--nit {x},{y},{w},{h} reaches beyond the picture of {} × {} pixels",
            size[0], size[1]
        )));
    }
    check_points("--nit", [w, h])?;
    let pixel = |i: usize| [x + i as u32 % w, y + i as u32 / w];
    let pixels: Vec<[u32; 2]> = (0..(w * h) as usize).map(pixel).collect();
    let readings = read(renderer.scene(), &Meters::Pixels(size, pixels), effort, watcher);
    let what =
        if w * h == 1 { format!("pixel {x},{y}") } else { format!("pixels {x},{y} to {},{}", x + w - 1, y + h - 1) };
    let answer = Answer::new("nit", format!("{what} of {}x{}", size[0], size[1]), "nit", readings);
    let name = |i: usize| format!("{},{}", pixel(i)[0], pixel(i)[1]);
    Ok(if w * h == 1 { answer } else { answer.over([w, h], name) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The standard's own table (EN 12464-1, annex): an edge of 1 m has 5 points, of 5 m about 8, of 10 m 10.
    #[test]
    fn grids_are_spaced_as_the_standard_says() {
        assert_eq!([0.4, 1.0, 2.0, 5.0, 10.0].map(points_along), [4, 5, 6, 8, 10]);
    }
}
