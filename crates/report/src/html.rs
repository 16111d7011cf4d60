//! The report as one self-contained HTML page: it loads nothing from the network or from other files.

use base64::Engine;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::chart::{STYLE, units};
use super::document::{Block, Canopy, Card, Document, Picture, Section, Table};

const PAGE_STYLE: &str = include_str!("page/page.css");
const PAGE_SCRIPT: &str = include_str!("page/page.js");
/// Keeps scroll position and view over a reload.
const VIEW_SCRIPT: &str = include_str!("page/view.js");
/// three.js and the viewer, bundled by `viewer/build`.
const VIEWER: &str = include_str!("viewer/viewer.min.js");
/// Content security policy: the page loads nothing.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The page. `reload_s`: it reloads itself at this interval, s, because the run continues.
pub(super) fn page(document: &Document, reload_s: Option<u64>) -> String {
    let canopy = |s: &Section| s.blocks.iter().any(|b| matches!(b, Block::Canopy(_)));
    let with_canopy = document.sections.iter().any(canopy);
    // The view is what a reader sees first.
    let (view, others) =
        document.sections.split_at(document.sections.iter().take_while(|s| canopy(s)).count());
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="color-scheme" content="light dark";
                meta name="generator" content=(format!("ripstop {VERSION}"));
                link rel="icon" href="data:,";
                @if let Some(seconds) = reload_s {
                    noscript { meta http-equiv="refresh" content=(seconds); }
                }
                title { (document.title) }
                style { (PreEscaped(STYLE)) (PreEscaped(PAGE_STYLE)) }
            }
            body data-reload=[reload_s] {
                header {
                    h1 { (document.title) }
                    p.status { (document.status) }
                }
                nav aria-label="Sections" {
                    @for section in &document.sections {
                        a href=(format!("#{}", section.id)) { (section.title) }
                    }
                }
                main {
                    @for section in view { (self::section(section)) }
                    div.cards { @for card in &document.cards { (self::card(card)) } }
                    @for section in others { (self::section(section)) }
                }
                footer { "Written by ripstop " (VERSION) " from the results of the run." }
                script { (PreEscaped(PAGE_SCRIPT)) }
                @if with_canopy { script { (PreEscaped(VIEWER)) } }
                script { (PreEscaped(VIEW_SCRIPT)) }
            }
        }
    };
    page.into_string() + "\n"
}

fn card(card: &Card) -> Markup {
    html! {
        div.card.warn[card.warn] {
            h2 { (card.label) }
            p.value { (units(&card.value)) }
            ul { @for note in &card.notes { li { (units(note)) } } }
        }
    }
}

fn section(section: &Section) -> Markup {
    html! {
        section id=(section.id) {
            h2 { (section.title) }
            p.lead { (section.lead) }
            @for block in &section.blocks { (self::block(block)) }
        }
    }
}

fn block(block: &Block) -> Markup {
    match block {
        Block::Text(text) => html! { p { (text) } },
        Block::Table(table) => self::table(table),
        Block::Charts(charts) => html! {
            div.charts {
                @for chart in charts {
                    figure.panel id=(chart.id) {
                        h3 { (chart.heading()) }
                        (PreEscaped(chart.element()))
                        figcaption { (chart.note) }
                    }
                }
            }
        },
        Block::Bars(bars) => html! {
            figure.panel.wide id=(format!("{}-bars", bars.id)) {
                h3 { (bars.title) }
                (PreEscaped(bars.element()))
                figcaption { (bars.note) }
            }
        },
        Block::Pictures(pictures) => html! {
            div.charts { @for p in pictures { figure.panel { (picture(p)) } } }
        },
        Block::Canopy(canopy) => self::canopy(canopy),
        Block::List(items) => html! {
            @if !items.is_empty() { ul.list { @for item in items { li { (item) } } } }
        },
        Block::Code { title, text } => html! { details { summary { (title) } pre { (text) } } },
    }
}

/// A table whose first column names the rows.
fn table(table: &Table) -> Markup {
    html! {
        div.scroll {
            table {
                caption { (units(&table.caption)) }
                @if !table.head.is_empty() {
                    thead { tr { @for name in &table.head { th scope="col" { (name) } } } }
                }
                tbody {
                    @for row in &table.rows {
                        tr {
                            @for name in row.iter().take(1) { th scope="row" { (units(name)) } }
                            @for value in row.iter().skip(1) { td { (units(value)) } }
                        }
                    }
                }
            }
        }
    }
}

fn picture(picture: &Picture) -> Markup {
    let data = base64::engine::general_purpose::STANDARD.encode(&picture.png);
    html! {
        img alt=(picture.caption) src=(format!("data:image/png;base64,{data}"));
        figcaption { (picture.caption) }
    }
}

/// The viewer of the canopy with its controls and data.
fn canopy(canopy: &Canopy) -> Markup {
    // `</` would end the script element.
    let header = canopy.packed.header.to_string().replace('<', "\\u003c");
    let data = format!("{{\"header\":{header},\"data\":\"{}\"}}", canopy.packed.data);
    html! {
        div.panel.viewer #canopy data-state="loading" {
            div.bar {
                label { "Stage " select data-part="stage" {} }
                label { "Colour " select data-part="field" {} }
                label { input type="checkbox" data-part="lines" checked; " lines and payload" }
                label { input type="checkbox" data-part="mesh"; " mesh" }
                button type="button" data-part="reset" { "Reset view" }
            }
            div.stage {
                canvas data-part="canvas" tabindex="0" aria-label="The canopy in three dimensions" {}
                output.value data-part="value" {}
            }
            div.bar {
                button type="button" data-part="play" { "Play" }
                input type="range" min="0" max="0" step="1" value="0" data-part="time" aria-label="Time";
                output data-part="clock" {}
            }
            div.bar.legend data-part="legend" {}
            p.note data-part="note" {}
            div.fallback {
                p data-part="trouble" {}
                @if let Some(p) = &canopy.picture { (picture(p)) }
            }
            p.note { (canopy.packed.note) }
        }
        script #canopy-data type="application/json" { (PreEscaped(data)) }
    }
}
