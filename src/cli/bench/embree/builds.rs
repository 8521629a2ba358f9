//! Builds, refits and top levels of Embree's.

use std::{path::Path, ptr, sync::Arc, time::Instant};

use super::{
    super::{
        builds::{Ground, Timed},
        peers::Described,
        rays::Corners,
    },
    api::{Api, HIGH, Handle, INSTANCE, LOW, MATRIX, MEDIUM, Mesh, REFIT, VERTICES, open},
};
use crate::cli::error::CliError;

/// Opens the library and says what it is.
pub fn build_peers(path: &Path) -> Described<Ground, Timed> {
    let api = Arc::new(open(path)?);
    let path = path.to_owned();
    let failed = move |problem| CliError::Library { path: path.clone(), problem };
    let described = Mesh::empty(&api, 0, HIGH).map_err(&failed)?.describe();
    let peers = move |ground: &Ground| {
        let mut all = Vec::new();
        for (name, quality) in [("embree-low", LOW), ("embree-medium", MEDIUM), ("embree-high", HIGH)] {
            let (api, triangles, failed) = (api.clone(), ground.triangles.clone(), failed.clone());
            let run = move || Mesh::build(&api, &triangles, 0, quality).map(|(_, s)| (s, None)).map_err(&failed);
            all.push(Timed { what: "build", name, run: Box::new(run) });
        }
        let mut moving = Moving::new(&api, &ground.triangles).map_err(&failed)?;
        let (mut there_and_back, error) = ([ground.moved.clone(), ground.triangles.clone()], failed.clone());
        let refit = move || {
            let seconds = moving.refit(&there_and_back[0]).map_err(&error)?;
            there_and_back.swap(0, 1);
            Ok((seconds, None))
        };
        all.push(Timed { what: "refit", name: "embree", run: Box::new(refit) });
        let (mesh, _) = Mesh::build(&api, &ground.triangles, 0, MEDIUM).map_err(&failed)?;
        let (places, error) = (ground.places.clone(), failed.clone());
        let place = move || mesh.place(&places).map(|seconds| (seconds, None)).map_err(&error);
        all.push(Timed { what: "instances", name: "embree", run: Box::new(place) });
        Ok(all)
    };
    Ok((Box::new(peers), Some(described)))
}

/// A mesh whose corners move. Embree refits in scenes of low quality only.
struct Moving {
    mesh: Mesh,
    geometry: Handle,
    vertices: *mut Corners,
    triangles: usize,
}

impl Moving {
    #[allow(unsafe_code)]
    fn new(api: &Arc<Api>, triangles: &[Corners]) -> Result<Self, String> {
        let mesh = Mesh::empty(api, 0, LOW)?;
        let (geometry, vertices) = mesh.geometry(triangles)?;
        // SAFETY: the functions are called as the manual has it; the scene keeps the geometry.
        unsafe {
            (api.geometry_quality)(geometry, REFIT);
            (api.commit_geometry)(geometry);
            (api.attach_geometry)(mesh.scene, geometry);
            (api.release_geometry)(geometry);
            (api.commit_scene)(mesh.scene);
        }
        mesh.checked()?;
        Ok(Self { mesh, geometry, vertices, triangles: triangles.len() })
    }

    /// How long it took once the triangles were there.
    #[allow(unsafe_code)]
    fn refit(&mut self, triangles: &[Corners]) -> Result<f64, String> {
        assert_eq!(triangles.len(), self.triangles);
        let api = &self.mesh.api;
        // SAFETY: there are as many triangles as the buffer was made for; the scene has the geometry.
        let start = unsafe {
            if !triangles.is_empty() {
                ptr::copy_nonoverlapping(triangles.as_ptr(), self.vertices, triangles.len());
            }
            (api.update_buffer)(self.geometry, VERTICES.0, 0);
            let start = Instant::now();
            (api.commit_geometry)(self.geometry);
            (api.commit_scene)(self.mesh.scene);
            start
        };
        let seconds = start.elapsed().as_secs_f64();
        self.mesh.checked()?;
        Ok(seconds)
    }
}

impl Mesh {
    /// A scene of instances of this one: how long its commit takes once they are there.
    #[allow(unsafe_code)]
    fn place(&self, places: &[[[f32; 12]; 2]]) -> Result<f64, String> {
        let api = &self.api;
        // SAFETY: the functions are called as the manual has it; matrices are of twelve numbers and copied at once.
        let seconds = unsafe {
            let scene = (api.new_scene)(self.device);
            (api.scene_quality)(scene, MEDIUM);
            for [world_from_local, _] in places {
                let instance = (api.new_geometry)(self.device, INSTANCE);
                (api.instanced_scene)(instance, self.scene);
                (api.transform)(instance, 0, MATRIX, world_from_local.as_ptr().cast());
                (api.commit_geometry)(instance);
                (api.attach_geometry)(scene, instance);
                (api.release_geometry)(instance);
            }
            let start = Instant::now();
            (api.commit_scene)(scene);
            let seconds = start.elapsed().as_secs_f64();
            (api.release_scene)(scene);
            seconds
        };
        self.checked()?;
        Ok(seconds)
    }
}
