//! A device's part of a frame as a list of operations that its worker executes in order.

use crate::exec::InjectedKind;

/// The properties of a task that determine the order of a worker's operations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Step {
    Dispatch,
    /// A dispatch that is split into several submissions.
    CutDispatch,
    /// A dispatch of late reprojection. Its pose is sampled when the device has completed all earlier work.
    LateDispatch {
        is_cut: bool,
    },
    /// A copy of rows, to be sent to device `to`.
    Download {
        transfer: u32,
        to: usize,
    },
    Upload {
        transfer: u32,
    },
    /// Marks the point at which the images are complete; needs no operation.
    Stitch,
}

/// Rows that have been copied for another device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Outgoing {
    pub ticket: u64,
    pub transfer: u32,
    pub to: usize,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Operation {
    Begin,
    /// Record a dispatch or a copy of rows, given the number of the task.
    Record(usize),
    RecordTimestamps,
    /// Ask for the late-latched pose.
    Ask,
    /// End the command encoder.
    Close,
    /// Submit the recorded commands, including copies of these rows.
    Submit(Vec<Outgoing>),
    Inject(InjectedKind),
    /// Write rows once they have arrived.
    Write {
        task: usize,
        transfer: u32,
    },
}

/// Operations that a worker runs for a frame.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Script {
    /// Operations of all tasks except the uploads for the stitch. Other workers may wait for their results.
    pub(super) own: Vec<Operation>,
    /// The uploads of the stitch: pairs of a task number and a transfer number.
    pub(super) stitch: Vec<(usize, u32)>,
}

impl Script {
    /// Makes the script of a device from its own tasks and its tasks of the stitch. Task numbers count through `own`
    /// and continue in `stitch`. If `injected` is given, the fault is injected halfway through `own`.
    ///
    /// Commands are submitted as late as possible: before a wait for rows, and at the end. Consecutive copies share a
    /// submission, right after the last of them is recorded. The worker waits for rows only when everything up to the
    /// next submission is recorded; the device then writes the rows at the start of that submission. The host thus
    /// records while the device is busy with earlier work. Late dispatches come last, so that all rows have arrived
    /// when the pose is sampled.
    pub fn new(ticket: u64, own: &[Step], stitch: &[Step], injected: Option<InjectedKind>) -> Self {
        let mut builder = Builder::default();
        builder.operations.push(Operation::Begin);
        let is_late = |(_, step): &(usize, &Step)| matches!(step, Step::LateDispatch { .. });
        let (late, first): (Vec<_>, Vec<_>) = own.iter().enumerate().partition(is_late);
        let begins_late = first.len();
        for (at, (i, step)) in first.into_iter().chain(late).enumerate() {
            if let Some(kind) = injected.filter(|_| at == own.len() / 2) {
                builder.submit();
                builder.write();
                builder.operations.push(Operation::Inject(kind));
            }
            if at == begins_late || !builder.copies.is_empty() && !matches!(step, Step::Download { .. }) {
                builder.submit();
            }
            builder.asks |= at == begins_late;
            match *step {
                Step::Dispatch => builder.record(Operation::Record(i)),
                Step::CutDispatch => {
                    builder.write();
                    builder.record(Operation::Record(i));
                }
                Step::LateDispatch { is_cut } => {
                    if is_cut {
                        builder.write();
                        builder.ask();
                    }
                    builder.record(Operation::Record(i));
                }
                Step::Download { transfer, to } => {
                    builder.record(Operation::Record(i));
                    builder.copies.push(Outgoing { ticket, transfer, to });
                }
                Step::Upload { transfer } => {
                    builder.submit();
                    builder.writes.push(Operation::Write { task: i, transfer });
                }
                Step::Stitch => {}
            }
        }
        if own.is_empty() {
            builder.operations.extend(injected.map(Operation::Inject));
        }
        if own.iter().any(|step| matches!(step, Step::Dispatch | Step::CutDispatch | Step::LateDispatch { .. })) {
            builder.record(Operation::RecordTimestamps);
        }
        builder.submit();
        builder.write();
        let upload = |(i, step): (usize, &Step)| match *step {
            Step::Upload { transfer } => Some((own.len() + i, transfer)),
            _ => None,
        };
        Self { own: builder.operations, stitch: stitch.iter().enumerate().filter_map(upload).collect() }
    }

    /// Returns true if no submission follows the frame's last uploads. An empty submission must then execute them.
    pub(super) fn ends_with_uploads(&self) -> bool {
        !self.stitch.is_empty() || !self.own.iter().any(|o| matches!(o, Operation::Submit(_)))
    }
}

#[derive(Default)]
struct Builder {
    operations: Vec<Operation>,
    /// True if recorded commands have not been submitted yet.
    has_recorded: bool,
    copies: Vec<Outgoing>,
    /// Writes of rows that the next submission executes first.
    writes: Vec<Operation>,
    /// True if recorded commands need a pose that has not been sampled yet.
    asks: bool,
}

impl Builder {
    fn record(&mut self, operation: Operation) {
        self.operations.push(operation);
        self.has_recorded = true;
    }

    fn write(&mut self) {
        self.operations.append(&mut self.writes);
    }

    fn ask(&mut self) {
        if std::mem::take(&mut self.asks) {
            self.operations.push(Operation::Ask);
        }
    }

    fn submit(&mut self) {
        if std::mem::take(&mut self.has_recorded) {
            self.operations.push(Operation::Close);
            self.write();
            self.ask();
            self.operations.push(Operation::Submit(std::mem::take(&mut self.copies)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Operation::{Ask, Begin, Close, Inject, Record, RecordTimestamps, Submit, Write};
    use super::*;

    const TICKET: u64 = 7;

    fn operations(own: &[Step], injected: Option<InjectedKind>) -> Vec<Operation> {
        Script::new(TICKET, own, &[], injected).own
    }

    fn rows(transfer: u32) -> Outgoing {
        Outgoing { ticket: TICKET, transfer, to: 1 }
    }

    #[test]
    fn copies_leave_together_and_uploads_wait_behind_a_submission() {
        let download = |transfer| Step::Download { transfer, to: 1 };
        let own = [Step::Dispatch, download(4), download(5), Step::Dispatch, Step::Upload { transfer: 6 }, download(8)];
        let first = [Begin, Record(0), Record(1), Record(2), Close, Submit(vec![rows(4), rows(5)])];
        let second = [Record(3), Close, Submit(vec![])];
        let last = [Record(5), RecordTimestamps, Close, Write { task: 4, transfer: 6 }, Submit(vec![rows(8)])];
        assert_eq!(operations(&own, None), [&first[..], &second, &last].concat());
    }

    /// Covers a split dispatch, whose first part is submitted while it is recorded.
    #[test]
    fn rows_are_written_before_a_dispatch_that_is_cut_is_recorded() {
        let own = [Step::Upload { transfer: 6 }, Step::Dispatch, Step::CutDispatch];
        let expected = [Begin, Record(1), Write { task: 0, transfer: 6 }, Record(2), RecordTimestamps, Close];
        assert_eq!(operations(&own, None), [&expected[..], &[Submit(vec![])]].concat());
    }

    /// Covers rows that late dispatches read, which must arrive before the pose is sampled.
    #[test]
    fn a_pose_is_asked_for_once_when_all_else_is_submitted() {
        let late = |is_cut| Step::LateDispatch { is_cut };
        let upload = |transfer| Step::Upload { transfer };
        let write = |task, transfer| Write { task, transfer };
        let first = [Begin, Record(0), Close, Submit(vec![])];
        let both = [Step::Dispatch, upload(6), late(false), late(false)];
        let held = [&first[..], &[Record(2), Record(3), RecordTimestamps, Close, write(1, 6), Ask, Submit(vec![])]];
        assert_eq!(operations(&both, None), held.concat());
        let apart = [Step::Dispatch, late(false), upload(6), late(false)];
        let held = [Record(1), Record(3), RecordTimestamps, Close, write(2, 6), Ask, Submit(vec![])];
        assert_eq!(operations(&apart, None), [&first[..], &held].concat());
        let cut = [Step::Dispatch, upload(6), late(true), late(true)];
        let shown = [write(1, 6), Ask, Record(2), Record(3), RecordTimestamps, Close, Submit(vec![])];
        assert_eq!(operations(&cut, None), [&first[..], &shown].concat());
    }

    #[test]
    fn a_fault_is_injected_half_way_behind_a_submission() {
        let kind = InjectedKind::Loss;
        let first = [Begin, Record(0), Close, Submit(vec![]), Inject(kind)];
        let second = [Record(1), RecordTimestamps, Close, Submit(vec![])];
        assert_eq!(operations(&[Step::Dispatch; 2], Some(kind)), [&first[..], &second].concat());
        assert_eq!(operations(&[], Some(kind)), [Begin, Inject(kind)]);
    }

    #[test]
    fn tasks_of_the_stitch_are_numbered_after_the_own_ones() {
        let script = Script::new(TICKET, &[Step::Dispatch], &[Step::Upload { transfer: 3 }, Step::Stitch], None);
        assert_eq!(script.stitch, [(1, 3)]);
        assert!(script.ends_with_uploads());
        assert!(!Script::new(TICKET, &[Step::Dispatch], &[Step::Stitch], None).ends_with_uploads());
    }
}
