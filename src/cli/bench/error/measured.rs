//! Renders as an error.csv has them.

use std::path::{Path, PathBuf};

use super::{STATISTICS, report::Render};
use crate::cli::error::CliError;

/// What a comparison needs to know of a render.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    pub scene: String,
    /// Of the reference: decides whether two renders can be compared.
    pub key: String,
    pub threads: usize,
    pub spp: u32,
    pub seconds: f64,
    /// Plain and trimmed.
    pub relmse: [f64; 2],
}

impl From<&Render> for Measured {
    fn from(render: &Render) -> Self {
        let Render { threads, spp, seconds, relmse, .. } = *render;
        Self { scene: render.scene.clone(), key: render.key.clone(), threads, spp, seconds, relmse }
    }
}

/// Reads several tables as one.
pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Measured>, CliError> {
    let mut all = Vec::new();
    for path in paths {
        all.extend(read(path)?);
    }
    Ok(all)
}

/// Reads an error.csv.
fn read(path: &Path) -> Result<Vec<Measured>, CliError> {
    let broken = |problem: String| CliError::Table { path: path.to_owned(), problem };
    let mut reader = csv::Reader::from_path(path).map_err(|error| broken(error.to_string()))?;
    let headers = reader.headers().map_err(|error| broken(error.to_string()))?.clone();
    let column = |name: &str| {
        headers.iter().position(|header| header == name).ok_or_else(|| broken(format!("there is no column {name}")))
    };
    let (scene, key, threads, spp, seconds) =
        (column("scene")?, column("key")?, column("threads")?, column("spp")?, column("seconds")?);
    let relmse = [column(STATISTICS[0])?, column(STATISTICS[1])?];
    let mut all = Vec::new();
    for (row, record) in reader.records().enumerate() {
        let record = record.map_err(|error| broken(error.to_string()))?;
        let bad = |column: usize| broken(format!("row {}: {:?} is no {}", row + 1, &record[column], &headers[column]));
        // What is not finite has no way of being written.
        let error = |column: usize| match &record[column] {
            "" => Ok(f64::NAN),
            text => text.parse::<f64>().map_err(|_| bad(column)),
        };
        all.push(Measured {
            scene: record[scene].to_owned(),
            key: record[key].to_owned(),
            threads: record[threads].parse().map_err(|_| bad(threads))?,
            spp: record[spp].parse().map_err(|_| bad(spp))?,
            seconds: record[seconds].parse().ok().filter(|s: &f64| *s > 0.0).ok_or_else(|| bad(seconds))?,
            relmse: [error(relmse[0])?, error(relmse[1])?],
        });
    }
    if all.is_empty() { Err(broken("it has no rows".into())) } else { Ok(all) }
}

#[cfg(test)]
mod tests {
    use wavecast::render::SamplerKind;

    use super::*;
    use crate::cli::bench::report::csv;

    fn render() -> Render {
        Render {
            scene: "a \"b\", c.gltf".into(),
            key: "12ab".into(),
            size: [8, 4],
            threads: 2,
            sampler: SamplerKind::Independent,
            max_depth: Some(5),
            spp: 16,
            seed: 1 << 33,
            seconds: 0.125,
            mpaths_per_second: 4.096e-3,
            mrays_per_second: [1.0, 2.0, 3.0],
            relmse: [0.1, f64::NAN],
            reference_spp: 1024,
            reference_relmse: [1e-5, 1e-6],
        }
    }

    /// What is not a number comes back as such, and is not a row that cannot be read.
    #[test]
    fn tables_come_back_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("error.csv");
        std::fs::write(&path, csv([render(), render()].iter().map(Render::json))).unwrap();
        let all = read(&path).unwrap();
        let want = Measured::from(&render());
        assert_eq!((all.len(), &all[1].scene, &all[1].key), (2, &want.scene, &want.key));
        assert_eq!((all[0].threads, all[0].spp, all[0].seconds, all[0].relmse[0]), (2, 16, 0.125, 0.1));
        assert!(all[0].relmse[1].is_nan());
    }

    #[test]
    fn other_tables_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("error.csv");
        let said = |text: &str| {
            std::fs::write(&path, text).unwrap();
            read(&path).unwrap_err().to_string()
        };
        let head = "scene,key,threads,spp,seconds,relmse,relmse_trimmed\n";
        assert!(said("scene,rays\na,1\n").contains("there is no column key"));
        assert!(said(head).contains("no rows"));
        assert!(said(&format!("{head}a,k,1,4,0.0,0.1,0.1\n")).contains("row 1: \"0.0\" is no seconds"));
        assert!(said(&format!("{head}a,k,1,4,0.5,x,0.1\n")).contains("\"x\" is no relmse"));
        assert!(said(&format!("{head}a,k,1\n")).contains("not a table"));
        assert!(read(&folder.path().join("none.csv")).unwrap_err().to_string().contains("none.csv"));
    }
}
