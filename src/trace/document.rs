//! Parses the JSON document around a trace's events: a list or an object that holds the list, complete or truncated by
//! a crash.

use serde_json::Value;

pub struct RawTrace {
    pub events: Vec<Value>,
    pub other_data: Value,
    /// True if the end of the document is missing.
    pub is_cut: bool,
}

/// Parses a trace. If the document is cut off, its complete events are kept, as the trace format allows.
///
/// # Errors
/// A message that says what is wrong with the document.
pub fn raw_trace_from_bytes(bytes: &[u8]) -> Result<RawTrace, String> {
    let document = match serde_json::from_slice(bytes) {
        Ok(document) => document,
        Err(error) => {
            let events = if error.is_eof() { whole_events(bytes) } else { Vec::new() };
            if events.is_empty() {
                return Err(error.to_string());
            }
            return Ok(RawTrace { events, other_data: Value::Null, is_cut: true });
        }
    };
    let (events, other_data) = match document {
        Value::Array(events) => (events, Value::Null),
        Value::Object(mut object) => match object.remove("traceEvents") {
            Some(Value::Array(events)) => (events, object.remove("otherData").unwrap_or(Value::Null)),
            _ => return Err("it has no list \"traceEvents\"".to_owned()),
        },
        _ => return Err("it is neither a list of events nor an object that holds one".to_owned()),
    };
    Ok(RawTrace { events, other_data, is_cut: false })
}

fn whole_events(bytes: &[u8]) -> Vec<Value> {
    let mut events = Vec::new();
    let Some(mut rest) = after_list_begin(bytes) else { return events };
    loop {
        let separators = rest.iter().take_while(|b| b.is_ascii_whitespace() || **b == b',').count();
        rest = &rest[separators..];
        let mut values = serde_json::Deserializer::from_slice(rest).into_iter::<Value>();
        match values.next() {
            Some(Ok(event)) => events.push(event),
            _ => return events,
        }
        rest = &rest[values.byte_offset()..];
    }
}

/// Returns the text after the bracket that opens the list of events.
fn after_list_begin(bytes: &[u8]) -> Option<&[u8]> {
    const KEY: &[u8] = b"\"traceEvents\"";
    let bytes = bytes.trim_ascii_start();
    if bytes.first() == Some(&b'[') {
        return Some(&bytes[1..]);
    }
    let key = bytes.windows(KEY.len()).position(|window| window == KEY)?;
    let value = bytes[key + KEY.len()..].trim_ascii_start().strip_prefix(b":")?;
    value.trim_ascii_start().strip_prefix(b"[")
}
