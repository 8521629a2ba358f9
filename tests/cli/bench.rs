//! Measurements, for what does not depend on the machine.

use serde_json::Value;

use super::{Folder, wavecast};

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
