//! Tests that need a feature: those that CI runs with it.

use std::fs;

use crate::files::root;

/// The text of a file of the repository.
fn text(path: &str) -> String {
    fs::read_to_string(root().join(path)).expect(path)
}

/// The test programs at the top of tests/, with their texts.
fn programs() -> Vec<(String, String)> {
    let entries = fs::read_dir(root().join("tests")).expect("tests/");
    let names = entries.map(|entry| entry.expect("an entry").file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    let rust = names.filter_map(|name| name.strip_suffix(".rs").map(str::to_owned));
    rust.map(|name| {
        let text = text(&format!("tests/{name}.rs"));
        (name, text)
    })
    .collect()
}

/// The programs among them that a text names by `--test`.
fn named(text: &str) -> Vec<&str> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let pairs = words.windows(2).filter(|pair| pair[0] == "--test");
    pairs.map(|pair| pair[1]).collect()
}

/// The lines of `.ci/run` and what they continue with, whose commands have a feature.
fn commands_with(feature: &str) -> String {
    let whole = text(".ci/run").replace("\\\n", " ");
    let has = |line: &&str| line.contains("cargo test") && line.contains(feature);
    whole.lines().filter(has).collect::<Vec<_>>().join("\n")
}

/// Names of programs that have a text and are not in a list.
fn not_in(list: &[&str], parts: &[&str]) -> Vec<String> {
    let needs = |(name, text): &(String, String)| {
        parts.iter().any(|part| text.contains(part)) && !list.contains(&name.as_str())
    };
    let missing = programs().into_iter().filter(needs);
    missing.map(|(name, _)| name).collect()
}

/// A test of a feature that no command builds would never run.
pub fn not_run() -> Vec<String> {
    let gpus = r#"#![cfg(feature = "wgpu")]"#;
    // `cpu_devices` are more with ndarray.
    let parts = [gpus, r#"feature = "ndarray""#, "cpu_devices"];
    let commands = commands_with("--features vulkan,ndarray");
    let mut missing = not_in(&named(&commands), &parts);
    if !commands.contains("--lib") {
        missing.push("--lib".to_owned());
    }
    let of_readme = text("README.md");
    let of_gpus = not_in(&named(&of_readme), &[gpus]);
    let show = |file: &str, names: Vec<String>| -> Vec<String> {
        names.iter().map(|name| format!("{file}: {name}")).collect()
    };
    [show(".ci/run", missing), show("README.md", of_gpus)].concat()
}

#[test]
fn programs_are_found() {
    let found = named("cargo test --features a --test gpu --test wgpu -- --nocapture");
    assert_eq!(found, ["gpu", "wgpu"]);
    assert_eq!(
        not_in(&[], &["#![cfg(feature = \"ndarray\")]"]),
        ["backends"]
    );
    assert!(not_in(&["backends"], &["#![cfg(feature = \"ndarray\")]"]).is_empty());
}
