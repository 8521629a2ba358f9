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
    assert_eq!(rows.len(), 6 * 4);
    for row in rows {
        let (name, number) = (row["accel"].as_str().unwrap(), |key: &str| row[key].as_f64().unwrap());
        assert!(["primary", "bounce1", "bounce3", "shadow"].contains(&row["rays"].as_str().unwrap()));
        assert!(number("checked") > 30.0 && number("mismatches") == 0.0, "{row}");
        assert!(number("mrays_per_second") > 0.0 && number("build_seconds") > 0.0 && number("bytes") > 1e6, "{row}");
        let divides_objects = ["bvh8", "bvh2"].contains(&name);
        assert_eq!(number("references") == number("triangles"), divides_objects, "{row}");
        // Brute force would test all of a quarter of a million.
        assert!((1.0..1000.0).contains(&number("triangles_per_ray")) && number("nodes_per_ray") > 1.0, "{row}");
    }
    let csv = std::fs::read_to_string(folder.at("accel.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    assert!(csv.starts_with("scene,triangles,accel,rays,"), "{csv}");
}
