//! The Rust files of the repository and their lines.

use std::fs;
use std::path::{Path, PathBuf};

/// The most lines of a file.
const MAX_LINES: usize = 400;

/// A file's path from the root of the repository, and its text.
pub type Source = (PathBuf, String);

/// The root of the repository.
pub fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// All Rust files of the repository.
pub fn sources() -> Vec<Source> {
    let folders = ["src", "crates", "tests", "benches", "examples"];
    folders.iter().flat_map(rust_files).collect()
}

/// The Rust files below a folder of the repository.
pub fn rust_files(folder: impl AsRef<Path>) -> Vec<Source> {
    let folder = folder.as_ref();
    let entries = fs::read_dir(root().join(folder)).expect("a folder");
    let paths = entries.map(|entry| folder.join(entry.expect("an entry").file_name()));
    let files = paths.flat_map(|path| {
        let whole = root().join(&path);
        if whole.is_dir() {
            rust_files(path)
        } else if path.extension().is_some_and(|e| e == "rs") {
            vec![(path, fs::read_to_string(whole).expect("a source file"))]
        } else {
            Vec::new()
        }
    });
    let mut files: Vec<Source> = files.collect();
    files.sort();
    files
}

/// The complaint about a file that has too many lines.
pub fn too_long((path, text): &Source) -> Option<String> {
    let lines = text.lines().count();
    let long = lines > MAX_LINES;
    long.then(|| format!("{}: {lines} lines, at most {MAX_LINES}", path.display()))
}

/// Complaints about attributes that let a long function pass and give no reason.
pub fn long_without_reason((path, text): &Source) -> Vec<String> {
    let silent = text.lines().enumerate().filter(|(_, line)| {
        let passes = line.trim_start().starts_with('#') && line.contains("too_many_lines");
        passes && !line.contains("reason = \"")
    });
    let show = |(i, line): (usize, &str)| format!("{}:{}: {}", path.display(), i + 1, line.trim());
    silent.map(show).collect()
}

#[test]
fn lines_are_counted() {
    let of = |lines: usize| (PathBuf::from("a.rs"), "x\n".repeat(lines));
    assert_eq!(too_long(&of(MAX_LINES)), None);
    let found = too_long(&of(MAX_LINES + 1)).expect("a complaint");
    assert_eq!(found, "a.rs: 401 lines, at most 400");
}

#[test]
fn reasons_are_found() {
    let lint = ["clippy", "too_many_lines"].join("::");
    let of = |rest: &str| {
        let text = format!("\n    #[expect({lint}{rest})]\n    fn f() {{}}\n");
        long_without_reason(&(PathBuf::from("a.rs"), text))
    };
    assert!(of(", reason = \"a list\"").is_empty());
    assert_eq!(of(""), [format!("a.rs:2: #[expect({lint})]")]);
}
