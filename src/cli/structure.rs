//! `--accel`, and what there is to say of the structure that meshes are in.

use std::time::Duration;

use clap::ValueEnum;
use serde_json::{Value, json};
use wavecast::{
    flat::FlatScene,
    render::{AccelKind, Quality},
};

use super::{args::value_name, error::CliError, memory};

/// The structure that rays are traced through.
#[derive(clap::Args, Clone, Copy, Debug, Default)]
pub struct AccelArgs {
    /// What meshes are put into for rays: all give the same picture, bvh8 in the shortest time
    #[arg(long, value_name = "NAME", value_enum, default_value_t = AccelArg::Bvh8)]
    accel: AccelArg,
    /// Time given to building bvh8 [default: good]
    #[arg(long, value_name = "QUALITY", value_enum)]
    build_quality: Option<QualityArg>,
}

impl AccelArgs {
    /// What was asked for.
    pub fn kind(&self) -> Result<AccelKind, CliError> {
        if let (true, Some(quality)) = (self.accel != AccelArg::Bvh8, self.build_quality) {
            return Err(CliError::Usage(format!(
                "--build-quality {} is for bvh8; {} is built in one way only, so leave it out",
                value_name(quality),
                value_name(self.accel)
            )));
        }
        Ok(match self.accel {
            AccelArg::Bvh8 => AccelKind::Bvh8(self.quality().into()),
            AccelArg::Bvh2 => AccelKind::Bvh2,
            AccelArg::Kdtree => AccelKind::KdTree,
            AccelArg::Octree => AccelKind::Octree,
            AccelArg::Bsp => AccelKind::Bsp,
            AccelArg::Grid => AccelKind::Grid,
            AccelArg::Brute => AccelKind::Brute,
        })
    }

    fn quality(&self) -> QualityArg {
        self.build_quality.unwrap_or_default()
    }

    /// What became of it, in a scene whose meshes took `build_time`.
    pub fn report(&self, scene: &FlatScene, build_time: Duration) -> AccelReport {
        let trees = || scene.meshes.iter().map(|mesh| &*mesh.blas);
        let binary: Option<Duration> = trees().map(|blas| blas.binary_time()).sum();
        let phases = binary.filter(|_| self.accel == AccelArg::Bvh8).map(|binary| {
            let all: Duration = trees().map(|blas| blas.build_time()).sum();
            [binary, all.saturating_sub(binary)]
        });
        AccelReport {
            name: value_name(self.accel),
            quality: (self.accel == AccelArg::Bvh8).then(|| value_name(self.quality())),
            build: build_time,
            phases,
            bytes: trees().map(|blas| blas.bytes()).sum(),
            triangles: scene.meshes.iter().map(|mesh| mesh.triangles.len()).sum(),
        }
    }
}

/// `--accel`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum AccelArg {
    /// Boxes, eight to a node, through which waves of rays go
    #[default]
    Bvh8,
    /// Boxes, two to a node
    Bvh2,
    /// Space halved by planes across the axes
    Kdtree,
    /// Cubes cut into eight
    Octree,
    /// Space halved by planes of any direction
    Bsp,
    /// Equal boxes
    Grid,
    /// Every triangle is tested
    Brute,
}

/// `--build-quality`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum QualityArg {
    Fast,
    #[default]
    Good,
    Best,
}

impl From<QualityArg> for Quality {
    fn from(quality: QualityArg) -> Self {
        match quality {
            QualityArg::Fast => Self::Fast,
            QualityArg::Good => Self::Good,
            QualityArg::Best => Self::Best,
        }
    }
}

/// What a structure costs.
pub struct AccelReport {
    name: String,
    quality: Option<String>,
    /// Wall time for all meshes.
    build: Duration,
    /// Of the eight-wide tree the time of the binary one and the rest, added up over meshes, which are built side by side.
    phases: Option<[Duration; 2]>,
    bytes: usize,
    triangles: usize,
}

impl AccelReport {
    fn bytes_per_triangle(&self) -> f64 {
        self.bytes as f64 / self.triangles.max(1) as f64
    }

    /// As part of `--stats` and `--json`.
    pub fn json(&self) -> Value {
        let phase = |which: usize| self.phases.map(|phases| phases[which].as_secs_f64());
        json!({
            "name": self.name,
            "quality": self.quality,
            "build_seconds": self.build.as_secs_f64(),
            "binary_seconds": phase(0),
            "collapse_seconds": phase(1),
            "bytes": self.bytes,
            "triangles": self.triangles,
            "bytes_per_triangle": self.bytes_per_triangle(),
        })
    }

    /// As a line for people.
    pub fn text(&self) -> String {
        let quality = self.quality.as_ref().map_or(String::new(), |quality| format!(" ({quality})"));
        format!(
            "structure of meshes: {}{quality}, built in {:.3} s, {}, {:.1} bytes per triangle",
            self.name,
            self.build.as_secs_f64(),
            memory::human(self.bytes),
            self.bytes_per_triangle()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(line: &str) -> AccelArgs {
        #[derive(clap::Parser)]
        struct Line {
            #[command(flatten)]
            args: AccelArgs,
        }
        <Line as clap::Parser>::try_parse_from(line.split_whitespace()).unwrap_or_else(|e| panic!("{line}: {e}")).args
    }

    /// Names are those of the library, and the default is the library's.
    #[test]
    fn every_structure_can_be_asked_for_by_its_name() {
        assert_eq!(parsed("x").kind().unwrap(), AccelKind::default());
        for kind in AccelKind::ALL {
            assert_eq!(parsed(&format!("x --accel {}", kind.name())).kind().unwrap(), kind);
        }
        assert_eq!(AccelArg::value_variants().len(), AccelKind::ALL.len());
        assert_eq!(parsed("x --build-quality best").kind().unwrap(), AccelKind::Bvh8(Quality::Best));
        assert_eq!(parsed("x --accel bvh8 --build-quality fast").kind().unwrap(), AccelKind::Bvh8(Quality::Fast));
    }
}
