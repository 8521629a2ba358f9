//! Bad usage, bad input, help.

use super::{Folder, line, wavecast};

const SUBCOMMANDS: [&str; 4] = ["render", "info", "compare", "bench"];

#[test]
fn help_goes_to_stdout_with_an_example_for_each_subcommand() {
    assert!(line("--help").expect(0).stdout.contains("Example:\n  wavecast render "));
    for subcommand in SUBCOMMANDS {
        let run = wavecast([subcommand, "--help"]).expect(0);
        assert!(run.stdout.contains(&format!("Example:\n  wavecast {subcommand} ")), "{}", run.stdout);
        for global in ["--quiet", "--json", "--threads"] {
            assert!(run.stdout.contains(global), "{subcommand} {global}");
        }
        assert_eq!(run.stderr, "");
    }
    assert_eq!(line("--version").expect(0).stdout.trim(), format!("wavecast {}", env!("CARGO_PKG_VERSION")));
}

#[test]
fn bad_usage_is_an_error_on_stderr_with_exit_code_2() {
    line("").expect(2);
    for words in [
        "paint",
        "bench",
        "bench accel",
        "bench speed scenes/cornell.gltf",
        "bench accel scenes/cornell.gltf --accel oak",
        "bench accel scenes/cornell.gltf --runs 0",
        "bench kernels --accel oak",
        "bench accel hall:many",
        "bench accel hall:1e3 --view 1,2,3",
        "bench accel hall:1e3 --scaling 0",
        "bench accel hall:1e3 --slice y",
        "bench accel hall:1e3 --draw . --slice w",
        "render",
        "render a.glb",
        "render a.glb -o",
        "render a.glb -o a.png --size 12",
        "render a.glb -o a.png --spp 0",
        "render a.glb -o a.png --time 0s",
        "render a.glb -o a.png --samples 5..5",
        "render a.glb -o a.png --samples 0..5 --spp 5",
        "render a.glb -o a.png --exposure bright",
        "render a.glb -o a.png --exposure 1 --ev100 2",
        "render a.glb -o a.png --tonemap film",
        "render a.glb -o a.png --env-rotate 90",
        "render a.glb -o a.png --env sky.png",
        "render a.glb -o a.png --sampler halton",
        "render a.glb -o a.png --threads 0",
        "render a.glb -o a.png --accel oak",
        "render a.glb -o a.png --build-quality poor",
        "render a.glb -o a.png --accel grid --build-quality best",
        "info a.glb --accel brute --build-quality good",
        "compare a.png",
        "compare a.png b.png --max-relmse -1",
    ] {
        let run = line(words).expect(2);
        assert!(run.stderr.starts_with("error: "), "{words}: {}", run.stderr);
        assert_eq!(run.stdout, "", "{words}");
    }
}

#[test]
fn a_quality_for_a_structure_that_has_none_is_an_error_that_says_what_to_do() {
    let run = line("render a.glb -o a.png --accel kdtree --build-quality fast").expect(2);
    run.says("--build-quality fast is for bvh8; kdtree is built in one way only, so leave it out");
}

/// Options that the program does not have yet are named, never ignored.
#[test]
fn options_and_subcommands_to_come_are_not_accepted_in_silence() {
    for option in [
        "--variant red",
        "--at-time 1",
        "--checkpoint a.ckpt",
        "--resume",
        "--max-memory 8GiB",
        "--spec-exact",
        "--shutter 0.1",
        "--layers paths",
    ] {
        let run = line(&format!("render a.glb -o a.exr {option}")).expect(2);
        let named = option.split(' ').next_back().unwrap();
        let flag = option.split(' ').next().unwrap();
        assert!(run.stderr.contains(flag) || run.stderr.contains(named), "{option}: {}", run.stderr);
    }
    for subcommand in ["merge", "series", "script", "measure", "bench"] {
        line(subcommand).expect(2).says(subcommand);
    }
}

#[test]
fn outputs_are_checked_before_the_scene_is_even_read() {
    let folder = Folder::new();
    let check = |output: &str, stats: Option<&str>, complaint: &str| {
        let output = folder.at(output);
        let mut words = vec!["render".into(), folder.at("missing.glb"), "-o".into(), output.clone()];
        if let Some(stats) = stats {
            words.extend(["--stats".into(), folder.at(stats)]);
        }
        let run = wavecast(words).expect(1).says("error: ").says(complaint);
        assert!(!run.stderr.contains("missing.glb"), "{}", run.stderr);
    };
    check("none/a.exr", None, "no folder");
    check("a.jpg", None, "use .exr, .png or .hdr");
    check("plain", None, "use .exr, .png or .hdr");
    std::fs::create_dir(folder.at("folder.png")).unwrap();
    check("folder.png", None, "is a folder");
    std::fs::write(folder.at("file"), "").unwrap();
    check("file/a.png", None, "no folder");
    check("a.png", Some("none/stats.json"), "no folder");
    assert_eq!(folder.names(), ["file", "folder.png"], "nothing is left behind");
}

/// A folder that does not let anybody write, where the system has one.
#[cfg(target_os = "linux")]
#[test]
fn a_folder_without_write_permission_is_found_before_rendering() {
    let run = line("render missing.glb -o /proc/a.png").expect(1).says("cannot write").says("/proc/a.png");
    assert!(!run.stderr.contains("missing.glb"), "{}", run.stderr);
}

#[test]
fn a_missing_scene_is_bad_input_and_writes_nothing() {
    let folder = Folder::new();
    let (scene, out) = (folder.at("missing.glb"), folder.at("a.png"));
    let run = wavecast(["render".as_ref(), scene.as_os_str(), "-o".as_ref(), out.as_os_str()]);
    run.expect(1).says("error: ").says("missing.glb");
    assert!(folder.names().is_empty());
    let run = wavecast(["info".as_ref(), scene.as_os_str()]).expect(1).says("missing.glb");
    assert_eq!(run.stdout, "");
}

#[test]
fn options_without_effect_are_warned_about_and_counted_unless_quiet() {
    let folder = Folder::new();
    let (scene, out) = (folder.at("missing.glb"), folder.at("a.hdr"));
    let words = || {
        let options = ["--layers", "albedo", "--exposure", "1", "--transparent"].map(Into::into);
        ["render".into(), scene.clone(), "-o".into(), out.clone()].into_iter().chain(options)
    };
    let run = wavecast(words()).expect(1).says("warning: --layers").says("warning: --exposure").says("no alpha");
    assert!(run.stderr.contains("3 warnings"), "{}", run.stderr);
    let run = wavecast(words().chain(["--quiet".into()])).expect(1).says("error: ");
    assert!(!run.stderr.contains("warning"), "{}", run.stderr);
}
