//! The JSON schema of a scene, and the check of a TOML document against it.
//!
//! The schema is generated from the types, so editors, this check and the
//! deserialiser cannot disagree. The check exists for its messages: it knows
//! the place of every key and value, and the spelling that was probably meant.

use std::ops::Range;

use serde_json::Value;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::Scene;
use crate::error::{Problem, nearest};
use crate::materials::needed;
use crate::renamed::{current_key, current_value};

/// JSON schema (draft 2020-12) of a scene file, for editors.
pub fn schema() -> Value {
    schemars::schema_for!(Scene).to_value()
}

/// All violations of the schema in `document`.
pub(crate) fn check(document: &Spanned<DeTable<'_>>) -> Vec<Problem> {
    let root = schema();
    let mut walk = Walk { root: &root, problems: Vec::new() };
    walk.table(&root, document.get_ref(), None, "");
    walk.problems
}

struct Walk<'s> {
    root: &'s Value,
    problems: Vec<Problem>,
}

/// An object schema: its properties, the required ones, and whether others may occur.
struct Shape<'s> {
    properties: Vec<(&'s str, &'s Value)>,
    required: Vec<&'s str>,
    /// Required where the table has no `material`.
    needed: Vec<&'s str>,
    open: Option<&'s Value>,
}

impl<'s> Walk<'s> {
    fn resolve(&self, mut schema: &'s Value) -> &'s Value {
        while let Some(path) = schema.get("$ref").and_then(Value::as_str) {
            if schema.get("properties").is_some() {
                break;
            }
            match self.root.pointer(path.trim_start_matches('#')) {
                Some(target) => schema = target,
                None => break,
            }
        }
        schema
    }

    /// The alternative of an optional (`anyOf [.., null]`) schema that is not null.
    fn unwrap_option(&self, schema: &'s Value) -> &'s Value {
        let schema = self.resolve(schema);
        match schema.get("anyOf").and_then(Value::as_array) {
            Some(any) => any
                .iter()
                .find(|s| s.get("type").and_then(Value::as_str) != Some("null"))
                .map_or(schema, |s| self.resolve(s)),
            None => schema,
        }
    }

    fn shape(&self, schema: &'s Value) -> Shape<'s> {
        let mut shape =
            Shape { properties: Vec::new(), required: Vec::new(), needed: Vec::new(), open: None };
        let mut parts = vec![schema];
        if let Some(path) = schema.get("$ref").and_then(Value::as_str)
            && let Some(target) = self.root.pointer(path.trim_start_matches('#'))
        {
            parts.push(target);
        }
        for part in parts {
            if let Some(map) = part.get("properties").and_then(Value::as_object) {
                shape.properties.extend(map.iter().map(|(k, v)| (k.as_str(), v)));
            }
            if let Some(list) = part.get("required").and_then(Value::as_array) {
                shape.required.extend(list.iter().filter_map(Value::as_str));
            }
            shape.needed.extend(needed(part));
            shape.open = shape.open.or(part.get("additionalProperties").filter(|a| a.is_object()));
        }
        shape
    }

    fn table(&mut self, schema: &'s Value, table: &DeTable<'_>, at: Option<Range<usize>>, path: &str) {
        let mut schema = self.unwrap_option(schema);
        if let Some(variants) = schema.get("oneOf").and_then(Value::as_array) {
            match self.variant(variants, table, at.clone(), path) {
                Some(variant) => schema = variant,
                None => return,
            }
        }
        let shape = self.shape(schema);
        let section = if path.is_empty() { "the scene".to_owned() } else { format!("[{path}]") };
        let mut meant = Vec::new();
        for (key, value) in table {
            let name: &str = key.get_ref();
            let inner = if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
            let current = current_key(path, name);
            match shape.properties.iter().find(|(k, _)| *k == current) {
                Some(_) if current != name && table.keys().any(|k| k.get_ref().as_ref() == current) => {
                    self.problems.push(Problem::new(
                        Some(key.span()),
                        format!(
                            "`{name}` in {section} is the former name of `{current}`, which is set as well"
                        ),
                        format!("remove `{name}`"),
                    ));
                }
                Some((_, sub)) => self.value(sub, value, &inner),
                None if shape.open.is_some() => {}
                None => {
                    let allowed: Vec<&str> = shape.properties.iter().map(|(k, _)| *k).collect();
                    let list = allowed.join(", ");
                    let help = match nearest(name, allowed) {
                        Some(near) => {
                            meant.push(near);
                            format!("did you mean `{near}`? allowed here: {list}")
                        }
                        None => format!("allowed here: {list}"),
                    };
                    self.problems.push(Problem::new(
                        Some(key.span()),
                        format!("unknown key `{name}` in {section}"),
                        help,
                    ));
                }
            }
        }
        let has_material = table.contains_key("material");
        let needed = shape.needed.iter().filter(|_| !has_material);
        for &name in shape.required.iter().chain(needed) {
            // A slip of the pen is one problem, not two.
            let is_set = table.keys().any(|k| current_key(path, k.get_ref()) == name);
            if !is_set && !meant.contains(&name) {
                let doc = shape.properties.iter().find(|(k, _)| *k == name).map(|(_, s)| describe(s));
                self.problems.push(Problem::new(
                    at.clone(),
                    format!("missing key `{name}` in {section}"),
                    format!("add `{name} = ...`: {}", doc.unwrap_or_default()),
                ));
            }
        }
    }

    /// The variant of a tagged enum that the table's `kind` names.
    fn variant(
        &mut self,
        variants: &'s [Value],
        table: &DeTable<'_>,
        at: Option<Range<usize>>,
        path: &str,
    ) -> Option<&'s Value> {
        let tag = |v: &'s Value| v.pointer("/properties/kind/const").and_then(Value::as_str);
        let names: Vec<&str> = variants.iter().filter_map(tag).collect();
        let Some((_, value)) = table.iter().find(|(k, _)| k.get_ref().as_ref() == "kind") else {
            self.problems.push(Problem::new(
                at,
                format!("missing key `kind` in [{path}]"),
                format!("add `kind = \"...\"`, one of: {}", names.join(", ")),
            ));
            return None;
        };
        let written = value.get_ref().as_str().unwrap_or("");
        let found = variants.iter().find(|v| tag(v) == Some(written));
        if found.is_none() {
            self.problems.push(self.not_one_of(value.span(), &format!("{path}.kind"), written, &names));
        }
        found
    }

    fn not_one_of(&self, at: Range<usize>, path: &str, written: &str, names: &[&str]) -> Problem {
        let list = names.join(", ");
        let help = match nearest(written, names.iter().copied()) {
            Some(near) => format!("did you mean \"{near}\"? one of: {list}"),
            None => format!("one of: {list}"),
        };
        Problem::new(Some(at), format!("`{path}` is \"{written}\", which does not exist"), help)
    }

    fn value(&mut self, schema: &'s Value, value: &Spanned<DeValue<'_>>, path: &str) {
        let schema = self.unwrap_option(schema);
        let inner = value.get_ref();
        if let Some(table) = inner.as_table() {
            if schema.get("properties").is_none()
                && schema.get("oneOf").is_none()
                && schema.get("$ref").is_none()
                && schema.get("type").and_then(Value::as_str) != Some("object")
            {
                self.wrong_type(schema, value, path);
                return;
            }
            return self.table(schema, table, Some(value.span()), path);
        }
        let names: Vec<&str> = match (schema.get("enum"), schema.get("oneOf")) {
            (Some(Value::Array(list)), _) => list.iter().filter_map(Value::as_str).collect(),
            (_, Some(Value::Array(list))) => list
                .iter()
                .flat_map(|v| {
                    let several = v.get("enum").and_then(Value::as_array).into_iter().flatten();
                    v.get("const").into_iter().chain(several).filter_map(Value::as_str)
                })
                .collect(),
            _ => Vec::new(),
        };
        if !names.is_empty() {
            match inner.as_str() {
                Some(written) if names.contains(&current_value(path, written).unwrap_or(written)) => {}
                Some(written) => {
                    let problem = self.not_one_of(value.span(), path, written, &names);
                    self.problems.push(problem);
                }
                None => self.problems.push(Problem::new(
                    Some(value.span()),
                    format!("`{path}` is {}, not a name in quotes", inner.type_str()),
                    format!("one of: {}", names.join(", ")),
                )),
            }
            return;
        }
        if let (Some(array), Some(items)) = (inner.as_array(), schema.get("items")) {
            for (i, item) in array.iter().enumerate() {
                self.value(items, item, &format!("{path}[{i}]"));
            }
            return;
        }
        if !type_names(schema).iter().any(|t| matches(t, inner)) {
            self.wrong_type(schema, value, path);
        }
    }

    fn wrong_type(&mut self, schema: &Value, value: &Spanned<DeValue<'_>>, path: &str) {
        let wanted = type_names(schema).into_iter().filter(|t| *t != "null").collect::<Vec<_>>().join(" or ");
        let wanted = if wanted.is_empty() { "table".to_owned() } else { wanted };
        self.problems.push(Problem::new(
            Some(value.span()),
            format!(
                "`{path}` is {} {}, not {} {wanted}",
                article(value.get_ref().type_str()),
                value.get_ref().type_str(),
                article(&wanted)
            ),
            describe(schema),
        ));
    }
}

fn article(word: &str) -> &'static str {
    if word.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" }
}

fn type_names(schema: &Value) -> Vec<&str> {
    match schema.get("type") {
        Some(Value::String(t)) => vec![t.as_str()],
        Some(Value::Array(list)) => list.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    }
}

fn matches(name: &str, value: &DeValue<'_>) -> bool {
    match name {
        "number" => value.is_float() || value.is_integer(),
        "integer" => value.is_integer(),
        "boolean" => value.is_bool(),
        "string" => value.is_str(),
        "array" => value.is_array(),
        "object" => value.is_table(),
        _ => false,
    }
}

fn describe(schema: &Value) -> String {
    schema.get("description").and_then(Value::as_str).unwrap_or("").replace('\n', " ")
}
