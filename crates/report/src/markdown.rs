//! The report as Markdown, with its pictures in a folder next to it.

use std::path::Path;

use coupling::error::RunError;

use super::document::{Block, Document, Section, Table};

/// The picture files of a report.
struct Files<'a> {
    /// Folder of the pictures.
    folder: &'a Path,
    /// Name of the folder in links.
    name: String,
    bytes: usize,
}

impl Files<'_> {
    /// Writes a picture and returns its Markdown link with the caption.
    fn picture(&mut self, file: &str, caption: &str, bytes: &[u8]) -> Result<String, RunError> {
        let path = self.folder.join(file);
        std::fs::write(&path, bytes).map_err(RunError::file("write", &path))?;
        self.bytes += bytes.len();
        Ok(format!("![{}]({}/{file})\n\n{caption}\n\n", plain(caption), self.name))
    }
}

/// Writes the text to `out` and the pictures to the folder `<name of out>-pictures`; returns the total size, bytes.
pub(super) fn write(document: &Document, out: &Path) -> Result<usize, RunError> {
    let name = out.file_stem().unwrap_or_default().to_string_lossy().replace(' ', "-") + "-pictures";
    let folder = out.with_file_name(&name);
    std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
    let mut files = Files { folder: &folder, name, bytes: 0 };
    let mut text = format!("# {}\n\n{}\n\n", document.title, document.status);
    text += "| | | |\n|---|---|---|\n";
    for card in &document.cards {
        text += &format!("| {} | **{}** | {} |\n", card.label, card.value, cell(&card.notes.join("; ")));
    }
    text.push('\n');
    for section in &document.sections {
        text += &self::section(section, &mut files)?;
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    std::fs::write(out, &text).map_err(RunError::file("write", out))?;
    Ok(text.len() + files.bytes)
}

/// Removes characters that would end the text of a link.
fn plain(text: &str) -> String {
    text.replace(['[', ']'], "").replace('\n', " ")
}

/// Escapes characters that would end a table cell.
fn cell(text: &str) -> String {
    text.replace('|', "\\|").replace('\n', " ")
}

fn section(section: &Section, files: &mut Files<'_>) -> Result<String, RunError> {
    let mut out = format!("## {}\n\n{}\n\n", section.title, section.lead);
    for block in &section.blocks {
        match block {
            Block::Text(text) => out += &format!("{text}\n\n"),
            Block::Table(table) => out += &self::table(table),
            Block::Charts(charts) => {
                for c in charts {
                    let caption = format!("{}. {}", c.heading(), c.note);
                    out += &files.picture(&format!("{}.svg", c.id), &caption, c.file().as_bytes())?;
                }
            }
            Block::Bars(bars) => {
                let caption = format!("{}. {}", bars.title, bars.note);
                out += &files.picture(&format!("{}-bars.svg", bars.id), &caption, bars.file().as_bytes())?;
            }
            Block::Pictures(pictures) => {
                for p in pictures {
                    out += &files.picture(&format!("{}.png", p.id), &p.caption, &p.png)?;
                }
            }
            Block::Canopy(canopy) => {
                if let Some(p) = &canopy.picture {
                    out += &files.picture(&format!("{}.png", p.id), &p.caption, &p.png)?;
                }
            }
            Block::List(items) => {
                out.extend(items.iter().map(|i| format!("- {}\n", i.replace('\n', " "))));
                out.push('\n');
            }
            Block::Code { title, text } => {
                out += &format!(
                    "<details><summary>{title}</summary>\n\n```\n{}\n```\n\n</details>\n\n",
                    text.trim_end()
                );
            }
        }
    }
    Ok(out)
}

fn table(table: &Table) -> String {
    let width = table.rows.iter().map(Vec::len).chain([table.head.len()]).max().unwrap_or(0);
    if width == 0 {
        return String::new();
    }
    let row = |cells: &[String]| {
        let mut cells: Vec<String> = cells.iter().map(|c| cell(c)).collect();
        cells.resize(width, String::new());
        format!("| {} |\n", cells.join(" | "))
    };
    let mut out = if table.caption.is_empty() { String::new() } else { format!("{}\n\n", table.caption) };
    out += &row(&table.head);
    out += &format!("|{}\n", "---|".repeat(width));
    out.extend(table.rows.iter().map(|r| row(r)));
    out + "\n"
}
