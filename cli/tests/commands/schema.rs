//! Validates values against a JSON schema, draft 2020-12, with the keywords that `docs/run.schema.json` uses: other
//! keywords fail.

use serde_json::Value;

/// Returns the violations, each with its place in the value.
pub fn errors(root: &Value, value: &Value) -> Vec<String> {
    check(root, root, value, "")
}

fn check(root: &Value, schema: &Value, value: &Value, place: &str) -> Vec<String> {
    let rules = match schema {
        Value::Bool(true) => return Vec::new(),
        Value::Object(rules) => rules,
        _ => return vec![format!("{place}: nothing is allowed here")],
    };
    let mut found = Vec::new();
    for (keyword, rule) in rules {
        let mut refuse = |fits: bool| {
            if !fits {
                found.push(format!("{place}: {value} does not fit {keyword} {rule}"));
            }
        };
        let schemas = || rule.as_array().expect("a list of schemas").iter();
        let fitting = || schemas().filter(|schema| check(root, schema, value, place).is_empty()).count();
        match keyword.as_str() {
            "$schema" | "$defs" | "title" | "description" | "format" => {}
            "$ref" => {
                let name = rule.as_str().and_then(|name| name.strip_prefix('#')).expect("a reference within the file");
                let named = root.pointer(name).unwrap_or_else(|| panic!("the schema has no {name}"));
                found.extend(check(root, named, value, place));
            }
            "type" => refuse(match rule {
                Value::Array(names) => names.iter().any(|name| is_of(value, name)),
                name => is_of(value, name),
            }),
            "const" => refuse(value == rule),
            "enum" => refuse(schemas().any(|allowed| allowed == value)),
            "minimum" => refuse(value.as_f64().is_none_or(|v| v >= rule.as_f64().unwrap())),
            "maximum" => refuse(value.as_f64().is_none_or(|v| v <= rule.as_f64().unwrap())),
            "pattern" => {
                let pattern = regex_lite::Regex::new(rule.as_str().expect("a pattern")).expect("a regular expression");
                refuse(value.as_str().is_none_or(|text| pattern.is_match(text)))
            }
            "minItems" => refuse(value.as_array().is_none_or(|v| v.len() as u64 >= rule.as_u64().unwrap())),
            "maxItems" => refuse(value.as_array().is_none_or(|v| v.len() as u64 <= rule.as_u64().unwrap())),
            "anyOf" => refuse(fitting() > 0),
            "oneOf" => refuse(fitting() == 1),
            "required" => {
                refuse(value.as_object().is_none_or(|v| schemas().all(|k| v.contains_key(k.as_str().unwrap()))))
            }
            "items" => {
                for (i, item) in value.as_array().into_iter().flatten().enumerate() {
                    found.extend(check(root, rule, item, &format!("{place}/{i}")));
                }
            }
            "properties" => {
                for (name, schema) in rule.as_object().expect("schemas by name") {
                    let of = value.get(name).map(|member| check(root, schema, member, &format!("{place}/{name}")));
                    found.extend(of.into_iter().flatten());
                }
            }
            "additionalProperties" => {
                let is_named = |name: &str| rules.get("properties").is_some_and(|named| named.get(name).is_some());
                for (name, member) in value.as_object().into_iter().flatten().filter(|(name, _)| !is_named(name)) {
                    found.extend(check(root, rule, member, &format!("{place}/{name}")));
                }
            }
            other => panic!("the schema has the keyword {other}, which is unknown here"),
        }
    }
    found
}

fn is_of(value: &Value, kind: &Value) -> bool {
    match kind.as_str().expect("a type's name") {
        "null" => value.is_null(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "string" => value.is_string(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("{other} is no type of JSON"),
    }
}
