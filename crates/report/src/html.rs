//! A report as one page that needs nothing else: no network, no file beside it.

use base64::Engine;

use super::chart::{STYLE, escape};
use super::document::{Block, Canopy, Document, Picture, Section, Table};

const PAGE_STYLE: &str = include_str!("page/page.css");
const PAGE_SCRIPT: &str = include_str!("page/page.js");
/// three.js and the viewer, made by `viewer/build`.
const VIEWER: &str = include_str!("viewer/viewer.min.js");

/// The page.
pub(super) fn page(document: &Document) -> String {
    let mut body = String::new();
    body += &format!(
        "<header><h1>{}</h1><p class=\"status\">{}</p></header>\n",
        escape(&document.title),
        escape(&document.status)
    );
    body += "<div class=\"cards\">";
    for card in &document.cards {
        let notes: String = card.notes.iter().map(|n| format!("<li>{}</li>", units(n))).collect();
        body += &format!(
            "<div class=\"card{}\"><h2>{}</h2><p class=\"value\">{}</p><ul>{notes}</ul></div>",
            if card.warn { " warn" } else { "" },
            escape(&card.label),
            units(&card.value)
        );
    }
    body += "</div>\n<nav aria-label=\"Sections\">";
    for section in &document.sections {
        body += &format!("<a href=\"#{}\">{}</a>", section.id, escape(&section.title));
    }
    body += "</nav>\n<main>\n";
    let mut with_canopy = false;
    for section in &document.sections {
        body += &self::section(section);
        with_canopy |= section.blocks.iter().any(|b| matches!(b, Block::Canopy(_)));
    }
    body += "</main>\n";
    let viewer = if with_canopy { format!("<script>{VIEWER}</script>\n") } else { String::new() };
    // The policy lets the page load nothing: what it shows lies in it.
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
         style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"generator\" content=\"ripstop {}\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{}</title>\n<style>{STYLE}{PAGE_STYLE}</style>\n</head>\n<body>\n\
         {body}<footer>Written by ripstop {} from the results of the run.</footer>\n\
         <script>{PAGE_SCRIPT}</script>\n{viewer}</body>\n</html>\n",
        env!("CARGO_PKG_VERSION"),
        escape(&document.title),
        env!("CARGO_PKG_VERSION"),
    )
}

/// Text with `m2` and `m3` as people write them.
fn units(text: &str) -> String {
    escape(text).replace(" m2", " m\u{b2}").replace(" m3", " m\u{b3}").replace(", 1<", "<")
}

fn section(section: &Section) -> String {
    let mut out = format!(
        "<section id=\"{}\"><h2>{}</h2><p class=\"lead\">{}</p>\n",
        section.id,
        escape(&section.title),
        escape(&section.lead)
    );
    for block in &section.blocks {
        out += &self::block(block);
    }
    out + "</section>\n"
}

fn block(block: &Block) -> String {
    match block {
        Block::Text(text) => format!("<p>{}</p>\n", escape(text)),
        Block::Table(table) => self::table(table),
        Block::Charts(charts) => {
            let figures = charts.iter().map(|c| {
                let unit = if c.unit.is_empty() { String::new() } else { format!(", {}", c.unit) };
                let keys: String = if c.series.len() > 1 {
                    let key = |(i, s): (usize, &super::chart::Series)| {
                        format!("<span class=\"key k{}\">{}</span>", i % super::chart::COLOURS, escape(&s.label))
                    };
                    c.series.iter().enumerate().map(key).collect()
                } else {
                    String::new()
                };
                format!(
                    "<figure class=\"panel\" id=\"{}\"><h3>{}{}</h3>{keys}{}<figcaption>{}</figcaption></figure>\n",
                    c.id,
                    escape(&c.title),
                    units(&unit),
                    c.svg(false),
                    escape(&c.note)
                )
            });
            format!("<div class=\"charts\">{}</div>\n", figures.collect::<String>())
        }
        Block::Bars(bars) => format!(
            "<figure class=\"panel wide\" id=\"{}-bars\"><h3>{}</h3>{}<figcaption>{}</figcaption></figure>\n",
            bars.id,
            escape(&bars.title),
            bars.svg(false),
            escape(&bars.note)
        ),
        Block::Pictures(pictures) => {
            let figures =
                pictures.iter().map(|p| format!("<figure class=\"panel\">{}</figure>\n", picture(p)));
            format!("<div class=\"charts\">{}</div>\n", figures.collect::<String>())
        }
        Block::Canopy(canopy) => self::canopy(canopy),
        Block::List(items) if items.is_empty() => String::new(),
        Block::List(items) => {
            let items: String = items.iter().map(|i| format!("<li>{}</li>", escape(i))).collect();
            format!("<ul class=\"list\">{items}</ul>\n")
        }
        Block::Code { title, text } => {
            format!("<details><summary>{}</summary><pre>{}</pre></details>\n", escape(title), escape(text))
        }
    }
}

fn table(table: &Table) -> String {
    let mut out = String::from("<div class=\"scroll\"><table>");
    if !table.head.is_empty() {
        let cells: String =
            table.head.iter().map(|h| format!("<th scope=\"col\">{}</th>", escape(h))).collect();
        out += &format!("<thead><tr>{cells}</tr></thead>");
    }
    out += "<tbody>";
    for row in &table.rows {
        let mut cells = row.iter();
        let first = cells.next().map_or(String::new(), |c| format!("<th scope=\"row\">{}</th>", units(c)));
        let rest: String = cells.map(|c| format!("<td>{}</td>", units(c))).collect();
        out += &format!("<tr>{first}{rest}</tr>");
    }
    out + "</tbody></table></div>\n"
}

fn picture(picture: &Picture) -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(&picture.png);
    let caption = escape(&picture.caption);
    format!("<img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption>")
}

fn canopy(canopy: &Canopy) -> String {
    let header = canopy.packed.header.to_string().replace('<', "\\u003c");
    let fallback = canopy.picture.as_ref().map(picture).unwrap_or_default();
    format!(
        "<div class=\"panel viewer\" id=\"canopy\" data-state=\"loading\">\n\
         <div class=\"bar\"><label>Stage <select data-part=\"stage\"></select></label>\
         <label>Colour <select data-part=\"field\"></select></label>\
         <label><input type=\"checkbox\" data-part=\"lines\" checked> lines</label>\
         <label><input type=\"checkbox\" data-part=\"mesh\"> mesh</label>\
         <button type=\"button\" data-part=\"reset\">Reset view</button></div>\n\
         <div class=\"stage\"><canvas data-part=\"canvas\" tabindex=\"0\" aria-label=\"The canopy in three dimensions\"></canvas>\
         <output class=\"value\" data-part=\"value\"></output></div>\n\
         <div class=\"bar\"><button type=\"button\" data-part=\"play\">Play</button>\
         <input type=\"range\" min=\"0\" max=\"0\" step=\"1\" value=\"0\" data-part=\"time\" aria-label=\"Time\">\
         <output data-part=\"clock\"></output></div>\n\
         <div class=\"bar legend\" data-part=\"legend\"></div><p class=\"note\" data-part=\"note\"></p>\n\
         <div class=\"fallback\"><p data-part=\"trouble\"></p>{fallback}</div>\n\
         <p class=\"note\">{}</p></div>\n\
         <script type=\"application/json\" id=\"canopy-data\">{{\"header\":{header},\"data\":\"{}\"}}</script>\n",
        escape(&canopy.packed.note),
        canopy.packed.data
    )
}
