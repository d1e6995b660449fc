//! Which modules of a crate import which others, read from their source files.
//!
//! Paths in the arguments of macros are not seen.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use syn::visit::{self, Visit};

use crate::files::rust_files;

/// Names from the root of the crate: `["scene", "flatten", "materials"]`.
pub type Names = Vec<String>;

/// A module, and one that it imports.
pub type Import = (Names, Names);

/// The modules of a crate, with the paths that their files name.
pub struct Modules(BTreeMap<Names, Vec<Named>>);

/// A path that a file names, from the root of the crate, and under which name a `use` brings it in.
struct Named {
    path: Names,
    used_as: Option<String>,
}

impl Modules {
    /// The modules of a crate, whose sources are in a folder of the repository.
    pub fn of(folder: &str) -> Self {
        let files = rust_files(folder).into_iter().map(|(path, text)| {
            let path = path.strip_prefix(folder).expect("a file of the folder");
            (module_of(path), text)
        });
        Self::parse(files)
    }

    /// Modules from the texts of their files.
    pub fn parse(files: impl Iterator<Item = (Names, String)>) -> Self {
        let parsed = files.map(|(module, text)| {
            let file = syn::parse_file(&text).unwrap_or_else(|e| panic!("{module:?}: {e}"));
            let mut paths = Paths {
                module: module.clone(),
                list: Vec::new(),
            };
            paths.visit_file(&file);
            (module, paths.list)
        });
        Self(parsed.collect())
    }

    /// The names of all modules.
    pub fn names(&self) -> impl Iterator<Item = &Names> {
        self.0.keys()
    }

    /// All imports of one module by another. The root imports everything, so its imports are left out.
    pub fn imports(&self) -> BTreeSet<Import> {
        let mut imports = BTreeSet::new();
        for (module, paths) in self.0.iter().filter(|(module, _)| !module.is_empty()) {
            let targets = paths.iter().map(|named| self.resolve(&named.path));
            let others = targets.filter(|target| target != module);
            imports.extend(others.map(|target| (module.clone(), target)));
        }
        imports
    }

    /// The module that a path leads to. `["scene", "Mesh"]` leads to `scene/mesh` if `scene/mod.rs`
    /// has a `use` of `mesh::Mesh`.
    fn resolve(&self, path: &[String]) -> Names {
        let mut module = Names::new();
        for name in path {
            let child = [&module[..], std::slice::from_ref(name)].concat();
            if self.0.keys().any(|key| key.starts_with(&child)) {
                module = child;
            } else if let Some(target) = self.exported(&module, name) {
                module = target;
            } else {
                break;
            }
        }
        module
    }

    /// The child of a module from which a `use` in the module brings in this name.
    fn exported(&self, module: &Names, name: &str) -> Option<Names> {
        let mut uses = self.0.get(module)?.iter();
        let named = uses.find(|named| named.used_as.as_deref() == Some(name))?;
        let child = named.path.get(..=module.len())?;
        let is_child = child.starts_with(module) && self.0.contains_key(child);
        is_child.then(|| child.to_vec())
    }
}

/// Collects the paths of a file that may lead to other modules of the crate, but for its tests, which may
/// import anything.
struct Paths {
    module: Names,
    list: Vec<Named>,
}

impl Paths {
    fn add(&mut self, path: &[String], used_as: Option<String>) {
        let path = self.absolute(path);
        self.list.push(Named { path, used_as });
    }

    /// A path of the current module, from the root of the crate.
    fn absolute(&self, path: &[String]) -> Names {
        let mut names = self.module.clone();
        let mut rest = path;
        while let [first, after @ ..] = rest {
            match first.as_str() {
                "crate" => names.clear(),
                "super" => drop(names.pop()),
                "self" => {}
                _ => break,
            }
            rest = after;
        }
        [names, rest.to_vec()].concat()
    }

    fn add_use(&mut self, tree: &syn::UseTree, before: &[String]) {
        let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
        match tree {
            syn::UseTree::Path(path) => self.add_use(&path.tree, &with(&path.ident)),
            syn::UseTree::Name(name) => {
                self.add(&with(&name.ident), Some(name.ident.to_string()));
            }
            syn::UseTree::Rename(name) => {
                self.add(&with(&name.ident), Some(name.rename.to_string()));
            }
            syn::UseTree::Glob(_) => self.add(before, None),
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.add_use(tree, before);
                }
            }
        }
    }
}

impl<'a> Visit<'a> for Paths {
    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        self.add_use(&item.tree, &[]);
    }

    fn visit_item_mod(&mut self, item: &'a syn::ItemMod) {
        if !item.attrs.iter().any(is_for_tests) {
            self.module.push(item.ident.to_string());
            visit::visit_item_mod(self, item);
            self.module.pop();
        }
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        let names: Names = path.segments.iter().map(|s| s.ident.to_string()).collect();
        if names.len() > 1 && ["crate", "super", "self"].contains(&names[0].as_str()) {
            self.add(&names, None);
        }
        visit::visit_path(self, path);
    }
}

/// Whether an attribute is `#[cfg(test)]`.
fn is_for_tests(attribute: &syn::Attribute) -> bool {
    attribute.path().is_ident("cfg")
        && attribute
            .parse_args::<syn::Ident>()
            .is_ok_and(|condition| condition == "test")
}

/// The module of a file of `src`: `scene/mod.rs` is `scene`, `lib.rs` the root.
fn module_of(file: &Path) -> Names {
    let file = file.with_extension("");
    let names = file.iter();
    let mut names: Names = names.map(|n| n.to_string_lossy().into_owned()).collect();
    if names.last().is_some_and(|n| n == "mod" || n == "lib") {
        names.pop();
    }
    names
}

/// Modules of a made-up crate: paths of files below src/ and their texts.
pub fn made_up(files: &[(&str, &str)]) -> Modules {
    let files = files
        .iter()
        .map(|(path, text)| (module_of(Path::new(path)), (*text).to_owned()));
    Modules::parse(files)
}

#[test]
fn every_kind_of_path_is_an_import() {
    let imports = |text: &str| -> Vec<String> {
        let modules = made_up(&[
            ("lib.rs", "pub use b::B; use a::deep;"),
            (
                "a/mod.rs",
                "mod deep; mod other; pub use other::{Item, Thing as Renamed};",
            ),
            ("a/deep.rs", text),
            ("a/other.rs", ""),
            ("b.rs", ""),
        ]);
        let all = modules.imports().into_iter();
        let deep = all.filter(|(from, _)| from.join("/") == "a/deep");
        deep.map(|(_, to)| to.join("/")).collect()
    };
    let none: [&str; 0] = [];
    assert_eq!(imports("use super::other::X;"), ["a/other"]);
    assert_eq!(imports("use super::other;"), ["a/other"]);
    assert_eq!(imports("use super::other::*;"), ["a/other"]);
    assert_eq!(imports("use super::Item;"), ["a/other"]);
    assert_eq!(imports("use super::Renamed as X;"), ["a/other"]);
    assert_eq!(imports("use super::Thing;"), ["a"]);
    assert_eq!(imports("use crate::B;"), ["b"]);
    assert_eq!(
        imports("use crate::{a::{other::{X, Y}}, b as c};"),
        ["a/other", "b"]
    );
    assert_eq!(imports("use self::inner::X; mod inner {}"), none);
    assert_eq!(
        imports("fn f(x: &crate::b::X) { super::other::g(x) }"),
        ["a/other", "b"]
    );
    assert_eq!(
        imports("mod inner { use super::super::other::X; }"),
        ["a/other"]
    );
    assert_eq!(imports("#[cfg(test)] mod tests { use crate::b::X; }"), none);
    assert_eq!(imports("use std::fmt; // use crate::b::X;"), none);
    assert_eq!(imports("const S: &str = \"use crate::b::X;\";"), none);
}
