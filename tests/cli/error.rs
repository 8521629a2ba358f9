//! `bench error`: error against time, and what became of it.

use std::{fs, path::Path};

use serde_json::Value;

use super::{Folder, Run, wavecast};

/// Small renders of the Cornell box, with what else is said.
fn bench(folder: &Folder, output: &str, more: &[&str]) -> Run {
    let (references, output) = (folder.at("references"), folder.at(output));
    let words = "bench error scenes/cornell.gltf --size 24x24 --spp 64 --budget 1m --reference-spp 4096 --json";
    let folders = ["--references", references.to_str().unwrap(), "-o", output.to_str().unwrap()];
    wavecast(words.split(' ').chain(folders).chain(more.iter().copied()))
}

fn json(run: &Run) -> Value {
    serde_json::from_str(&run.stdout).unwrap()
}

/// The rows of a table with one of its columns changed.
fn edit(from: &Path, to: &Path, column: &str, change: impl Fn(f64) -> f64) {
    let text = fs::read_to_string(from).unwrap();
    let place = text.lines().next().unwrap().split(',').position(|name| name == column).unwrap();
    let line = |(row, line): (usize, &str)| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if row > 0 {
            cells[place] = change(cells[place].parse().unwrap()).to_string();
        }
        cells.join(",")
    };
    fs::write(to, text.lines().enumerate().map(line).collect::<Vec<_>>().join("\n")).unwrap();
}

/// The keys and values of `--json` and the files; errors are those against the truth, whatever the reference.
#[test]
fn error_is_measured_against_a_reference_that_is_kept() {
    let folder = Folder::new();
    let first = bench(&folder, "first", &[]).expect(0);
    assert!(first.stderr.contains("making a reference, 4096 samples per pixel"), "{}", first.stderr);
    let result = json(&first);
    let (renders, budgets) = (result["renders"].as_array().unwrap(), result["budgets"].as_array().unwrap());
    assert_eq!(renders.len(), 4 * 5);
    let column =
        |rows: &[Value], key: &str| -> Vec<f64> { rows.iter().map(|row| row[key].as_f64().unwrap()).collect() };
    assert_eq!(column(budgets, "spp"), [1.0, 4.0, 16.0, 64.0]);
    for render in renders {
        let number = |key: &str| render[key].as_f64().unwrap_or_else(|| panic!("{key} in {render}"));
        assert!(number("relmse") >= number("relmse_trimmed") && number("relmse_trimmed") > 0.0, "{render}");
        let product = number("efficiency") * number("relmse") * number("seconds");
        assert!((product - 1.0).abs() < 1e-9 && number("mpaths_per_second") > 0.0, "{render}");
        // One camera ray for each path.
        assert!((number("camera_mrays_per_second") / number("mpaths_per_second") - 1.0).abs() < 1e-9, "{render}");
        assert!(number("bounce_mrays_per_second") > 0.0 && number("shadow_mrays_per_second") > 0.0, "{render}");
        assert!(number("seed") < 2f64.powi(63) && number("reference_spp") == 4096.0, "{render}");
    }
    let mut seeds = column(renders, "seed");
    seeds.dedup();
    assert_eq!(seeds.len(), renders.len(), "errors are independent");
    assert!(column(budgets, "relmse").is_sorted_by(|a, b| a > b), "{budgets:?}");
    let scene = &result["scenes"][0];
    let [slope, from, to] =
        ["", "_from", "_to"].map(|end| scene[&format!("slope_relmse_trimmed{end}")].as_f64().unwrap());
    // Better than independent numbers, which have −1, or as good, and not better than smooth integrands would have.
    assert!(from < slope && slope < to && (-1.6..-0.9).contains(&slope), "{slope}");
    assert!(result["comparison"].is_null());

    // The second time the reference is there; as the seeds are the same, so are errors, and nothing is lost but time.
    let old = folder.at("first/error.csv");
    let second = bench(&folder, "second", &["--compare", old.to_str().unwrap(), "--tolerance", "95%"]).expect(0);
    assert!(!second.stderr.contains("making"), "{}", second.stderr);
    let comparison = &json(&second)["comparison"];
    for change in comparison.as_array().unwrap() {
        assert_eq!((&change["error_ratio"], &change["error_verdict"]), (&1.0.into(), &"same".into()), "{change}");
        assert_eq!((&change["spp_from"], &change["spp_to"]), (&16.into(), &64.into()));
    }
    let files = |name: &str| {
        let mut names: Vec<_> = fs::read_dir(folder.at(name))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    };
    let names = [
        "error-budgets.csv",
        "error-comparison.csv",
        "error-cornell-gltf.svg",
        "error-scenes.csv",
        "error.csv",
        "error.md",
    ];
    assert_eq!(files("second"), names);
    let kept = files("references");
    assert!(kept.len() == 1 && kept[0].starts_with("cornell-gltf-24x24-"), "{kept:?}");

    // More samples make it better; another depth is another reference, which is told.
    let better = bench(&folder, "third", &["--reference-spp", "8192"]);
    better.expect(2).says("cannot be used multiple times");
    let words = ["--max-depth", "1", "--spp", "4", "--compare", old.to_str().unwrap()];
    let references = folder.at("references");
    let start = ["bench", "error", "scenes/cornell.gltf", "--size", "24x24", "--reference-spp", "64", "--references"];
    let other = wavecast(start.iter().copied().chain([references.to_str().unwrap()]).chain(words));
    other.expect(1).says("has it with other settings").says("nothing to compare with");
    assert_eq!(files("references").len(), 2);
}

/// A reference that has had less than is asked for is continued, not made anew, and its noise falls as it should.
#[test]
fn references_are_made_better_where_more_is_asked_for() {
    let folder = Folder::new();
    let references = folder.at("references");
    let run = |spp: &str| {
        let words = "bench error scenes/cornell.gltf --size 24x24 --spp 4 --seeds 2 --json --reference-spp";
        let more = [spp, "--references", references.to_str().unwrap()];
        wavecast(words.split(' ').chain(more)).expect(0)
    };
    let noise = |run: &Run| json(run)["scenes"][0]["reference_relmse_trimmed"].as_f64().unwrap();
    let first = run("256").says("making a reference");
    let second = run("2048").says("making the reference better");
    let third = run("1024");
    assert!(!third.stderr.contains("making"), "{}", third.stderr);
    assert_eq!(json(&third)["scenes"][0]["reference_spp"], 2048);
    // Eight times the pictures: an eighth of the noise.
    let ratio = noise(&first) / noise(&second);
    assert!((6.0..10.5).contains(&ratio), "{ratio}");
    assert_eq!(noise(&second), noise(&third));
    // Something else in its place is said to be so.
    let path = fs::read_dir(&references).unwrap().next().unwrap().unwrap().path();
    wavecast(["render", "scenes/cornell.gltf", "--size", "24x24", "--spp", "1", "-o", path.to_str().unwrap()])
        .expect(0);
    let words = "bench error scenes/cornell.gltf --size 24x24 --spp 4 --references".split(' ');
    wavecast(words.chain([references.to_str().unwrap()])).expect(1).says("not a reference");
}

/// A reference that is hardly better than what is measured is no reference.
#[test]
fn a_poor_reference_is_warned_of() {
    let folder = Folder::new();
    let words = "bench error scenes/cornell.gltf --size 24x24 --spp 256 --seeds 2 --reference-spp 256 --references";
    let run = wavecast(words.split(' ').chain([folder.at("").to_str().unwrap()])).expect(0);
    run.says("warning: scenes/cornell.gltf: the least relmse").says("is not 10 times that of the reference");
}

/// Times, or errors, more than twice as large as what a build really measured, whose few seeds say little: a loss, with exit code 1, and
/// told apart; the reverse is a gain.
#[test]
fn slower_and_noisier_tables_are_a_loss() {
    let folder = Folder::new();
    bench(&folder, "old", &[]).expect(0);
    let (old, new) = (folder.at("old/error.csv"), folder.at("new.csv"));
    // The machine may be busy while this runs: times that are known.
    let still = folder.at("still.csv");
    let steady = |seconds: f64| 0.01 * (1.0 + seconds.fract() * 0.02);
    edit(&old, &still, "seconds", steady);
    let compare = |old: &Path, new: &Path, code: i32| {
        let words =
            ["bench", "error", "--measured", new.to_str().unwrap(), "--compare", old.to_str().unwrap(), "--json"];
        let run = wavecast(words).expect(code);
        let verdict = |of: &str| json(&run)["comparison"][1][format!("{of}_verdict")].as_str().unwrap().to_owned();
        (["efficiency", "error", "seconds"].map(verdict), run.stderr)
    };
    assert_eq!(compare(&still, &still, 0).0, ["same"; 3]);
    edit(&still, &new, "seconds", |seconds| 2.5 * seconds);
    let (verdicts, stderr) = compare(&still, &new, 1);
    assert_eq!(verdicts, ["worse", "same", "worse"]);
    assert!(stderr.contains("error: less efficient than") && stderr.contains("scenes/cornell.gltf"), "{stderr}");
    assert_eq!(compare(&new, &still, 0).0, ["better", "same", "better"]);
    edit(&still, &new, "relmse_trimmed", |relmse| 2.5 * relmse);
    assert_eq!(compare(&still, &new, 1).0, ["worse", "worse", "same"]);
    assert_eq!(compare(&new, &still, 0).0, ["better", "better", "same"]);
}

/// Rounds that are measured apart are the same renders as those that are measured together, and their tables are read as
/// one.
#[test]
fn rounds_can_be_measured_apart() {
    let folder = Folder::new();
    let all = json(&bench(&folder, "all", &["--rounds", "0..2"]).expect(0));
    let apart = ["0..1", "1..2"].map(|rounds| json(&bench(&folder, rounds, &["--rounds", rounds]).expect(0)));
    let errors = |result: &Value| -> Vec<(u64, f64)> {
        let renders = result["renders"].as_array().unwrap().iter();
        renders.map(|it| (it["seed"].as_u64().unwrap(), it["relmse"].as_f64().unwrap())).collect()
    };
    let mut parts = apart.each_ref().map(errors).concat();
    parts.sort_by_key(|(seed, _)| *seed);
    assert_eq!(parts, errors(&all));
    let tables = ["all", "0..1", "1..2"].map(|name| folder.at(name).join("error.csv").to_str().unwrap().to_owned());
    let words = ["bench", "error", "--tolerance", "95%", "--compare", &tables[0], "--measured", &tables[1], &tables[2]];
    let compared = wavecast(words).expect(0).stdout;
    assert!(compared.contains("same 1.000"), "{compared}");
}

#[test]
fn what_makes_no_sense_is_bad_usage() {
    let line = super::line;
    line("bench error").expect(2).says("needs a SCENE");
    line("bench error scenes/cornell.gltf scenes/cornell.gltf").expect(2).says("is named twice");
    line("bench error --measured a.csv").expect(2).says("--compare");
    line("bench error scenes/cornell.gltf --measured a.csv --compare b.csv").expect(2).says("cannot be used with");
    line("bench error scenes/cornell.gltf --compare scenes/README.md").expect(1).says("not a table of renders");
    line("bench error scenes/cornell.gltf --seeds 1").expect(2).says("--seeds");
}
