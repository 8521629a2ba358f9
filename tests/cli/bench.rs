//! Measurements, for what does not depend on the machine.

use serde_json::Value;

use super::{Folder, line, wavecast};

/// The keys and values of `bench accel --json`: each structure has answered all kinds of rays as brute force does, and
/// divides what it should.
#[test]
fn structures_are_measured_and_checked() {
    let folder = Folder::new();
    let run = wavecast([
        "bench",
        "accel",
        "scenes/gallery.glb",
        "--json",
        "--rays",
        "256",
        "--runs",
        "1",
        "-o",
        folder.at("").to_str().unwrap(),
    ])
    .expect(0);
    let result: Value = serde_json::from_str(&run.stdout).unwrap();
    let rows = result["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 7 * 4);
    for row in rows {
        let (name, number) = (row["accel"].as_str().unwrap(), |key: &str| row[key].as_f64().unwrap());
        assert!(["primary", "bounce1", "bounce3", "shadow"].contains(&row["rays"].as_str().unwrap()));
        assert!(number("checked") > 30.0 && number("mismatches") == 0.0, "{row}");
        assert!(number("mrays_per_second") > 0.0 && number("build_seconds") > 0.0 && number("bytes") > 1e6, "{row}");
        let divides_objects = ["bvh8", "bvh2", "obb"].contains(&name);
        assert_eq!(number("references") == number("triangles"), divides_objects, "{row}");
        // Brute force would test all of a quarter of a million.
        assert!((1.0..1000.0).contains(&number("triangles_per_ray")) && number("nodes_per_ray") > 1.0, "{row}");
    }
    let csv = std::fs::read_to_string(folder.at("accel.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    assert!(csv.starts_with("scene,triangles,accel,rays,"), "{csv}");
}

/// The keys and values of `bench kernels --json`: the textbook's test takes what textbooks say and loses rays, ours and the
/// structures lose none.
#[test]
fn kernels_are_measured_and_watertight() {
    let folder = Folder::new();
    let (rays, path) = ("4096", folder.at(""));
    let run = wavecast(["bench", "kernels", "--json", "--rays", rays, "--runs", "1", "-o", path.to_str().unwrap()]);
    let result: Value = serde_json::from_str(&run.expect(0).stdout).unwrap();
    let tests = result["tests"].as_array().unwrap();
    let stored = tests.iter().find(|row| row["test"] == "moller-trumbore, edges stored").unwrap();
    // 17 additions for the barycentrics of two corners and the distance, 2 for the third.
    assert_eq!(["divisions", "multiplications", "additions"].map(|key| stored[key].as_u64().unwrap()), [1, 27, 19]);
    assert!(tests.iter().all(|row| row["ns"].as_f64().unwrap() > 0.0));
    let rows = result["watertight"].as_array().unwrap();
    let structures = rows.len() / 6 - 2;
    assert_eq!(rows.len(), 3 * 2 * 2 + structures * 3 * 2);
    for row in rows {
        let (subject, misses) = (row["subject"].as_str().unwrap(), row["misses"].as_u64().unwrap());
        assert_eq!(row["trials"], 4096);
        assert_eq!(row["bound"].is_null(), misses > 0);
        assert!(subject != "moller-trumbore test" || misses > 0, "{row}");
        assert!(["plane test", "moller-trumbore test"].contains(&subject) || misses == 0, "{row}");
    }
    let totals = result["watertight_totals"].as_array().unwrap();
    assert_eq!(totals.len(), 3 + structures);
    for total in totals {
        let of_subject: Vec<_> = rows.iter().filter(|row| row["subject"] == total["subject"]).collect();
        let sum = |key: &str| of_subject.iter().map(|row| row[key].as_u64().unwrap()).sum::<u64>();
        assert_eq!(["trials", "misses"].map(|key| total[key].as_u64().unwrap()), ["trials", "misses"].map(sum));
    }
    // Thin slanted things are what turned boxes are for.
    let boxes = result["boxes"].as_array().unwrap();
    for pair in boxes.chunks(2).take(2) {
        let [upright, turned] = [0, 1].map(|i| pair[i]["triangles_per_ray"].as_f64().unwrap());
        assert!(turned < 0.5 * upright, "{pair:?}");
    }
    let lines = |name: &str| std::fs::read_to_string(folder.at(name)).unwrap().lines().count();
    assert_eq!((lines("kernels.csv"), lines("watertight.csv")), (tests.len() + 1, rows.len() + 1));
    assert_eq!(lines("boxes.csv"), boxes.len() + 1);
}

/// People get the same tables, with a line for what each structure was asked in all.
#[test]
fn kernels_are_told_row_by_row() {
    let run = line("bench kernels --rays 64 --runs 1 --accel octree").expect(0);
    let lines = |start: &str| run.stdout.lines().filter(|line| line.starts_with(start)).count();
    assert_eq!((lines("octree "), lines("octree: none of 384 rays missed")), (3 * 2, 1));
    assert_eq!((lines("plane "), lines("hair "), lines("crates ")), (1 + 4 + 1, 2, 2));
}

/// Scenes without files, sizes, threads, plots: rows for each, and a word on what was left out.
#[test]
fn generated_scenes_grow_until_builds_take_too_long() {
    let folder = Folder::new();
    let words =
        "bench accel hall foliage --growth=1e3,2e3,4e3 --build-limit 1e-9 --accel bvh8,kdtree --rays 64 --runs 1";
    let out = folder.at("");
    let run = wavecast(words.split(' ').chain(["--scaling", "1,2", "--json", "-o", out.to_str().unwrap()])).expect(0);
    let result: Value = serde_json::from_str(&run.stdout).unwrap();
    let rows = result["rows"].as_array().unwrap();
    // Two scenes, two structures, four kinds of rays, one and two threads; only the first size.
    assert_eq!(rows.len(), 2 * 2 * 4 * 2);
    for row in rows {
        assert!((850.0..1150.0).contains(&row["triangles"].as_f64().unwrap()), "{row}");
        assert_eq!(row["mismatches"], 0, "{row}");
        assert!(row["over_embree"].is_null(), "{row}");
    }
    assert_eq!(result["stopped"].as_array().unwrap().len(), 2 * 2);
    assert_eq!(folder.names(), ["growth-foliage.svg", "growth-hall.svg", "growth.csv", "growth.md"]);
    line("bench accel scenes/cornell.gltf --growth").expect(2).says("cannot grow");
}

/// A picture for each structure with cells, none for brute force, and the cells are cut where they were to be.
#[test]
fn cells_of_structures_are_drawn() {
    let folder = Folder::new();
    let out = folder.at("");
    let run = |more: &str| {
        let words = ["bench", "accel", "hall:1e3", "--draw", out.to_str().unwrap()];
        wavecast(words.into_iter().chain(more.split(' '))).expect(0)
    };
    run("--slice y=1.5");
    let names = ["bsp", "bvh2", "bvh8", "grid", "kdtree", "obb", "octree"].map(|name| format!("hall-1000-{name}.svg"));
    assert_eq!(folder.names(), names);
    let drawn = || names.each_ref().map(|name| std::fs::read_to_string(folder.at(name)).unwrap());
    let first = drawn();
    assert!(first.iter().all(|svg| svg.matches("<polygon").count() > 10 && svg.ends_with("</svg>\n")));
    run("--slice y=2.5");
    assert!(first.iter().zip(drawn()).all(|(a, b)| *a != b));
}

/// What is made on the spot, and a copy of a file with a camera; both can be rendered.
#[test]
fn scenes_are_written_for_others_to_render() {
    let folder = Folder::new();
    let out = folder.at("");
    let words = ["hall:1e3", "scenes/gallery.glb", "--view=0,1,3,0,1,0", "--write-scenes", out.to_str().unwrap()];
    wavecast(["bench", "accel"].into_iter().chain(words)).expect(0);
    assert_eq!(folder.names(), ["gallery-view.glb", "hall-1000.glb"]);
    for name in folder.names() {
        let (scene, picture) = (folder.at(&name), folder.at("picture.exr"));
        let files = [scene.to_str().unwrap(), "-o", picture.to_str().unwrap()];
        wavecast(["render", "--size", "8x8", "--spp", "1", "--camera", "view"].into_iter().chain(files)).expect(0);
    }
    let words = ["bench", "accel", "scenes/gallery.glb", "--write-scenes", out.to_str().unwrap()];
    wavecast(words).expect(2).says("--view gives it a camera");
}

/// The keys and values of `bench wavefront --json`: every way to make the picture is there and compared, blocks are full
/// where waves are sorted, and less so where they are not.
#[test]
fn the_wavefront_is_measured_against_one_path_and_the_reference() {
    let folder = Folder::new();
    let out = folder.at("");
    let words = "bench wavefront scenes/gallery.glb scenes/cornell.gltf --size 32x32 --spp 8 --runs 1 --scaling 1,2";
    let run = wavecast(words.split(' ').chain(["--json", "-o", out.to_str().unwrap()])).expect(0);
    let result: Value = serde_json::from_str(&run.stdout).unwrap();
    let rows = result["rows"].as_array().unwrap();
    // Three modes, sorted or not, one or two threads, waves of 2³ to 2¹⁷ paths.
    assert_eq!(rows.len(), 2 * (3 + 2 + 2 + 15));
    for row in rows {
        let number = |key: &str| row[key].as_f64();
        assert!(number("mpaths_per_second").unwrap() > 0.0 && number("queue_bytes").unwrap() > 0.0, "{row}");
        assert!(number("first_over_min") <= number("first_over") && number("first_over") <= number("first_over_max"));
        // Each path has at least one ray; the reference does not count.
        assert_eq!(number("mrays_per_second").is_none(), row["mode"] == "reference", "{row}");
        assert!(number("mrays_per_second").is_none_or(|rays| rays >= number("mpaths_per_second").unwrap()), "{row}");
    }
    let of = |part: &str, key: &str| -> Vec<Value> {
        rows.iter().filter(|row| row["part"] == part).map(|row| row[key].clone()).take(15).collect()
    };
    assert_eq!(of("modes", "mode")[..3], ["wavefront", "one-path", "reference"]);
    assert_eq!(of("sort", "sorted")[..2], [true, false]);
    assert_eq!(of("threads", "threads")[..2], [1, 2]);
    assert_eq!(of("wave-size", "wave_size")[..2], [2048, 8]);
    assert_eq!(rows[0]["first_over"], 1.0);
    let stages = result["stages"].as_array().unwrap();
    let stage = |name: &str| stages.iter().find(|stage| stage["stage"] == name).unwrap();
    // 1024 pixels and 8 samples are 1024 blocks, but for those that the end of a wave cuts in two.
    let [rows, blocks, fill] = ["rows", "blocks", "lane_fill"].map(|key| stage("generate")[key].as_f64().unwrap());
    assert!(
        rows == 8192.0 && (1024.0..1064.0).contains(&blocks) && (fill - rows / (8.0 * blocks)).abs() < 1e-12,
        "{blocks} {fill}"
    );
    let [sorted, unsorted] = ["lane_fill", "lane_fill_unsorted"].map(|key| stage("shade")[key].as_f64().unwrap());
    assert!(sorted > 0.9 && unsorted < 0.9 * sorted, "{sorted} {unsorted}");
    assert!(stage("intersect")["lane_fill"].is_null() && stage("intersect")["rows"].as_u64().unwrap() > 8192);
    let shares: f64 = stages.iter().map(|stage| stage["share"].as_f64().unwrap()).sum();
    assert!((shares - 2.0).abs() < 1e-6, "{shares} for two scenes");
    let lines = |name: &str| std::fs::read_to_string(folder.at(name)).unwrap().lines().count();
    assert_eq!((lines("wavefront.csv"), lines("wavefront-stages.csv")), (2 * 22 + 1, stages.len() + 1));
    assert_eq!(
        folder.names(),
        ["stages.svg", "wave-size.svg", "wavefront-stages.csv", "wavefront.csv", "wavefront.md"]
    );
    line("bench wavefront").expect(2).says("SCENE");
}
