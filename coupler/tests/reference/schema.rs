//! The keys of a scene as its JSON schema has them.

use std::collections::BTreeMap;

use serde_json::Value;

/// A key.
#[derive(Clone)]
pub struct Key {
    pub name: String,
    pub schema: Value,
    pub required: bool,
    /// Required where the table has no `material`.
    pub needed: bool,
}

/// A table of the scene with its keys.
pub struct Section {
    /// Dotted path without indices; `canopy(atps)` for one kind of a table that has several. Empty: the top level.
    pub path: String,
    /// Whether the scene has a list of such tables.
    pub is_list: bool,
    /// Descriptions of its key and its type.
    pub text: Vec<String>,
    pub keys: Vec<Key>,
}

/// A schema, with what its references stand for.
pub struct Schema(Value);

impl Schema {
    pub fn of_code() -> Self {
        Self(case::schema())
    }

    pub fn committed() -> Self {
        let path = super::markdown::root().join("cases/scene.schema.json");
        Self(serde_json::from_str(&std::fs::read_to_string(path).expect("the schema")).expect("JSON"))
    }

    fn resolve<'a>(&'a self, mut schema: &'a Value) -> &'a Value {
        while let Some(path) = schema["$ref"].as_str() {
            schema = self.0.pointer(path.trim_start_matches('#')).expect("a definition");
        }
        schema
    }

    /// The schema behind references and `null`.
    pub fn inner<'a>(&'a self, schema: &'a Value) -> &'a Value {
        let schema = if schema.get("properties").is_none() { self.resolve(schema) } else { schema };
        let any = schema["anyOf"].as_array().into_iter().flatten();
        any.into_iter().find(|s| s["type"] != "null").map_or(schema, |s| self.resolve(s))
    }

    /// Kinds of a table that has several, with the keys of each.
    fn kinds<'a>(&'a self, schema: &'a Value) -> Vec<&'a Value> {
        let all = schema["oneOf"].as_array().into_iter().flatten();
        all.filter(|s| s.get("properties").is_some()).collect()
    }

    pub fn is_table(&self, schema: &Value) -> bool {
        let inner = self.inner(schema);
        inner["type"] == "object" || !self.kinds(inner).is_empty()
    }

    /// The tables in `items` of a list, if it is a list of tables.
    pub fn listed<'a>(&'a self, schema: &'a Value) -> Option<&'a Value> {
        let items = self.inner(schema).get("items")?;
        self.is_table(items).then(|| self.inner(items))
    }

    fn keys(&self, schemas: &[&Value]) -> Vec<Key> {
        let mut keys = BTreeMap::new();
        for schema in schemas {
            let required: Vec<&str> =
                schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
            let needed = schema.pointer("/then/required").and_then(Value::as_array).into_iter().flatten();
            let needed: Vec<&str> = needed.filter_map(Value::as_str).collect();
            for (name, schema) in schema["properties"].as_object().into_iter().flatten() {
                let [required, needed] = [&required, &needed].map(|all| all.contains(&name.as_str()));
                let key = Key { name: name.clone(), schema: schema.clone(), required, needed };
                keys.insert(name.clone(), key);
            }
        }
        keys.into_values().collect()
    }

    /// All tables, each before those in it.
    pub fn sections(&self) -> Vec<Section> {
        let mut sections = Vec::new();
        self.collect(&self.0, String::new(), false, Vec::new(), &mut sections);
        sections
    }

    fn collect(
        &self,
        schema: &Value,
        path: String,
        is_list: bool,
        text: Vec<String>,
        out: &mut Vec<Section>,
    ) {
        let kinds = self.kinds(schema);
        if kinds.is_empty() {
            let keys = self.keys(&[schema]);
            out.push(Section { path: path.clone(), is_list, text, keys: keys.clone() });
            return self.inside(&keys, &path, out);
        }
        out.push(Section { path: path.clone(), is_list, text, keys: Vec::new() });
        for kind in kinds {
            // The keys of a kind lie beside a reference to those of its type.
            let of_type = kind.get("$ref").map(|_| self.resolve(kind));
            let keys = self.keys(&[&[kind][..], of_type.as_slice()].concat());
            let name = kind.pointer("/properties/kind/const").and_then(Value::as_str).expect("a kind");
            let path = format!("{path}({name})");
            let text = vec![described(kind)];
            out.push(Section { path: path.clone(), is_list, text, keys: keys.clone() });
            self.inside(&keys, &path, out);
        }
    }

    fn inside(&self, keys: &[Key], path: &str, out: &mut Vec<Section>) {
        for key in keys {
            let list = self.listed(&key.schema);
            if list.is_none() && !self.is_table(&key.schema) {
                continue;
            }
            let inner = list.unwrap_or_else(|| self.inner(&key.schema));
            let mut text = vec![described(&key.schema), described(inner)];
            // The text of the type says the same and more.
            if text[1].starts_with(text[0].trim_end_matches('.')) {
                text.remove(0);
            }
            self.collect(inner, join(path, &key.name), list.is_some(), text, out);
        }
    }
}

/// The description of a schema; empty where it has none.
pub fn described(schema: &Value) -> String {
    schema["description"].as_str().unwrap_or_default().to_owned()
}

/// Dotted path of a key.
pub fn join(section: &str, key: &str) -> String {
    if section.is_empty() { key.to_owned() } else { format!("{section}.{key}") }
}
