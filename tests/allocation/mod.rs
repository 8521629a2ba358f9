//! Stages work in the memory that the queues already have.

use wavecast::{
    film::{Film, Unit},
    render::{LayerKind, RenderSettings, Renderer},
    wavefront::{Job, Worker},
    world::units::Nit,
};

use crate::common::{settings, varied};

/// Allocations of a worker that renders each tile of `varied` for the `pass`-th time.
fn allocations(settings: &RenderSettings, passes: u32) -> Vec<u64> {
    let mut renderer = Renderer::new();
    renderer.sync(&mut varied());
    let unit = Unit::for_emission(Nit(1e3));
    let mut film = Film::new(settings, unit);
    let job = Job::new(renderer.scene(), settings, unit);
    let mut worker = Worker::default();
    let mut pass = |pass: u32| {
        let all_tiles = || film.tiles.iter_mut().for_each(|tile| worker.run(&job, tile, pass * 16, pass * 16 + 16, 1));
        allocation_counter::measure(all_tiles).count_total
    };
    (0..passes).map(&mut pass).collect()
}

#[test]
fn stages_do_not_allocate_once_they_are_warm() {
    let layers = vec![LayerKind::Albedo, LayerKind::Normal, LayerKind::Depth, LayerKind::EntityId];
    let plain = settings(64, 16);
    for settings in [RenderSettings { layers, transparent: true, ..plain.clone() }, plain] {
        let counts = allocations(&settings, 6);
        assert!(counts[0] > 0, "the first pass is seen to make the queues");
        assert_eq!(counts[1..], [0; 5]);
    }
}
