//! Draws the moment of a wrinkling strip over its curvature, with the closed form:
//! `cargo run --release -p structure-solver --example strip -- docs/pictures/strip.svg`

#[allow(dead_code)]
#[path = "../tests/verification/common.rs"]
mod common;
#[allow(dead_code)]
#[path = "../tests/verification/shapes.rs"]
mod shapes;
#[path = "../tests/verification/wrinkling.rs"]
mod wrinkling;

use std::fmt::Write;

use common::Element;
use wrinkling::{bend, stein_hedgepeth};

/// Pixels of kappa* (0 to 10) and of a ratio (0 to 1).
fn at(kappa: f64, ratio: f64) -> (f64, f64) {
    (60.0 + 50.0 * kappa, 330.0 - 300.0 * ratio)
}

fn main() {
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 600 390\" font-family=\"sans-serif\" font-size=\"14\">\n\
         <rect width=\"600\" height=\"390\" fill=\"white\"/>\n",
    );
    let mut add = |line: String| writeln!(svg, "{line}").expect("a string grows");
    for k in 0..=5 {
        let (x, y) = (at(2.0 * f64::from(k), 0.0).0, at(0.0, 0.2 * f64::from(k)).1);
        add(format!(
            "<path d=\"M{x} 30V330M60 {y}H560\" stroke=\"#ddd\"/>\
             <text x=\"{x}\" y=\"350\" text-anchor=\"middle\">{}</text>\
             <text x=\"50\" y=\"{}\" text-anchor=\"end\">{:.1}</text>",
            2 * k,
            y + 5.0,
            0.2 * f64::from(k)
        ));
    }
    for (c, color) in [(0, "#1f5fa8"), (1, "#b3541e")] {
        let points: Vec<String> = (0..=200)
            .map(|i| {
                let kappa = 0.05 * f64::from(i);
                let (x, y) = at(kappa, stein_hedgepeth(kappa)[c]);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        add(format!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\"/>",
            points.join(" ")
        ));
    }
    for kappa in [0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0] {
        let [found, moment, band] = bend(Element::Triangle, 24, kappa);
        println!("kappa* {found:.4}: 2M/(Ph) {moment:.4}, b/h {band:.3}; exact {:?}", stein_hedgepeth(kappa));
        for (value, color) in [(moment, "#1f5fa8"), (band, "#b3541e")] {
            let (x, y) = at(found, value);
            add(format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{color}\"/>"));
        }
    }
    add("<text x=\"310\" y=\"376\" text-anchor=\"middle\">curvature E t h\u{b2} \u{3ba} / (2 P)</text>"
        .into());
    add("<text x=\"440\" y=\"75\" fill=\"#1f5fa8\">moment 2 M / (P h)</text>".into());
    add("<text x=\"440\" y=\"185\" fill=\"#b3541e\">wrinkled band b / h</text>".into());
    add("<text x=\"60\" y=\"20\">Lines: Stein and Hedgepeth (1961); dots: 24 x 24 triangle pairs</text></svg>".into());
    let file = std::env::args().nth(1).expect("name the picture's file");
    std::fs::write(&file, svg).unwrap_or_else(|e| panic!("{file}: {e}"));
}
