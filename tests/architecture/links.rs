//! Links of documents: each has to lead somewhere, on the repository's host and in the book of `docs/`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::files::{Source, root};

/// The page that lists the pages of the book.
const SUMMARY: &str = "docs/SUMMARY.md";

/// The documents of the repository as their readers see them: all Markdown at the root and below `docs`, with included
/// files in place of the lines that include them.
pub struct Pages(BTreeMap<PathBuf, String>);

impl Pages {
    pub fn of_repository() -> Self {
        let pages = markdown().into_iter().map(|(path, text)| {
            let text = match included(&path, &text) {
                Some(file) => fs::read_to_string(root().join(file)).expect("an included file"),
                None => text,
            };
            (path, text)
        });
        Self(pages.collect())
    }

    /// Complaints about links that lead nowhere.
    pub fn broken(&self) -> Vec<String> {
        let book = fs::read_to_string(root().join("book.toml")).expect("book.toml");
        self.0
            .iter()
            .flat_map(|(path, text)| {
                let links = links(text).into_iter();
                links.filter_map(|link| {
                    let reason = self.wrong(path, &link, &book)?;
                    Some(format!("{}: {link}: {reason}", path.display()))
                })
            })
            .collect()
    }

    /// What is wrong with a link of a page.
    fn wrong(&self, page: &Path, link: &str, book: &str) -> Option<&'static str> {
        if ["https://", "http://", "mailto:"]
            .iter()
            .any(|s| link.starts_with(s))
        {
            return None;
        }
        let (name, anchor) = link.split_once('#').unwrap_or((link, ""));
        let target = match name {
            "" => page.to_owned(),
            _ => normal(&page.with_file_name(name)),
        };
        // A page that includes a file has that file's links: in the book, those into `docs` are redirected.
        let redirect = Path::new(name).with_extension("html");
        let redirected = book.contains(&format!("\"/{}\" =", redirect.display()));
        let target = match target.strip_prefix("docs/docs") {
            Ok(rest) if redirected => Path::new("docs").join(rest),
            Ok(_) => return Some("book.toml has no redirect of it"),
            Err(_) => target,
        };
        if page.starts_with("docs") && !target.starts_with("docs") {
            return Some("it leaves the book");
        }
        if page.starts_with("docs") && page != Path::new(SUMMARY) && name.ends_with("README.md") {
            return Some("mdBook gives the page another name");
        }
        if !root().join(&target).exists() {
            return Some("there is no such file");
        }
        let headings = || self.0.get(&target).map(|text| anchors(text));
        let known = anchor.is_empty() || headings().is_some_and(|a| a.iter().any(|a| a == anchor));
        (!known).then_some("there is no such heading")
    }

    /// Pages below `docs` that `docs/SUMMARY.md` does not list.
    pub fn unlisted(&self) -> Vec<String> {
        let summary = Path::new(SUMMARY);
        let listed: Vec<PathBuf> = links(&self.0[summary])
            .iter()
            .map(|link| normal(&summary.with_file_name(link)))
            .collect();
        let pages = self
            .0
            .keys()
            .filter(|page| page.starts_with("docs") && *page != summary);
        let missing = pages.filter(|page| !listed.contains(page));
        missing.map(|page| page.display().to_string()).collect()
    }
}

/// All Markdown at the root and below `docs`.
pub fn markdown() -> Vec<Source> {
    let mut found = Vec::new();
    let mut folders = vec![PathBuf::from("docs"), PathBuf::new()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root().join(&folder)).expect("a folder") {
            let path = folder.join(entry.expect("an entry").file_name());
            if path.extension().is_some_and(|e| e == "md") {
                let text = fs::read_to_string(root().join(&path)).expect("a document");
                found.push((path, text));
            } else if path.starts_with("docs")
                && root().join(&path).is_dir()
                && path != Path::new("docs")
            {
                folders.push(path);
            }
        }
    }
    found
}

/// The file that a page consists of, if it includes one.
fn included(page: &Path, text: &str) -> Option<PathBuf> {
    let name = text
        .trim()
        .strip_prefix("{{#include ")?
        .strip_suffix("}}")?;
    Some(normal(&page.with_file_name(name)))
}

/// A path without `..`.
fn normal(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut path, part| {
        match part {
            Component::ParentDir => drop(path.pop()),
            part => path.push(part),
        }
        path
    })
}

/// The lines outside of code fences, with code spans left out.
fn prose(text: &str) -> impl Iterator<Item = String> {
    let mut fenced = false;
    text.lines().filter_map(move |line| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        let spans = line.split('`').step_by(2).collect::<Vec<_>>();
        (!fenced && !fence).then(|| spans.join("`"))
    })
}

/// The targets of links and pictures.
fn links(text: &str) -> Vec<String> {
    let targets = |line: String| {
        let parts = line.split("](").skip(1);
        let targets = parts.filter_map(|rest| Some(rest.split_once(')')?.0.to_owned()));
        targets.collect::<Vec<_>>()
    };
    prose(text).flat_map(targets).collect()
}

/// The anchors of headings, as GitHub and mdBook make them.
fn anchors(text: &str) -> Vec<String> {
    let mut fenced = false;
    let headings = text.lines().filter(|line| {
        fenced ^= line.starts_with("```");
        !fenced && line.starts_with('#')
    });
    let anchor = |heading: &str| {
        let words = heading.trim_start_matches('#').trim().to_lowercase();
        let kept = words
            .chars()
            .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

#[test]
fn links_are_found() {
    let text = "A [page](A.md#b-c), ![a picture](a.png) and [`code`](B.md), but not `[x](y)`.\n```\n[z](Z.md)\n```\n";
    assert_eq!(links(text), ["A.md#b-c", "a.png", "B.md"]);
    assert_eq!(
        anchors("# A, b: `c`\n```\n# no\n```\n## The σ and γ\n"),
        ["a-b-c", "the-σ-and-γ"]
    );
}

#[test]
fn a_link_that_is_gone_is_a_complaint() {
    let pages = Pages::of_repository();
    let wrong = |page: &str, link| {
        pages.wrong(
            Path::new(page),
            link,
            "\"/docs/GPU.html\" = \"../GPU.html\"",
        )
    };
    for (page, link) in [
        ("README.md", "docs/GUIDE.md#gradients"),
        ("docs/GUIDE.md", "BLUR.md"),
        ("docs/ARCHITECTURE.md", "docs/GPU.md"),
        ("docs/recipes/pose.md", "../GUIDE.md#gradients"),
        ("docs/GUIDE.md", "https://burn.dev"),
    ] {
        assert_eq!(wrong(page, link), None, "{page}: {link}");
    }
    for (page, link, reason) in [
        ("docs/GUIDE.md", "GONE.md", "there is no such file"),
        ("docs/GUIDE.md", "#gone", "there is no such heading"),
        ("docs/GUIDE.md", "../ARCHITECTURE.md", "it leaves the book"),
        (
            "docs/GUIDE.md",
            "README.md",
            "mdBook gives the page another name",
        ),
        (
            "docs/ARCHITECTURE.md",
            "docs/BLUR.md",
            "book.toml has no redirect of it",
        ),
    ] {
        assert_eq!(wrong(page, link), Some(reason), "{page}: {link}");
    }
}
