//! Imports follow the map in `src/lib.rs`: down the list, never up.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Module, and what it may use beside `math`.
const MAY_USE: [(&str, &[&str]); 17] = [
    ("math", &[]),
    ("geometry", &[]),
    ("hierarchy", &["geometry"]),
    ("model", &["geometry", "hierarchy"]),
    ("stepping", &["model"]),
    ("adaptation", &["model", "stepping"]),
    ("contact", &["model"]),
    ("simulation", &["model", "stepping", "adaptation", "contact"]),
    ("feedback", &["model", "stepping", "contact", "simulation"]),
    ("prepare", &["geometry", "hierarchy", "model", "stepping", "adaptation", "contact", "simulation"]),
    ("scene", &["geometry", "model", "adaptation", "contact", "simulation", "prepare"]),
    ("offline", &["geometry", "model", "contact", "simulation", "scene"]),
    ("wire", &["model", "contact", "simulation", "feedback", "scene"]),
    ("recording", &["model", "contact", "simulation", "scene", "wire"]),
    (
        "study",
        &[
            "geometry",
            "hierarchy",
            "model",
            "stepping",
            "adaptation",
            "contact",
            "simulation",
            "feedback",
            "prepare",
            "scene",
            "offline",
            "wire",
        ],
    ),
    ("realtime", &["model", "stepping", "adaptation", "contact", "simulation"]),
    ("server", &["model", "contact", "simulation", "feedback", "scene", "wire", "recording", "realtime"]),
];

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Modules of this crate that a line of code names: what follows `crate::`, braces included.
fn named(line: &str) -> Vec<String> {
    let code = line.split("//").next().unwrap_or("");
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let word = |s: &str| s.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        match rest.strip_prefix('{') {
            Some(list) => found.extend(list.split(',').map(word)),
            None => found.push(word(rest)),
        }
    }
    found
}

#[test]
fn every_import_follows_the_map() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let rules: BTreeMap<&str, &[&str]> = MAY_USE.into_iter().collect();
    let mut files = Vec::new();
    sources(&src, &mut files);
    let mut faults = Vec::new();
    let mut imports = 0;
    for file in files {
        let inside = file.strip_prefix(&src).unwrap();
        let first = inside.components().next().unwrap().as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs").to_owned();
        // The program itself may use everything; the map has no imports.
        if ["main", "demo", "doctor", "prepare_command", "progress", "lib"].contains(&module.as_str()) {
            continue;
        }
        let allowed = rules.get(module.as_str()).unwrap_or_else(|| panic!("{module} is not on the map"));
        let text = fs::read_to_string(&file).unwrap();
        // Tests at the end of a file may build their bodies from anywhere.
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        for (number, line) in code.lines().enumerate() {
            for name in named(line) {
                imports += 1;
                if name != module && name != "math" && !allowed.contains(&name.as_str()) {
                    faults.push(format!("{}:{}: {module} may not use {name}", inside.display(), number + 1));
                }
            }
        }
    }
    assert!(imports > 100, "the scan found only {imports} imports");
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn clients_know_no_server_and_nothing_that_only_linux_has() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for (client, words) in [
        ("proto", &["palpate =", "rustix", "libc", "zenoh"][..]),
        ("clients/sdk", &["palpate =", "palpate.workspace", "rustix", "libc"][..]),
        ("clients/phantom", &["palpate =", "palpate.workspace", "rustix", "libc"][..]),
    ] {
        let manifest = fs::read_to_string(root.join(client).join("Cargo.toml")).unwrap();
        for line in manifest.lines() {
            assert!(!words.iter().any(|w| line.starts_with(w)), "{client}: {line}");
        }
        let mut files = Vec::new();
        sources(&root.join(client).join("src"), &mut files);
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
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = vec![src.join("simulation.rs"), src.join("math.rs")];
    for folder in ["model", "stepping", "adaptation", "contact"] {
        sources(&src.join(folder), &mut files);
    }
    for file in files {
        let text = fs::read_to_string(&file).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let words = [
            "std::time",
            "std::fs",
            "std::env",
            "std::thread",
            "std::sync::Mutex",
            "tracing",
            "HashMap",
            "mul_add",
            ".sin()",
            ".cos()",
            ".exp()",
            ".ln()",
            ".powf(",
            "println!",
            "rand::",
        ];
        for word in words {
            assert!(!code.contains(word), "{}: {word}", file.display());
        }
    }
}
