//! Materials of risers: a line of the library, or a webbing.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{LineMaterial, TapeMaterial};

/// What a riser consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RiserMaterial {
    /// One line.
    Line(LineMaterial),
    /// One tape or webbing.
    Webbing(TapeMaterial),
}

impl RiserMaterial {
    /// All of them, in the order of the page.
    pub fn all() -> impl Iterator<Item = RiserMaterial> {
        let lines = LineMaterial::ALL.into_iter().map(RiserMaterial::Line);
        lines.chain(TapeMaterial::ALL.into_iter().map(RiserMaterial::Webbing))
    }

    /// Name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            RiserMaterial::Line(m) => m.name(),
            RiserMaterial::Webbing(m) => m.name(),
        }
    }

    /// Keys of `[risers]` that it gives, with their values.
    pub fn values(self) -> Vec<(&'static str, f64)> {
        match self {
            RiserMaterial::Line(m) => m.riser_values(),
            RiserMaterial::Webbing(m) => m.entry().values.iter().map(|v| (v.key, v.value)).collect(),
        }
    }
}

/// One list of names, as that of a single enumeration.
impl JsonSchema for RiserMaterial {
    fn schema_name() -> Cow<'static, str> {
        "RiserMaterial".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = LineMaterial::json_schema(generator);
        let webbings = TapeMaterial::json_schema(generator);
        if let (Some(Value::Array(all)), Some(Value::Array(more))) =
            (schema.get_mut("oneOf"), webbings.get("oneOf"))
        {
            all.extend(more.iter().cloned());
        }
        let text = "Lines, tapes and webbings of the library, with sources in the reference of materials.";
        schema.insert("description".into(), text.into());
        schema
    }
}
