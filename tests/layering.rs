//! Imports follow the maps in the `lib.rs` of each crate: down the list, never up. And each crate needs no more than it
//! may: the core cannot read a clock or a file where it cannot import one.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Module, and what it may use beside `math`: a module of its own crate, or `crate::module` of another.
type Rules = &'static [(&'static str, &'static [&'static str])];

const CORE: Rules = &[
    ("math", &[]),
    ("geometry", &[]),
    ("hierarchy", &["geometry"]),
    ("model", &["geometry", "hierarchy"]),
    ("stepping", &["model"]),
    ("adaptation", &["model", "stepping"]),
    ("contact", &["model"]),
    ("simulation", &["model", "stepping", "adaptation", "contact"]),
    ("feedback", &["model", "stepping", "contact", "simulation"]),
];

const BODY: Rules = &[
    ("geometry", &["core::geometry"]),
    ("cover", &["core::geometry", "core::hierarchy", "geometry"]),
    (
        "prepare",
        &[
            "core::geometry",
            "core::hierarchy",
            "core::model",
            "core::stepping",
            "core::adaptation",
            "core::contact",
            "core::simulation",
            "geometry",
            "cover",
        ],
    ),
];

const PRODUCT: Rules = &[
    ("guide", &[]),
    ("picture", &[]),
    (
        "scene",
        &[
            "core::geometry",
            "core::model",
            "core::adaptation",
            "core::contact",
            "core::simulation",
            "body::geometry",
            "body::prepare",
        ],
    ),
    ("offline", &["core::geometry", "core::model", "core::contact", "core::simulation", "scene"]),
    ("wire", &["core::model", "core::contact", "core::simulation", "core::feedback", "scene"]),
    ("recording", &["core::model", "core::contact", "core::simulation", "scene", "wire"]),
    ("realtime", &["core::model", "core::stepping", "core::adaptation", "core::contact", "core::simulation"]),
    (
        "server",
        &[
            "core::model",
            "core::contact",
            "core::simulation",
            "core::feedback",
            "scene",
            "wire",
            "recording",
            "realtime",
        ],
    ),
];

/// Of the studies, all alike, which may use one another.
const STUDY: &[&str] = &[
    "core::geometry",
    "core::hierarchy",
    "core::model",
    "core::stepping",
    "core::adaptation",
    "core::contact",
    "core::simulation",
    "core::feedback",
    "body::geometry",
    "body::cover",
    "body::prepare",
    "palpate::picture",
    "palpate::scene",
    "palpate::offline",
    "palpate::wire",
    "palpate::realtime",
];

/// How a crate is called in code, and here.
const CRATES: [(&str, &str); 5] = [
    ("crate::", ""),
    ("palpate_core::", "core::"),
    ("palpate_body::", "body::"),
    ("palpate::", "palpate::"),
    ("palpate_study::", "study::"),
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // Examples use their crate as anybody does.
        if path.is_dir() && path.ends_with("examples") {
            continue;
        }
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Modules that a line of code names: what follows a crate's name, braces included.
fn named(line: &str) -> Vec<String> {
    let code = line.split("//").next().unwrap_or("");
    let word = |s: &str| s.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = Vec::new();
    for (path, name) in CRATES {
        for (at, _) in code.match_indices(path) {
            if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
                continue;
            }
            let rest = &code[at + path.len()..];
            match rest.strip_prefix('{') {
                Some(list) => found.extend(list.split(',').map(|s| format!("{name}{}", word(s)))),
                None => found.push(format!("{name}{}", word(rest))),
            }
        }
    }
    found
}

/// The code of a file, comments and tests left out: these may build their bodies from anywhere.
fn code(file: &Path) -> String {
    let text = fs::read_to_string(file).unwrap();
    let before_tests = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    before_tests.lines().map(|line| line.split("//").next().unwrap_or("").to_owned() + "\n").collect()
}

#[test]
fn every_import_follows_the_map() {
    let mut faults = Vec::new();
    let mut imports = 0;
    for (folder, rules) in
        [("src/core", Some(CORE)), ("src/body", Some(BODY)), ("src/palpate", Some(PRODUCT)), ("src/study", None)]
    {
        let src = root().join(folder);
        let rules: Option<BTreeMap<&str, &[&str]>> = rules.map(|rules| rules.iter().copied().collect());
        let mut files = Vec::new();
        sources(&src, &mut files);
        for file in files {
            let inside = file.strip_prefix(&src).unwrap();
            let first = inside.components().next().unwrap().as_os_str().to_string_lossy();
            let module = first.trim_end_matches(".rs").to_owned();
            // Programs themselves and tests from outside may use everything; the map has no imports.
            if ["main", "demo", "doctor", "prepare_command", "progress", "writable", "lib", "tests"]
                .contains(&module.as_str())
            {
                continue;
            }
            let allowed = match &rules {
                Some(rules) => {
                    rules.get(module.as_str()).unwrap_or_else(|| panic!("{folder}: {module} is not on the map"))
                }
                None => STUDY,
            };
            for (number, line) in code(&file).lines().enumerate() {
                for name in named(line) {
                    imports += 1;
                    let is_own = name == module || (rules.is_none() && !name.contains("::"));
                    let is_math = name == "core::math" || (folder == "src/core" && name == "math");
                    if !is_own && !is_math && !allowed.contains(&name.as_str()) {
                        faults.push(format!(
                            "{folder}/{}:{}: {module} may not use {name}",
                            inside.display(),
                            number + 1
                        ));
                    }
                }
            }
        }
    }
    assert!(imports > 300, "the scan found only {imports} imports");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// Crates that `package` is made of, itself among them.
fn crates_of(package: &str, more: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "-e", "normal", "--prefix", "none", "-p", package])
        .args(more)
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
}

#[test]
fn each_crate_needs_no_more_than_it_may() {
    let network = ["zenoh", "tokio", "prost", "palpate-proto", "palpate-sdk"];
    let system = ["rustix", "libc", "core_affinity", "thread-priority", "rayon", "tracing", "mcap"];
    let pictures = ["plotters", "png", "epaint_default_fonts", "palpate-viewer", "ratatui"];
    let above = ["palpate", "palpate-study"];
    let all = |lists: &[&[&'static str]]| lists.concat();
    for (package, more, most, none_of) in [
        ("palpate-core", &[][..], 60, all(&[&network, &system, &pictures, &above, &["palpate-body"]])),
        ("palpate-body", &[], 90, all(&[&network, &pictures, &above, &["rustix", "tracing", "mcap"]])),
        // A server of its own draws nothing.
        ("palpate", &["--no-default-features"], usize::MAX, vec!["plotters", "png", "palpate-viewer", "palpate-study"]),
        ("palpate", &[], usize::MAX, vec!["palpate-study"]),
    ] {
        let crates = crates_of(package, more);
        let is = |name: &str, line: &str| line.split(' ').next() == Some(name);
        let found: Vec<&str> = none_of.into_iter().filter(|name| crates.iter().any(|line| is(name, line))).collect();
        assert!(found.is_empty(), "{package} needs {found:?}");
        assert!(crates.len() <= most, "{package} needs {} crates, more than {most}", crates.len());
        assert!(crates.iter().any(|line| is(package, line)), "{package} is made of {crates:?}");
    }
}

#[test]
fn clients_know_no_server_and_nothing_that_only_linux_has() {
    let ours = ["palpate =", "palpate.", "palpate-core", "palpate-body", "palpate-study"];
    for (client, words) in [
        ("proto", &["rustix", "libc", "zenoh"][..]),
        ("clients/sdk", &["rustix", "libc"]),
        ("clients/phantom", &["rustix", "libc"]),
        ("clients/viewer", &["rustix", "libc"]),
    ] {
        let manifest = fs::read_to_string(root().join(client).join("Cargo.toml")).unwrap();
        for line in manifest.lines() {
            assert!(!ours.iter().chain(words).any(|w| line.starts_with(w)), "{client}: {line}");
        }
        let mut files = Vec::new();
        sources(&root().join(client).join("src"), &mut files);
        for file in files {
            let text = fs::read_to_string(&file).unwrap();
            for word in ["std::os::linux", "std::os::unix", "eventfd"] {
                assert!(!text.contains(word), "{}: {word}", file.display());
            }
        }
    }
}

#[test]
fn the_core_reads_no_clock_file_environment_or_chance() {
    let core = root().join("src/core");
    let mut files = Vec::new();
    sources(&core, &mut files);
    let mut moving = 0;
    for file in files {
        let mut words = vec![
            "std::time",
            "std::fs",
            "std::io",
            "std::env",
            "std::net",
            "std::os",
            "std::process",
            "std::thread",
            "thread_local!",
            "std::sync::Mutex",
            "tracing",
            "println!",
            "rand::",
        ];
        let inside = file.strip_prefix(&core).unwrap();
        // What ticks has no order of chance and no function that is rounded elsewise on another machine, either.
        if !inside.starts_with("geometry") && !inside.starts_with("hierarchy") {
            words.extend(["HashMap", "mul_add", ".sin()", ".cos()", ".exp()", ".ln()", ".powf("]);
            moving += 1;
        }
        let code = code(&file);
        for word in words {
            assert!(!code.contains(word), "{}: {word}", file.display());
        }
    }
    assert!(moving > 40, "the scan found only {moving} files");
}
