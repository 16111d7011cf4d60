//! The documentation is consistent: links of all Markdown files resolve, the book names each of its pages
//! once, and each decision record has the same parts.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::process::Command;

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};
use ripstop_tests::root;

/// A Markdown file: the targets of its links and images with their lines, and its anchors.
#[derive(Default)]
struct Page {
    links: Vec<(usize, String)>,
    anchors: BTreeSet<String>,
    headings: Vec<String>,
    /// Code spans with their lines.
    code: Vec<(usize, String)>,
}

/// The anchor that code-hosting sites and mdbook give a heading: lower case, spaces as hyphens, letters, digits,
/// hyphens and underscores kept, everything else removed.
fn slug(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.flat_map(char::to_lowercase).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// Values of `name="..."` in a piece of HTML.
fn attributes<'a>(html: &'a str, name: &str) -> Vec<&'a str> {
    let marker = format!(" {name}=\"");
    html.split(marker.as_str()).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

impl Page {
    fn parse(text: &str) -> Self {
        let options = Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH | Options::ENABLE_FOOTNOTES;
        let mut page = Self::default();
        let mut heading: Option<String> = None;
        let mut used: BTreeMap<String, usize> = BTreeMap::new();
        for (event, range) in Parser::new_ext(text, options).into_offset_iter() {
            let line = || text[..range.start].matches('\n').count() + 1;
            match event {
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => {
                    let words = heading.take().unwrap_or_default();
                    let name = slug(&words);
                    let count = used.entry(name.clone()).or_default();
                    let anchor = if *count == 0 { name } else { format!("{name}-{count}") };
                    *count += 1;
                    page.anchors.insert(anchor);
                    page.headings.push(words);
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    page.links.push((line(), dest_url.into_string()));
                }
                Event::Text(words) | Event::Code(words) => {
                    if text[range.clone()].starts_with('`') {
                        page.code.push((line(), words.to_string()));
                    }
                    if let Some(heading) = &mut heading {
                        heading.push_str(&words);
                    }
                }
                Event::Html(html) | Event::InlineHtml(html) => {
                    for name in ["href", "src"] {
                        page.links
                            .extend(attributes(&html, name).into_iter().map(|u| (line(), u.to_owned())));
                    }
                    for name in ["id", "name"] {
                        page.anchors.extend(attributes(&html, name).into_iter().map(str::to_owned));
                    }
                }
                _ => {}
            }
        }
        page
    }
}

/// `a/b/../c` as `a/c`; `None` where it leaves the repository.
fn normalised(path: &Path) -> Option<PathBuf> {
    let mut clean = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => {
                if !clean.pop() {
                    return None;
                }
            }
            Component::CurDir => {}
            other => clean.push(other),
        }
    }
    Some(clean)
}

/// Files that git tracks or would track, relative to the root. Build folders and results of runs are ignored ones.
fn files() -> BTreeSet<PathBuf> {
    let output = Command::new("git")
        .args(["ls-files", "--cached", "--others", "--exclude-standard"])
        .current_dir(root())
        .output()
        .expect("git runs");
    assert!(output.status.success(), "git ls-files: {}", String::from_utf8_lossy(&output.stderr));
    let names = String::from_utf8(output.stdout).expect("paths are UTF-8");
    names.lines().map(PathBuf::from).filter(|p| root().join(p).exists()).collect()
}

fn pages(files: &BTreeSet<PathBuf>) -> BTreeMap<PathBuf, Page> {
    let markdown = files.iter().filter(|p| p.extension().is_some_and(|e| e == "md"));
    markdown
        .map(|p| (p.clone(), Page::parse(&std::fs::read_to_string(root().join(p)).expect("text"))))
        .collect()
}

/// What is wrong with a link, or nothing.
fn fault(
    from: &Path,
    link: &str,
    files: &BTreeSet<PathBuf>,
    pages: &BTreeMap<PathBuf, Page>,
) -> Option<&'static str> {
    let elsewhere = link.contains("://") || link.starts_with("mailto:");
    // An empty target marks a chapter of the book that is not written yet.
    if elsewhere || link.is_empty() {
        return None;
    }
    let (path, anchor) = link.split_once('#').map_or((link, None), |(p, a)| (p, Some(a)));
    let target = if path.is_empty() {
        from.to_path_buf()
    } else {
        match normalised(&from.parent().expect("a file has a folder").join(path)) {
            Some(target) => target,
            None => return Some("leaves the repository"),
        }
    };
    let is_folder = target.as_os_str().is_empty() || files.iter().any(|f| f.starts_with(&target));
    if !files.contains(&target) && !is_folder {
        return Some("no such file");
    }
    match (anchor, pages.get(&target)) {
        (Some(anchor), Some(page)) if !page.anchors.contains(anchor) => Some("no such heading"),
        _ => None,
    }
}

#[test]
fn relative_links_and_anchors_of_all_pages_resolve() {
    let files = files();
    let pages = pages(&files);
    assert!(pages.len() > 40, "only {} pages were found", pages.len());
    let mut wrong = Vec::new();
    let mut count = 0;
    for (from, page) in &pages {
        for (line, link) in &page.links {
            count += 1;
            if let Some(reason) = fault(from, link, &files, &pages) {
                wrong.push(format!("{}:{line}: {link}: {reason}", from.display()));
            }
        }
    }
    assert!(count > 200, "only {count} links were found");
    assert!(wrong.is_empty(), "broken links:\n{}", wrong.join("\n"));
}

/// Names in a code span that must stand in the sources: names of four words and more in snake case (tests, columns),
/// and paths below a folder of the repository.
fn names(code: &str) -> Vec<&str> {
    let words = code.split(|c: char| !(c.is_alphanumeric() || "_/.-".contains(c)));
    let snake = |w: &str| {
        let parts: Vec<&str> = w.split('_').collect();
        parts.len() > 3 && parts.iter().all(|p| !p.is_empty() && p.chars().all(|c| c.is_ascii_alphanumeric()))
    };
    let path = |w: &str| {
        let top = w.split('/').next().unwrap_or_default();
        w.contains('/') && TOP_LEVEL.contains(&top) && Path::new(w).extension().is_some()
    };
    words.filter(|w| snake(w) || path(w)).collect()
}

/// Folders of the repository that documents name files of.
const TOP_LEVEL: [&str; 10] = [
    "cases",
    "coupler",
    "crates",
    "docs",
    "flow-solver",
    "mesh-mover",
    "python",
    "scripts",
    "structure-solver",
    "tests",
];

/// Files that documents name and git does not track, and names of other programs.
const FOREIGN: [&str; 1] = ["state_base_verbose"];

#[test]
fn names_and_paths_in_code_spans_exist() {
    let files = files();
    let is_source = |p: &&PathBuf| {
        p.extension().is_some_and(|e| {
            ["rs", "toml", "py", "txt", "json", "sh", "h", "hpp", "f90"].iter().any(|x| e == *x)
        }) || p.starts_with("scripts")
    };
    let sources: Vec<_> = files.iter().filter(is_source).collect();
    let words: BTreeSet<String> = sources
        .iter()
        .filter_map(|p| std::fs::read_to_string(root().join(p)).ok())
        .flat_map(|text| {
            let words = text.split(|c: char| !(c.is_alphanumeric() || c == '_')).map(str::to_owned);
            words.collect::<Vec<_>>()
        })
        .collect();
    let known = |name: &str| {
        FOREIGN.contains(&name)
            || words.contains(name)
            || name.contains('/') && files.contains(Path::new(name.trim_end_matches('.')))
    };
    let mut unknown = Vec::new();
    let mut count = 0;
    for (path, page) in &pages(&files) {
        // The changelog names what is gone; the code makes the columns of the page of results from names with spaces.
        if ["CHANGELOG.md", "docs/reference/results.md"].iter().any(|p| path == Path::new(p)) {
            continue;
        }
        for (line, code) in &page.code {
            let named = names(code);
            count += named.len();
            let missing = named.into_iter().filter(|n| !known(n));
            unknown.extend(missing.map(|n| format!("{}:{line}: {n}", path.display())));
        }
    }
    assert!(count > 200, "only {count} names were found");
    assert!(unknown.is_empty(), "names that do not exist:\n{}", unknown.join("\n"));
}

#[test]
fn summary_names_each_page_of_docs_once() {
    let files = files();
    let docs = Path::new("docs");
    let summary = docs.join("SUMMARY.md");
    let pages = pages(&files);
    let mut named: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for (_, link) in &pages[&summary].links {
        if !link.is_empty() {
            let page = normalised(&docs.join(link)).expect("a chapter lies in docs");
            *named.entry(page).or_default() += 1;
        }
    }
    let written: BTreeSet<_> =
        pages.keys().filter(|p| p.starts_with(docs) && **p != summary).cloned().collect();
    let missing: Vec<_> = written.iter().filter(|p| !named.contains_key(*p)).collect();
    assert!(missing.is_empty(), "pages that docs/SUMMARY.md does not name: {missing:?}");
    let extra: Vec<_> = named.keys().filter(|p| !written.contains(*p)).collect();
    assert!(extra.is_empty(), "docs/SUMMARY.md names pages that do not exist: {extra:?}");
    let twice: Vec<_> = named.iter().filter(|(_, n)| **n > 1).collect();
    assert!(twice.is_empty(), "docs/SUMMARY.md names pages more than once: {twice:?}");
}

#[test]
fn each_decision_has_a_number_of_its_own_and_four_parts_in_order() {
    let files = files();
    let folder = Path::new("docs/decisions");
    let mut numbers = BTreeSet::new();
    for (path, page) in pages(&files).iter().filter(|(p, _)| p.starts_with(folder)) {
        let name = path.file_name().expect("a name").to_string_lossy();
        if name == "README.md" {
            continue;
        }
        let number: usize =
            name[..4].parse().unwrap_or_else(|_| panic!("{name} does not begin with four digits"));
        assert!(numbers.insert(number), "decision number {number} is given twice");
        let title = page.headings.first().expect("a title");
        assert!(title.starts_with(&format!("{number}. ")), "{name}: the title is {title:?}");
        let parts: Vec<_> = page.headings[1..].iter().map(String::as_str).collect();
        assert_eq!(parts, ["Context", "Decision", "Alternatives", "Consequences"], "{name}");
    }
    let expected: BTreeSet<_> = (1..=numbers.len()).collect();
    assert!(!numbers.is_empty() && numbers == expected, "decisions are numbered 1 to N: {numbers:?}");
}

#[test]
fn anchors_follow_the_rule_of_hosting_sites() {
    let page = Page::parse("# `a.b` and *c*: 1 %\n\n## Same\n\n## Same\n\n<a id=\"own\"></a> [x](y.md#z)\n");
    let anchors: Vec<_> = page.anchors.iter().map(String::as_str).collect();
    assert_eq!(anchors, ["ab-and-c-1-", "own", "same", "same-1"]);
    assert_eq!(page.links, [(7, "y.md#z".to_owned())]);
    let [files, pages] =
        [BTreeSet::from([PathBuf::from("d/y.md")]), BTreeSet::from([PathBuf::from("d/y.md")])];
    let pages = pages.into_iter().map(|p| (p, Page::parse("# Z"))).collect();
    let of = |link| fault(Path::new("d/x.md"), link, &files, &pages);
    assert_eq!(of("y.md#z"), None);
    assert_eq!(of("y.md#q"), Some("no such heading"));
    assert_eq!(of("../y.md"), Some("no such file"));
    assert_eq!(of("../../y.md"), Some("leaves the repository"));
    let page = Page::parse("run `a_b_c_d` and\n`tests/x.rs --y a_b`, not a_b_c_e");
    let found: Vec<_> =
        page.code.iter().flat_map(|(line, code)| names(code).into_iter().map(|n| (*line, n))).collect();
    assert_eq!(found, [(1, "a_b_c_d"), (2, "tests/x.rs")]);
}
