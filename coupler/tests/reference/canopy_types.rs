//! `docs/reference/canopy-types.md`, from `crates/canopies`.

use canopies::CanopyType;

use super::markdown::{compare_or_write, head, table};

fn page() -> String {
    let number = |x: Option<f64>| x.map_or("-".into(), |x| x.to_string());
    let row = |t: &CanopyType| {
        let h = t.handbook();
        let drag =
            h.map_or("-".into(), |h| format!("{:.2} to {:.2}", h.drag_coefficient[0], h.drag_coefficient[1]));
        vec![
            format!("`{}`", t.name()),
            t.description().to_owned(),
            drag,
            number(h.and_then(|h| h.opening_force_coefficient)),
            number(h.and_then(|h| h.filling_constant)),
            t.geometric_porosity().map_or("-".into(), |p| format!("{:.0} %", 100.0 * p)),
            t.risers().map_or("-".into(), |r| format!("{} of {:.3} D0, as the {}", r.count, r.length, r.of)),
        ]
    };
    let rows: Vec<Vec<String>> = CanopyType::ALL.iter().map(row).collect();
    let columns = [
        "type",
        "scene of `ripstop new`",
        "drag coefficient on S0",
        "opening force coefficient",
        "filling constant",
        "geometric porosity",
        "risers",
    ];
    let text = "Types of `ripstop new TYPE` ([how to start from one](../how-to/start-from-a-canopy-type.md)). Drag coefficients (steady descent), opening force coefficients \
        (largest force over the steady drag at the same speed, infinite mass) and filling constants (filling time times speed over nominal diameter, unreefed) are those of Knacke, \
        Parachute Recovery Systems Design Manual (1991), tables 5-1 to 5-6, quoted from memory: the tables were not opened. S0 is the nominal area of all fabric and openings. A \
        geometric porosity is that of slots which no grid resolves and which the scene represents by a cloth. Risers are those of the \
        personnel parachute that the column names, from memory too; their lines form equal groups. What Ripstop computes for these types: \
        [validation](../records/validation.md).\n\n\
        ![Eight canopies of gores and a cross, inflated by a uniform pressure, coloured by the major stress](../pictures/canopy-types.png)\n\n\
        *Scenes of `ripstop new TYPE --wind-tunnel` after their first stage: at rest under the dynamic pressure of 6 m/s, drawn by `ripstop picture`.*";
    head("Canopy types", text) + "\n" + &table(&columns, &rows)
}

#[test]
fn page_of_canopy_types_is_generated_from_the_code() {
    compare_or_write("canopy-types.md", &page());
}
