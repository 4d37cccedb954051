//! Fields and arguments of trace events, with checks of their form.

use serde_json::{Map, Value};

/// Process and thread of an event. Both are kept as text, because other tools write numbers or text.
pub type TrackKey = (String, String);

pub fn check_finite(args: &Value) -> Result<(), String> {
    for (name, value) in args.as_object().into_iter().flatten() {
        if !is_finite(value) {
            return Err(format!("its argument '{name}' is {value}, not a finite number"));
        }
    }
    Ok(())
}

/// Returns the argument `name` as a whole number, if it exists and is a number.
pub fn whole(args: &Value, name: &str) -> Result<Option<u64>, String> {
    match args[name].as_f64() {
        None => Ok(None),
        Some(number) if number >= 0.0 && number.fract() == 0.0 => Ok(Some(number as u64)),
        Some(number) => Err(format!("its argument '{name}' is {number}, not a whole number of at least 0")),
    }
}

/// Returns false for null and for text such as "NaN", which JSON writers put in place of numbers that are not finite.
fn is_finite(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::String(text) => text.parse().map_or(true, f64::is_finite),
        _ => true,
    }
}

pub fn check_counter(args: &Value) -> Result<(), String> {
    let Some(series) = args.as_object().filter(|series| !series.is_empty()) else {
        return Err("a counter needs \"args\" with at least one number".to_owned());
    };
    match series.iter().find(|(_, value)| !value.is_number()) {
        None => Ok(()),
        Some((name, value)) => Err(format!("its value '{name}' is {value}, not a finite number")),
    }
}

/// An event's fields except `args`.
pub struct Fields<'a>(pub &'a Map<String, Value>);

impl Fields<'_> {
    pub fn text(&self, key: &str) -> Result<&str, String> {
        let value = self.0.get(key).and_then(Value::as_str);
        value.ok_or_else(|| format!("it needs a text \"{key}\""))
    }

    pub fn number(&self, key: &str) -> Result<f64, String> {
        let value = self.0.get(key).and_then(Value::as_f64);
        value.filter(|v| v.is_finite()).ok_or_else(|| format!("it needs a number \"{key}\""))
    }

    pub fn id(&self, key: &str) -> Result<String, String> {
        match self.0.get(key) {
            Some(Value::Number(number)) => Ok(number.to_string()),
            Some(Value::String(text)) => Ok(text.clone()),
            _ => Err(format!("it needs \"{key}\"")),
        }
    }

    /// Returns the text of `id2`, an object that holds either a `local` (per process) or a `global` id.
    pub fn id2(&self) -> Result<String, String> {
        let id2 = self.0.get("id2").filter(|id2| id2.is_object());
        id2.map(Value::to_string).ok_or_else(|| "it needs \"id\"".to_owned())
    }

    pub fn track(&self) -> Result<TrackKey, String> {
        Ok((self.id("pid")?, self.id("tid")?))
    }

    /// Checks an instant. With global or process scope it belongs to no thread.
    pub fn instant(&self) -> Result<(), String> {
        self.number("ts")?;
        match self.0.get("s").and_then(Value::as_str) {
            Some("g") => Ok(()),
            Some("p") => self.id("pid").map(drop),
            _ => self.track().map(drop),
        }
    }
}
