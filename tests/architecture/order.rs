//! The order of the folders and files of a crate: each imports only what stands to its right.

use std::collections::BTreeSet;

use crate::modules::{Import, Modules, Names};

/// The order, with the folders that share a place together.
pub struct Order(Vec<Names>);

impl Order {
    /// Reads the order from the line of a document that is a code span with arrows.
    pub fn parse(text: &str) -> Self {
        let is_order = |line: &&str| line.starts_with('`') && line.contains('→');
        let line = text.lines().find(is_order);
        let line = line.expect("a line `folder → folder, folder → …`");
        let place = |names: &str| names.split(',').map(|n| n.trim().to_owned()).collect();
        Self(line.trim_matches('`').split('→').map(place).collect())
    }

    fn place(&self, folder: &str) -> Option<usize> {
        self.0.iter().position(|p| p.iter().any(|n| n == folder))
    }

    /// Folders and files that have no place in the order, and names in it that are no modules.
    pub fn differences(&self, modules: &Modules) -> Vec<String> {
        let parts: BTreeSet<&String> = modules.names().filter_map(|m| m.first()).collect();
        let lacks = parts.into_iter().filter(|part| self.place(part).is_none());
        let exists = |name: &String| modules.names().any(|m| m.first() == Some(name));
        let strange = self.0.iter().flatten().filter(|name| !exists(name));
        lacks
            .map(|folder| format!("{folder} has no place in the order"))
            .chain(strange.map(|name| format!("{name} is in the order, but is no module")))
            .collect()
    }

    /// Imports of what stands further left.
    pub fn against(&self, imports: &BTreeSet<Import>) -> Vec<String> {
        let place = |module: &Names| self.place(module.first()?);
        let goes_left = |(from, to): &&Import| match (place(from), place(to)) {
            (Some(from), Some(to)) => to < from,
            _ => false,
        };
        let show = |(from, to): &Import| format!("{} → {}", from.join("/"), to.join("/"));
        imports.iter().filter(goes_left).map(show).collect()
    }
}

#[test]
fn imports_to_the_left_are_found() {
    let modules = crate::modules::made_up(&[
        ("lib.rs", "use c::C;"),
        ("a/x.rs", "use crate::c::C; use crate::other::O;"),
        ("b/mod.rs", "use crate::a::x::X;"),
        ("c.rs", "use crate::b::B;"),
        ("other.rs", ""),
    ]);
    let order = Order::parse("# Text\nAn → arrow.\n\n`a → b, c`\n");
    assert_eq!(order.against(&modules.imports()), ["b → a/x"]);
    let order = Order::parse("`c → b → a`");
    assert_eq!(order.against(&modules.imports()), ["a/x → c"]);
}

#[test]
fn folders_without_a_place_are_found() {
    let modules = crate::modules::made_up(&[("a/x.rs", ""), ("b.rs", ""), ("other.rs", "")]);
    let all = Order::parse("`a → b → other`");
    assert!(all.differences(&modules).is_empty());
    assert_eq!(
        Order::parse("`b → c`").differences(&modules),
        [
            "a has no place in the order",
            "other has no place in the order",
            "c is in the order, but is no module"
        ]
    );
}
