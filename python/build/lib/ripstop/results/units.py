"""Units of columns and fields: the end of a name is its unit (docs/reference/results.md)."""

# Unit by the end of a name; the longest end counts.
_ENDS = {
    "_1_s": "1/s",
    "_1_s2": "1/s²",
    "_deg": "°",
    "_deg_s": "°/s",
    "_j": "J",
    "_k": "K",
    "_kg": "kg",
    "_kg_m": "kg/m",
    "_kg_m3": "kg/m³",
    "_kg_s": "kg/s",
    "_m": "m",
    "_m2": "m²",
    "_m2_s": "m²/s",
    "_m2_s2": "m²/s²",
    "_m3": "m³",
    "_m_s": "m/s",
    "_m_s2": "m/s²",
    "_n": "N",
    "_n_m": "N/m",
    "_n_s": "N s",
    "_pa": "Pa",
    "_pa_s": "Pa s",
    "_per_rad": "1/rad",
    "_per_s": "1/s",
    "_rad": "rad",
    "_rad_s": "rad/s",
    "_s": "s",
}
_LONGEST = max(end.count("_") for end in _ENDS)
# In these names `_n_m` is a product.
_PRODUCTS = ("moment", "bending")


def unit_of(name):
    """Unit of a column or field by its name, such as "m/s" of `descent_speed_m_s`; "" of a
    count, a share or a coefficient. Means and intervals of a sweep have the unit of their quantity."""
    name = name.removesuffix("_interval_95")
    parts = name.split("_")
    for length in range(min(_LONGEST, len(parts) - 1), 0, -1):
        end = "_" + "_".join(parts[-length:])
        if end == "_n_m" and any(word in name for word in _PRODUCTS):
            return "N m"
        if end in _ENDS:
            return _ENDS[end]
    return ""


def units_of(names):
    """Dictionary of names to units."""
    return {name: unit_of(name) for name in names}
