//! `docs/reference/materials.md`: fabrics, lines and tapes of the library with the source of each value.

use case::materials::{Entry, Source};
use case::{FabricMaterial, LineMaterial, TapeMaterial};

use super::markdown::{compare_or_write, head, inline, table};
use super::units::unit;

const INTRODUCTION: &str = "\
`material` in `[fabric]`, `[lines]`, `[risers]` or a table of `[tapes]` names an entry of this page. The entry gives the keys of the section that the scene leaves \
out; keys that the scene gives have priority. `ripstop check` then judges the numbers as if they were written in the scene.

```toml
[fabric]
material = \"pia-c44378-type4\"

[lines]
material = \"pia-c5040-type3\"
strength_n = 2200.0            # of a worn line
```

## How the values follow

- **Specified** minima and maxima are limits that a lot must meet. A real lot is lighter, stronger and of another permeability: give the \
values of a test where you have one.
- **Thickness and area** are those of the solid polymer: areal density or weight for each metre over the density of the polymer. With them \
mass and stiffness are right; the cloth as woven is two to three times as thick.
- **Young's modulus** is the secant from the origin to the break: strength over elongation at break, over thickness or area. Between Green \
strain and second Piola-Kirchhoff stress the same modulus gives 1.3 times the strength at an elongation of 20 % and 1.5 times at 30 %; below 5 % \
the difference is less than 8 %. Real cloth and braid are not linear.
- **Poisson's ratio** is 0.3 for all fabrics, an assumption. `wrinkling` is on. No entry is orthotropic: shear moduli were not found.
- **Permeability** in cubic feet a minute through a square foot (cfm) holds at half an inch of water and gives the viscous coefficient only. A \
scene without `[flow]` gets none.
- **Risers** have the axial stiffness (modulus times area), the mass for each metre and the strength of one line or one webbing of the entry.
- **Tapes** take axial stiffness, mass and strength of an entry. Their tension has no estimate before the run; the history has the largest one at \
each place.
- **Strength** is that of new material without seams, knots and wear. [Safety factors](checks.md#strengthsafety-factor) compare it with the run.

1 oz/yd² = 33.906 g/m², 1 lb/in = 175.13 N/m, 1 lb = 4.4482 N, 1 ft/lb stands for 1.4882 kg/m over the figure, 1 cfm/ft² = 0.00508 m/s, \
1 N/tex = 1 MN m/kg.";

/// A number as in a scene.
fn figure(value: f64) -> String {
    if (1e-2..1e5).contains(&value) { format!("{value}") } else { format!("{value:e}") }
}

fn section(entry: &Entry, text: &mut String) {
    let rows: Vec<Vec<String>> = entry
        .values
        .iter()
        .map(|v| {
            let source = v.source.map_or(String::new(), |s| format!("[{}]", s.number()));
            let unit = unit(v.key).unwrap_or("");
            let cells = [&format!("`{}`", v.key), &figure(v.value), unit, &v.figure, v.basis.text(), &source];
            cells.map(inline).to_vec()
        })
        .collect();
    *text += &format!("\n### `{}`\n\n{}.\n\n", entry.name, capital(entry.title));
    *text += &table(&["key", "value", "unit", "published", "basis", "source"], &rows);
    if !entry.note.is_empty() {
        *text += &format!("\n{}\n", entry.note);
    }
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn page() -> String {
    let mut text = head("Materials", INTRODUCTION);
    text += "\n## Fabrics\n";
    FabricMaterial::ALL.iter().for_each(|m| section(&m.entry(), &mut text));
    text += "\n## Lines\n";
    LineMaterial::ALL.iter().for_each(|m| section(&m.entry(), &mut text));
    text += "\n## Tapes and webbings\n";
    TapeMaterial::ALL.iter().for_each(|m| section(&m.entry(), &mut text));
    text += "\n## Sources\n\n";
    for source in Source::ALL {
        text += &format!("{}. {}.\n", source.number(), capital(source.text()));
    }
    text
}

#[test]
fn page_of_materials_is_generated_from_the_code() {
    compare_or_write("materials.md", &page());
}

/// Each source of the page is that of a value, and a value that was not opened says so.
#[test]
fn every_source_is_used() {
    let fabrics = FabricMaterial::ALL.iter().map(|m| m.entry());
    let entries = fabrics
        .chain(LineMaterial::ALL.iter().map(|m| m.entry()))
        .chain(TapeMaterial::ALL.iter().map(|m| m.entry()));
    let used: Vec<Source> = entries.flat_map(|e| e.values).filter_map(|v| v.source).collect();
    for source in Source::ALL {
        assert!(used.contains(&source), "{source:?}");
    }
    assert!(page().contains("20. From memory, not opened"));
}
