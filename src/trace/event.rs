//! Chrome trace events as plain data, which is serialized to the JSON that trace viewers read. Times are microseconds.

use std::collections::BTreeMap;

use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};

/// Process and thread under which an event is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Track {
    pub pid: u32,
    pub tid: u32,
}

/// Value of an event's argument. JSON has neither NaN nor infinity, so these become text: `NaN`, `inf` or `-inf`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Arg {
    Number(f64),
    Text(String),
}

impl From<f64> for Arg {
    fn from(value: f64) -> Self {
        if value.is_finite() { Arg::Number(value) } else { Arg::Text(value.to_string()) }
    }
}

impl From<&str> for Arg {
    fn from(value: &str) -> Self {
        Arg::Text(value.to_owned())
    }
}

pub type Args = BTreeMap<String, Arg>;

pub fn args_from(values: &[(&str, f64)]) -> Args {
    let named = values.iter();
    named.map(|&(name, value)| (name.to_owned(), value.into())).collect()
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlowStep {
    Start,
    Step,
    Finish,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// `X`: a span with its duration.
    Complete { duration_us: f64 },
    /// `i`: an instant, shown on its thread.
    Instant,
    /// `C`: values of a counter; each numeric argument belongs to one series.
    Counter,
    /// `M`: name or sort index of a process or thread; has no time.
    Metadata,
    /// `s`, `t`, `f`: the arrow `id` leaves, passes or reaches the span around this time.
    Flow { step: FlowStep, id: u64 },
}

#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    pub kind: Kind,
    pub name: String,
    pub category: &'static str,
    pub track: Track,
    pub time_us: f64,
    pub args: Args,
}

impl Event {
    /// Returns the name of a process and its position among the others, which are sorted by number.
    pub fn process(pid: u32, name: &str) -> [Event; 2] {
        let track = Track { pid, tid: 0 };
        let index = f64::from(pid).into();
        [
            metadata(track, "process_name", "name", name.into()),
            metadata(track, "process_sort_index", "sort_index", index),
        ]
    }

    pub fn thread_name(track: Track, name: &str) -> Event {
        metadata(track, "thread_name", "name", name.into())
    }

    /// Returns the name of a thread and its position among the others, which are sorted by number.
    pub fn thread(track: Track, name: &str) -> [Event; 2] {
        let index = f64::from(track.tid).into();
        [Self::thread_name(track, name), metadata(track, "thread_sort_index", "sort_index", index)]
    }

    fn phase(&self) -> &'static str {
        match self.kind {
            Kind::Complete { .. } => "X",
            Kind::Instant => "i",
            Kind::Counter => "C",
            Kind::Metadata => "M",
            Kind::Flow { step, .. } => match step {
                FlowStep::Start => "s",
                FlowStep::Step => "t",
                FlowStep::Finish => "f",
            },
        }
    }
}

fn metadata(track: Track, name: &str, key: &str, value: Arg) -> Event {
    Event {
        kind: Kind::Metadata,
        name: name.to_owned(),
        category: "",
        track,
        time_us: 0.0,
        args: Args::from([(key.to_owned(), value)]),
    }
}

impl Serialize for Event {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("ph", self.phase())?;
        map.serialize_entry("name", &self.name)?;
        if !self.category.is_empty() {
            map.serialize_entry("cat", self.category)?;
        }
        map.serialize_entry("pid", &self.track.pid)?;
        map.serialize_entry("tid", &self.track.tid)?;
        if self.kind != Kind::Metadata {
            map.serialize_entry("ts", &self.time_us)?;
        }
        match self.kind {
            Kind::Complete { duration_us } => map.serialize_entry("dur", &duration_us)?,
            Kind::Instant => map.serialize_entry("s", "t")?,
            Kind::Flow { step, id } => {
                map.serialize_entry("id", &id)?;
                if step == FlowStep::Finish {
                    // Bind to the enclosing span, not to the next one.
                    map.serialize_entry("bp", "e")?;
                }
            }
            Kind::Counter | Kind::Metadata => {}
        }
        if !self.args.is_empty() {
            map.serialize_entry("args", &self.args)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn event(kind: Kind, args: &[(&str, f64)]) -> Event {
        Event {
            kind,
            name: "gbuffer".into(),
            category: "gpu",
            track: Track { pid: 10, tid: 1 },
            time_us: 2.5,
            args: args_from(args),
        }
    }

    #[test]
    fn each_kind_has_the_fields_viewers_need() {
        let json_of = |event: &Event| serde_json::to_value(event).unwrap();
        let base = |ph: &str| json!({"ph": ph, "name": "gbuffer", "cat": "gpu", "pid": 10, "tid": 1, "ts": 2.5});
        let with = |ph: &str, extra: serde_json::Value| {
            let mut value = base(ph);
            let object = value.as_object_mut().unwrap();
            object.extend(extra.as_object().unwrap().clone());
            value
        };
        let complete = event(Kind::Complete { duration_us: 4.0 }, &[("frame", 3.0)]);
        assert_eq!(json_of(&complete), with("X", json!({"dur": 4.0, "args": {"frame": 3.0}})));
        assert_eq!(json_of(&event(Kind::Instant, &[])), with("i", json!({"s": "t"})));
        assert_eq!(json_of(&event(Kind::Counter, &[("ms", 1.5)])), with("C", json!({"args": {"ms": 1.5}})));
        let flow = |step| json_of(&event(Kind::Flow { step, id: 7 }, &[]));
        assert_eq!(flow(FlowStep::Start), with("s", json!({"id": 7})));
        assert_eq!(flow(FlowStep::Step), with("t", json!({"id": 7})));
        assert_eq!(flow(FlowStep::Finish), with("f", json!({"id": 7, "bp": "e"})));
        let named = json!({"ph": "M", "name": "process_name", "pid": 10, "tid": 0, "args": {"name": "gpu 0"}});
        assert_eq!(json_of(&Event::process(10, "gpu 0")[0]), named);
    }

    #[test]
    fn non_finite_arguments_stay_readable() {
        let args = args_from(&[("a", f64::NAN), ("b", f64::INFINITY)]);
        assert_eq!(serde_json::to_value(args).unwrap(), json!({"a": "NaN", "b": "inf"}));
    }
}
