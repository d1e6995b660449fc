//! Circles of imports between the files and folders of one folder.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use crate::modules::{Import, Names};

/// For each file or folder of a folder, which others of that folder it imports.
type Edges<'a> = BTreeMap<&'a str, BTreeSet<&'a str>>;

/// The circles of all folders, as `src/scene: a → b → a`: for each file the shortest one of those in which
/// it is the first by its name.
pub fn circles(imports: &BTreeSet<Import>) -> Vec<String> {
    let mut found = Vec::new();
    for folder in folders(imports) {
        let edges = edges_within(folder, imports);
        let name = [&["src".to_owned()][..], folder].concat().join("/");
        let circles = edges
            .keys()
            .copied()
            .filter_map(|start| circle(start, &edges));
        found.extend(circles.map(|circle| format!("{name}: {}", circle.join(" → "))));
    }
    found
}

/// All folders that hold a module which imports something.
fn folders(imports: &BTreeSet<Import>) -> BTreeSet<&[String]> {
    let modules = imports.iter().map(|(from, _)| from);
    let above = modules.flat_map(|module| (0..module.len()).map(|n| &module[..n]));
    above.collect()
}

/// The imports between the files and folders of a folder. What a file of a subfolder imports, the subfolder
/// does.
fn edges_within<'a>(folder: &[String], imports: &'a BTreeSet<Import>) -> Edges<'a> {
    let child = |module: &'a Names| {
        let name = module.get(folder.len())?;
        module.starts_with(folder).then_some(name.as_str())
    };
    let mut edges = Edges::new();
    for (from, to) in imports {
        if let (Some(from), Some(to)) = (child(from), child(to))
            && from != to
        {
            edges.entry(from).or_default().insert(to);
        }
    }
    edges
}

/// The shortest circle through a file and others that come after it by their names.
fn circle<'a>(start: &'a str, edges: &Edges<'a>) -> Option<Vec<&'a str>> {
    let mut ways = VecDeque::from([vec![start]]);
    let mut seen = BTreeSet::new();
    while let Some(way) = ways.pop_front() {
        for &next in edges.get(way[way.len() - 1]).into_iter().flatten() {
            let longer = || [&way[..], &[next]].concat();
            if next == start {
                return Some(longer());
            }
            if next > start && seen.insert(next) {
                ways.push_back(longer());
            }
        }
    }
    None
}

#[test]
fn circles_are_found() {
    let of = |files: &[(&str, &str)]| circles(&crate::modules::made_up(files).imports());
    let none: [&str; 0] = [];
    let both = ("f/b.rs", "use super::a::A;");
    assert_eq!(
        of(&[("f/a.rs", "use crate::f::b::B;"), both]),
        ["src/f: a → b → a"]
    );
    assert_eq!(of(&[("f/a.rs", "use std::fmt;"), both]), none);
    // By way of a name that mod.rs hands on.
    let through = [
        ("f/mod.rs", "pub use b::B;"),
        ("f/a.rs", "use super::B;"),
        both,
    ];
    assert_eq!(of(&through), ["src/f: a → b → a"]);
    // Of three, and of folders by what is in them.
    let three = [
        ("a/x.rs", "use crate::b::X;"),
        ("b.rs", "use crate::c::y::Y;"),
        ("c/y.rs", "fn f() { crate::a::x::g() }"),
    ];
    assert_eq!(of(&three), ["src: a → b → c → a"]);
    // A file and what its folder's mod.rs defines are no circle.
    assert_eq!(
        of(&[("f/mod.rs", "use a::A;"), ("f/a.rs", "use super::F;")]),
        none
    );
}
