//! Boxes along the axes against boxes that may be turned, around things that stand askew.

use std::{fmt::Write as _, hint::black_box, io::Write as _, time::Instant};

use serde_json::{Value, json};
use wavecast::{
    accel::{Bvh2, Nearest, Obb, Ray, RayList, Structure, Work, slanted},
    film::write_file,
};

use super::{Args, rays::Corners};
use crate::cli::{console::Console, error::CliError, progress::Steps};

/// What a structure does for rays among some triangles.
pub struct Fit {
    mesh: &'static str,
    triangles: usize,
    accel: &'static str,
    ns_per_ray: f64,
    nodes_per_ray: f64,
    triangles_per_ray: f64,
    build_seconds: f64,
    bytes: usize,
}

impl Fit {
    /// By the names of the columns.
    pub fn json(&self) -> Value {
        json!({
            "mesh": self.mesh,
            "triangles": self.triangles,
            "accel": self.accel,
            "ns_per_ray": self.ns_per_ray,
            "nodes_per_ray": self.nodes_per_ray,
            "triangles_per_ray": self.triangles_per_ray,
            "build_seconds": self.build_seconds,
            "bytes": self.bytes,
        })
    }
}

/// One structure over one mesh.
fn fit<S: Structure>(mesh: &'static str, triangles: &[Corners], rays: &RayList, runs: u32) -> Fit {
    let start = Instant::now();
    let structure = S::build(triangles);
    let build_seconds = start.elapsed().as_secs_f64();
    let mut work = Work::default();
    for &(origin, direction, t_max) in &rays.0 {
        structure.nearest(&Ray::new(origin, direction), &mut Nearest::none(t_max), |_, _| true, &mut work);
    }
    let mut seconds: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            for &(origin, direction, t_max) in &rays.0 {
                let mut best = Nearest::none(t_max);
                structure.nearest(&Ray::new(origin, direction), &mut best, |_, _| true, &mut ());
                black_box(best);
            }
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_unstable_by(f64::total_cmp);
    let count = rays.0.len() as f64;
    Fit {
        mesh,
        triangles: triangles.len(),
        accel: S::NAME,
        ns_per_ray: seconds[seconds.len() / 2] / count * 1e9,
        nodes_per_ray: work.nodes as f64 / count,
        triangles_per_ray: work.triangles as f64 / count,
        build_seconds,
        bytes: structure.bytes(),
    }
}

/// Rays of each mesh at most: enough for times, which more would not make any better.
pub const MOST: u32 = 1 << 16;

/// Both structures over hair, a railing and crates; tells each figure as soon as it is known.
pub fn measure(args: &Args, console: &Console) -> Result<Vec<Fit>, CliError> {
    let meshes: [(&str, Vec<Corners>); 3] =
        [("hair", slanted::hair(1000)), ("railing", slanted::railing(1000)), ("crates", slanted::crates(2000))];
    let steps = Steps::new(console.is_quiet());
    console.part(&heading());
    let mut fits = Vec::new();
    for (mesh, triangles) in &meshes {
        let rays = slanted::rays(triangles, args.rays.min(MOST) as usize, 1);
        for fit in [fit::<Bvh2>, fit::<Obb>] {
            steps.begin(format!("boxes along the axes and turned: {mesh}"), 0);
            let fit = fit(mesh, triangles, &rays, args.runs.unwrap_or(5));
            steps.above(|| console.part(&line(&fit)));
            fits.push(fit);
            if let Some(folder) = &args.output {
                write_file(&folder.join("boxes.csv"), |file| file.write_all(csv(&fits).as_bytes()))?;
            }
        }
    }
    Ok(fits)
}

/// One line for each.
fn csv(fits: &[Fit]) -> String {
    let mut text = "mesh,triangles,accel,ns_per_ray,nodes_per_ray,triangles_per_ray,build_seconds,bytes\n".to_owned();
    for fit in fits {
        let Fit { mesh, triangles, accel, ns_per_ray, nodes_per_ray, triangles_per_ray, build_seconds, bytes } = fit;
        let _ = writeln!(
            text,
            "{mesh},{triangles},{accel},{ns_per_ray},{nodes_per_ray},{triangles_per_ray},{build_seconds},{bytes}"
        );
    }
    text
}

/// For people.
fn heading() -> String {
    format!(
        "\n{:8} {:>9} {:6} {:>8} {:>9} {:>9} {:>8} {:>9}   boxes along the axes, and boxes that may be turned",
        "mesh", "triangles", "accel", "ns/ray", "nodes/ray", "tris/ray", "build s", "bytes/tri"
    )
}

/// What stands below [`heading`].
fn line(fit: &Fit) -> String {
    format!(
        "{:8} {:9} {:6} {:8.0} {:9.1} {:9.2} {:8.3} {:9.1}",
        fit.mesh,
        fit.triangles,
        fit.accel,
        fit.ns_per_ray,
        fit.nodes_per_ray,
        fit.triangles_per_ray,
        fit.build_seconds,
        fit.bytes as f64 / fit.triangles as f64
    )
}
