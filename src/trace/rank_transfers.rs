//! Analyses the transfers of rows between ranks, step by step, and finds the steps that stalled workers. The data are
//! spans of the workers and of each rank's MPI thread.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::intervals::Interval;
use super::median::median;

/// Span of a thread of a rank.
pub struct HostSpan {
    pub name: String,
    pub begin_us: f64,
    pub end_us: f64,
    pub args: Value,
}

/// Transfer of rows from a worker of one rank to a worker of another. Times are microseconds.
#[derive(Clone, Debug, PartialEq)]
pub struct RankTransfer {
    pub frame: Option<u64>,
    pub bytes: u64,
    /// Times of the steps: the worker queued the rows, its rank's MPI thread took them, MPI accepted them, the other
    /// rank's MPI thread found them, and that thread passed them on.
    pub at_us: [f64; 5],
    /// Time between the receiving MPI thread's previous poll and the poll that found the rows.
    pub rested_us: f64,
    /// Begin and end of the receiving worker's wait for these rows; `None` if it is not recorded.
    pub waited_us: Option<Interval>,
}

/// Statistics of one step over all transfers between ranks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TransferStep {
    pub what: String,
    pub median_us: f64,
    pub most_us: f64,
    /// Time that workers waited for late rows during this step.
    pub waited_ms: f64,
    /// True if an MPI thread causes this step: it holds the rows, or it has not polled for them yet.
    pub is_of_thread: bool,
}

/// Summary of the transfers of rows between ranks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RankTransferSummary {
    pub count: usize,
    pub bytes: u64,
    /// Time that workers waited for the rows.
    pub waited_ms: f64,
    /// Steps in order. They are consecutive, except that the receiving thread's time without a poll is also part of the
    /// step before it.
    pub parts: Vec<TransferStep>,
}

/// Numbers that identify a transfer, and that all of its spans carry as arguments: the ticket of one attempt
/// at a frame, and the number of the transfer in that frame.
type Key = (u64, u64);

/// Names of the spans, as recorded by `exec`.
const HANDED: &str = "send rows";
const SENT: &str = "send to rank";
const FOUND: &str = "receive from rank";
const WAITED: &str = "wait for rows of others";

fn whole(span: &HostSpan, name: &str) -> Option<u64> {
    span.args[name].as_f64().filter(|number| *number >= 0.0).map(|number| number as u64)
}

/// Returns the transfers for which both ends were recorded. A run may have several renderers that each count tickets
/// from 0, so spans of one ticket and transfer are matched by the nearest time.
pub fn rank_transfers(mut spans: Vec<HostSpan>) -> Vec<RankTransfer> {
    spans.retain(|span| [HANDED, SENT, FOUND, WAITED].contains(&&*span.name));
    spans.sort_by(|a, b| a.begin_us.total_cmp(&b.begin_us));
    let mut by_key: HashMap<Key, Vec<&HostSpan>> = HashMap::new();
    for span in &spans {
        if let Some(key) = whole(span, "ticket").zip(whole(span, "transfer")) {
            by_key.entry(key).or_default().push(span);
        }
    }
    let mut transfers: Vec<RankTransfer> = by_key.values().flat_map(|spans| rank_transfers_of(spans)).collect();
    transfers.sort_by(|a, b| a.at_us[0].total_cmp(&b.at_us[0]));
    transfers
}

/// Returns the transfers among the spans of one ticket and transfer. `spans` are in order of begin.
fn rank_transfers_of<'a>(spans: &'a [&HostSpan]) -> impl Iterator<Item = RankTransfer> + 'a {
    let of = |name: &'static str| spans.iter().copied().filter(move |span| span.name == name);
    let nearest = move |name, at_us: f64, end: fn(&HostSpan) -> f64| {
        of(name).min_by(|a, b| (end(a) - at_us).abs().total_cmp(&(end(b) - at_us).abs()))
    };
    of(SENT).filter_map(move |sent| {
        let handed = nearest(HANDED, sent.begin_us, |span| span.end_us)?;
        let found = nearest(FOUND, sent.end_us, |span| span.begin_us)?;
        let waited = nearest(WAITED, found.end_us, |span| span.end_us);
        Some(RankTransfer {
            frame: whole(handed, "frame"),
            bytes: whole(sent, "bytes").unwrap_or(0),
            at_us: [handed.end_us, sent.begin_us, sent.end_us, found.begin_us, found.end_us],
            rested_us: found.args["rested_us"].as_f64().unwrap_or(0.0),
            waited_us: waited.map(|span| (span.begin_us, span.end_us)),
        })
    })
}

impl RankTransfer {
    /// Splits the transfer into its steps, each with its name, [`TransferStep::is_of_thread`] and its interval. Steps
    /// are consecutive, except that the receiving thread's time without a poll is also part of the step before it. If
    /// the worker starts to wait only after the rows were passed on, the last step begins with that wait. A step may
    /// have a negative length if clocks are not aligned well enough.
    fn parts(&self) -> [(&'static str, bool, Interval); 6] {
        let [handed, taken, sent, found, passed] = self.at_us;
        let (waits, goes_on) = self.waited_us.map_or((passed, passed), |(begin, end)| (begin.max(passed), end));
        [
            ("until the MPI thread takes them", true, (handed, taken)),
            ("until MPI has them", true, (taken, sent)),
            ("until the other MPI thread finds them", false, (sent, found)),
            ("of which that thread did not poll", true, ((found - self.rested_us).max(sent), found)),
            ("until they are passed on", true, (found, passed)),
            ("until the worker goes on", false, (waits, goes_on.max(waits))),
        ]
    }
}

impl RankTransferSummary {
    /// Summarises the transfers of the frames for which `shown` returns true, and transfers without a frame number.
    /// Returns `None` if there are no such transfers.
    pub fn of(transfers: &[RankTransfer], shown: impl Fn(u64) -> bool) -> Option<Self> {
        let transfers: Vec<&RankTransfer> = transfers.iter().filter(|p| p.frame.is_none_or(&shown)).collect();
        let first = transfers.first()?;
        let waited_us = |passage: &RankTransfer, (begin, end): Interval| {
            passage.waited_us.map_or(0.0, |(from, to)| (end.min(to) - begin.max(from)).max(0.0))
        };
        let part = |(number, (what, is_of_thread, _)): (usize, (&'static str, bool, Interval))| {
            let all: Vec<(&RankTransfer, Interval)> = transfers.iter().map(|p| (*p, p.parts()[number].2)).collect();
            let lengths_us: Vec<f64> = all.iter().map(|(_, (begin, end))| end - begin).collect();
            TransferStep {
                what: what.to_owned(),
                most_us: lengths_us.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                median_us: median(lengths_us).unwrap_or(0.0),
                waited_ms: all.into_iter().map(|(p, part)| waited_us(p, part)).sum::<f64>() / 1e3,
                is_of_thread,
            }
        };
        Some(Self {
            count: transfers.len(),
            bytes: transfers.iter().map(|p| p.bytes).sum(),
            waited_ms: transfers.iter().filter_map(|p| p.waited_us).map(|(begin, end)| end - begin).sum::<f64>() / 1e3,
            parts: first.parts().into_iter().enumerate().map(part).collect(),
        })
    }

    /// Returns an upper bound on the time that workers waited because of MPI threads.
    pub fn thread_ms(&self) -> f64 {
        self.parts.iter().filter(|part| part.is_of_thread).map(|part| part.waited_ms).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn span(name: &str, begin_us: f64, end_us: f64, ticket: u64, more: Value) -> HostSpan {
        let mut args = json!({ "ticket": ticket, "transfer": 7 });
        args.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        HostSpan { name: name.to_owned(), begin_us, end_us, args }
    }

    /// Spans of rows that a worker waits for, and of two renderers that share a ticket number.
    fn spans() -> Vec<HostSpan> {
        let other = |at_us: f64| {
            let at = move |name, begin, end, more| span(name, at_us + begin, at_us + end, 2, more);
            [
                at(HANDED, 0.0, 1.0, json!({ "frame": 5 })),
                at(SENT, 1.0, 2.0, json!({ "bytes": 10 })),
                at(FOUND, 4.0, 5.0, json!({})),
            ]
        };
        let mut all = vec![
            span(WAITED, 90.0, 180.0, 1, json!({ "frame": 4 })),
            span(FOUND, 160.0, 170.0, 1, json!({ "rested_us": 15.5 })),
            span(SENT, 110.0, 130.0, 1, json!({ "bytes": 300 })),
            span(HANDED, 60.0, 100.0, 1, json!({ "frame": 4 })),
            span(HANDED, 200.0, 300.0, 3, json!({ "frame": 4 })),
            HostSpan { name: "idle".to_owned(), begin_us: 0.0, end_us: 1.0, args: Value::Null },
        ];
        all.extend(other(1000.0).into_iter().chain(other(5000.0)));
        all
    }

    #[test]
    fn rank_transfers_are_followed_across_ranks() {
        let found = rank_transfers(spans());
        let first = RankTransfer {
            frame: Some(4),
            bytes: 300,
            at_us: [100.0, 110.0, 130.0, 160.0, 170.0],
            rested_us: 15.5,
            waited_us: Some((90.0, 180.0)),
        };
        assert_eq!((found.len(), &found[0]), (3, &first));
        assert_eq!(found[2].at_us, [5001.0, 5001.0, 5002.0, 5004.0, 5005.0]);
        let summary = RankTransferSummary::of(&found, |frame| frame == 4).unwrap();
        let waited_us: Vec<f64> = summary.parts.iter().map(|part| (part.waited_ms * 1e3).round()).collect();
        assert_eq!(waited_us, [10.0, 20.0, 30.0, 16.0, 10.0, 10.0]);
        assert_eq!((summary.count, summary.bytes, summary.waited_ms), (1, 300, 0.09));
        assert!((summary.thread_ms() - 0.0555).abs() < 1e-9, "{}", summary.thread_ms());
        assert_eq!(RankTransferSummary::of(&found, |frame| frame == 6), None);
    }
}
