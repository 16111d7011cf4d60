//! Units from the ends of names.

/// Ends of names and their units, longer ends before the shorter ones that they contain.
const UNITS: &[(&str, &str)] = &[
    ("_deg_s", "°/s"),
    ("_per_rad", "1/rad"),
    ("_pa_s2_m2", "Pa s²/m²"),
    ("strength_n_m", "N/m"),
    ("force_n_m", "N/m"),
    ("force_99_n_m", "N/m"),
    ("_pa_s_m", "Pa s/m"),
    ("_rad_s", "rad/s"),
    ("_kg_m3", "kg/m³"),
    ("_n_m3", "N/m³"),
    ("_kg_m2", "kg m²"),
    ("_m3_s", "m³/s"),
    ("_kg_s", "kg/s"),
    ("_pa_s", "Pa s"),
    ("_per_s", "1/s"),
    ("_per_m", "1/m"),
    ("_m_s2", "m/s²"),
    ("_m_s", "m/s"),
    ("_n_m", "N m"),
    ("_n_s", "N s"),
    ("_bytes", "byte"),
    ("_gib", "GiB"),
    ("_kg_m", "kg/m"),
    ("_rad", "rad"),
    ("_deg", "°"),
    ("_kg", "kg"),
    ("_pa", "Pa"),
    ("_m3", "m³"),
    ("_m2", "m²"),
    ("_m", "m"),
    ("_s", "s"),
    ("_j", "J"),
    ("_k", "K"),
    ("_n", "N"),
];

/// The unit that `name` ends in.
pub fn unit(name: &str) -> Option<&'static str> {
    UNITS.iter().find(|(end, _)| name.ends_with(end)).map(|(_, unit)| *unit)
}

#[test]
fn units_are_read_from_the_ends_of_names() {
    for (name, expected) in [
        ("duration_s", Some("s")),
        ("wind_m_s", Some("m/s")),
        ("flow_rate_m3_s", Some("m³/s")),
        ("gravity_m_s2", Some("m/s²")),
        ("inertial_pa_s2_m2", Some("Pa s²/m²")),
        ("viscous_pa_s_m", Some("Pa s/m")),
        ("dynamic_viscosity_pa_s", Some("Pa s")),
        ("mass_damping_per_s", Some("1/s")),
        ("youngs_modulus_2_pa", Some("Pa")),
        ("inertia_kg_m2", Some("kg m²")),
        ("mass_kg_m", Some("kg/m")),
        ("strength_n_m", Some("N/m")),
        ("strength_n", Some("N")),
        ("max_membrane_force_n_m", Some("N/m")),
        ("membrane_force_99_n_m", Some("N/m")),
        ("canopy_moment_x_n_m", Some("N m")),
        ("cells_across", None),
        ("k", None),
        ("newton_max_steps", None),
    ] {
        assert_eq!(unit(name), expected, "{name}");
    }
    for (i, (end, _)) in UNITS.iter().enumerate() {
        assert!(UNITS[..i].iter().all(|(earlier, _)| !end.ends_with(earlier)), "{end} is never found");
    }
}
