//! Files that documents name: each has to be there.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path};

use crate::files::{Source, root, sources};
use crate::links::markdown;

/// What looks like a path and is none of this repository: an element of another library, a folder that a program
/// writes, a line of an OBJ file.
const OTHERS: [&str; 3] = ["obj/sphere", "out/", "v/vt/vn"];

/// The documents: all Markdown, and the comments of Rust files that are documentation.
pub fn documents() -> Vec<Source> {
    let comments = sources().into_iter().map(|(path, text)| {
        let lines = text.lines().map(|line| {
            let line = line.trim_start();
            let comment = line
                .strip_prefix("//!")
                .or_else(|| line.strip_prefix("///"));
            comment.unwrap_or_default()
        });
        (path, lines.collect::<Vec<_>>().join("\n"))
    });
    markdown().into_iter().chain(comments).collect()
}

/// Paths of files and folders as the repository has them, each with all that ends it, so that one may leave out the
/// folders that are clear; without the extension of Rust files and with it.
pub struct Known(BTreeSet<String>);

impl Known {
    pub fn of_repository() -> Self {
        let mut known = BTreeSet::new();
        for folder in [
            "src", "crates", "tests", "benches", "examples", "docs", ".ci",
        ] {
            add_all(Path::new(folder), &mut known);
        }
        for entry in fs::read_dir(root()).expect("the root") {
            let name = entry.expect("an entry").file_name();
            known.insert(name.to_string_lossy().into_owned());
        }
        Self(known)
    }

    /// Complaints about the paths that a document names and that are not there.
    pub fn missing(&self, (path, text): &Source) -> Vec<String> {
        let paths = paths(text).into_iter().filter(|named| {
            let named = named.trim_start_matches("../").trim_end_matches('/');
            !self.0.contains(named)
        });
        let others = |named: &String| !OTHERS.contains(&named.as_str());
        let show = |named| format!("{}: `{named}`", path.display());
        paths.filter(others).map(show).collect()
    }
}

/// Adds a path and all that lies below it.
fn add_all(path: &Path, known: &mut BTreeSet<String>) {
    let names: Vec<String> = path
        .components()
        .filter_map(|c| match c {
            Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        })
        .collect();
    for first in 0..names.len() {
        let end = names[first..].join("/");
        known.extend(end.strip_suffix(".rs").map(str::to_owned));
        known.insert(end);
    }
    if root().join(path).is_dir() {
        for entry in fs::read_dir(root().join(path)).expect("a folder") {
            add_all(&path.join(entry.expect("an entry").file_name()), known);
        }
    }
}

/// The paths among the code spans of a text: what has a slash between names, or the name of a source file or
/// document. Braces are choices; what follows `::`, and the words of a command, are no part of a path.
fn paths(text: &str) -> Vec<String> {
    let mut fenced = false;
    let lines = text.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    });
    let spans = lines.flat_map(|line| line.split('`').skip(1).step_by(2));
    let all = spans.flat_map(expanded).filter_map(|span| {
        let path = span.split("::").next().unwrap_or_default();
        let (path, words) = path.split_once(' ').unwrap_or((path, "command"));
        let is_name = |c: char| c.is_ascii_alphanumeric() || "_-./".contains(c);
        let starts = path.starts_with(|c: char| c.is_ascii_lowercase() || c == '.');
        let named = [".rs", ".md", ".py"]
            .iter()
            .any(|e| path.ends_with(e) && path != *e);
        let is_command = words.starts_with(|c: char| c.is_ascii_alphabetic() || c == '-');
        let is_path = starts && (path.contains('/') || named) && path.chars().all(is_name);
        (is_path && is_command).then(|| path.to_owned())
    });
    all.collect()
}

/// All that braces stand for.
fn expanded(span: &str) -> Vec<String> {
    let parts = span.split_once('{').and_then(|(start, rest)| {
        let (choices, end) = rest.split_once('}')?;
        Some((start, choices, end))
    });
    let Some((start, choices, end)) = parts else {
        return vec![span.to_owned()];
    };
    let each = choices.split(',');
    each.flat_map(|choice| expanded(&format!("{start}{}{end}", choice.trim())))
        .collect()
}

#[test]
fn paths_are_found_in_code_spans() {
    let text = "A `kernel/{path,edges/tree}`, `io/obj.rs` and `accel/simd::dispatch` by `benches/peers/run speed`, but\n\
                not `a / b`, `x/2 + 1`, `i32`, one/two or `[H/2]`; `sums.rs` is a file.\n```\n`no/path`\n```\n";
    let found = [
        "kernel/path",
        "kernel/edges/tree",
        "io/obj.rs",
        "accel/simd",
        "benches/peers/run",
        "sums.rs",
    ];
    assert_eq!(paths(text), found);
}

#[test]
fn a_path_that_is_gone_is_a_complaint() {
    let known = Known::of_repository();
    let missing = |text: &str| known.missing(&("a.md".into(), text.to_owned()));
    let here = "`src/lib.rs`, `render/options`, `tests/gpu/main.rs`, `boundary/film`, `docs/GPU.md`, `gpu/`, `.ci/run`";
    assert!(missing(here).is_empty(), "{:?}", missing(here));
    for gone in [
        "geometry/trigonometry",
        "render/tensors/sight",
        "src/gone.rs",
        "gone/",
        "sight.rs",
    ] {
        assert_eq!(missing(&format!("`{gone}`")), [format!("a.md: `{gone}`")]);
    }
}
