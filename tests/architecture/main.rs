//! The rules of ARCHITECTURE.md that a program can check: imports go one way, files stay short, long
//! functions give a reason. Clippy counts the lines of functions (`clippy.toml`). Documents name files that are there,
//! their links lead somewhere, and CI runs the tests of every feature.

mod circles;
mod features;
mod files;
mod links;
mod modules;
mod order;
mod paths;

use circles::circles;
use features::{not_run, without_tests};
use files::{long_without_reason, root, sources, too_long};
use links::Pages;
use modules::Modules;
use order::Order;
use paths::{Known, documents};

/// Fails with one line for each thing that is wrong.
#[track_caller]
fn assert_none(problem: &str, found: &[String]) {
    assert!(found.is_empty(), "{problem}:\n{}\n", found.join("\n"));
}

/// The crates, each by the folder of its sources and the document with the order of its folders.
const CRATES: [[&str; 2]; 2] = [
    ["src", "ARCHITECTURE.md"],
    ["crates/kernels/src", "crates/kernels/README.md"],
];

#[test]
fn no_circles_of_imports_in_a_folder() {
    for [folder, _] in CRATES {
        let imports = Modules::of(folder).imports();
        assert_none("files that import each other", &circles(&imports));
    }
}

#[test]
fn folders_import_what_stands_to_their_right() {
    for [folder, document] in CRATES {
        let text = std::fs::read_to_string(root().join(document)).expect(document);
        let (order, modules) = (Order::parse(&text), Modules::of(folder));
        assert_none(
            &format!("the order of {document} and {folder} differ"),
            &order.differences(&modules),
        );
        assert_none(
            "folders that import what stands to their left",
            &order.against(&modules.imports()),
        );
    }
}

#[test]
fn files_are_short() {
    let sources = sources();
    let long: Vec<String> = sources.iter().filter_map(too_long).collect();
    assert_none("files that are too long", &long);
}

#[test]
fn long_functions_give_a_reason() {
    let sources = sources();
    let silent: Vec<String> = sources.iter().flat_map(long_without_reason).collect();
    assert_none(
        "`too_many_lines` is let pass without `reason = \"…\"`",
        &silent,
    );
}

#[test]
fn documents_name_files_that_are_there() {
    let known = Known::of_repository();
    let documents = documents();
    let missing: Vec<String> = documents.iter().flat_map(|d| known.missing(d)).collect();
    assert_none("files that are named and not there", &missing);
}

#[test]
fn links_lead_somewhere() {
    let pages = Pages::of_repository();
    assert_none("links that lead nowhere", &pages.broken());
    assert_none(
        "pages that docs/SUMMARY.md does not list",
        &pages.unlisted(),
    );
}

#[test]
fn tests_of_features_are_run() {
    assert_none("tests of features that no command runs", &not_run());
    assert_none("filters that no test has", &without_tests());
}
