//! The links of the documents lead somewhere: each relative one names a file or a folder, and each anchor a heading.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::support::root;

/// Folders that hold what is built and what is fetched.
const NOT_OURS: [&str; 2] = ["target", "node_modules"];

/// The Markdown files under a folder.
fn pages(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry"));
    let is_ours = |name: &str| !name.starts_with('.') && !NOT_OURS.contains(&name);
    let ours = entries.filter(|entry| is_ours(&entry.file_name().to_string_lossy()));
    ours.flat_map(|entry| {
        let path = entry.path();
        let is_page = path.extension().is_some_and(|end| end == "md");
        if path.is_dir() { pages(&path) } else { Vec::from_iter(is_page.then_some(path)) }
    })
    .collect()
}

/// The lines of a page that are no code.
fn prose(page: &Path) -> String {
    let text = fs::read_to_string(page).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
    let mut in_code = false;
    let lines = text.lines().filter(|line| {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        !in_code && !is_fence
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// The anchor that a viewer gives a heading: small letters, hyphens for spaces, no other marks.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|letter| letter.is_alphanumeric() || " -_".contains(*letter));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

fn anchors(text: &str) -> BTreeSet<String> {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    headings.map(|line| anchor(line.trim_start_matches('#'))).collect()
}

/// A path without `..`, which needs no file at its place.
fn plain(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut plain, part| {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            part => plain.push(part),
        }
        plain
    })
}

#[test]
fn every_relative_link_of_a_document_leads_to_a_file_and_a_heading() {
    // The template of a page links as the page does, which is here too.
    let pages = pages(root()).into_iter().filter(|page| !page.ends_with("xtask/src/tour/page.md"));
    let texts: BTreeMap<_, _> = pages.map(|page| (plain(&page), prose(&page))).collect();
    let (mut wrong, mut checked) = (Vec::new(), 0);
    for (page, text) in &texts {
        let links = text.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(link, _)| link);
        for link in links.filter(|link| !link.contains(':')) {
            checked += 1;
            let (path, heading) = link.split_once('#').unwrap_or((link, ""));
            let folder = page.parent().expect("a folder");
            let target = if path.is_empty() { page.clone() } else { plain(&folder.join(path)) };
            let has_heading =
                heading.is_empty() || texts.get(&target).is_none_or(|text| anchors(text).contains(heading));
            if !target.exists() || !has_heading {
                wrong.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(checked >= 100, "only {checked} links were found");
}
