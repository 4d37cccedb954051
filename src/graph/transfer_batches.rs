//! Scheduling of transfer batches: when rows leave their device, and when they arrive on the device that reads them.
//! Departures and arrivals both force a submission split: rows leave at the end of a submission, and arrive at the
//! start of one. Small batches therefore share splits. Large batches leave as soon as they are ready, so that their
//! transfer overlaps with work on the devices.

/// Size in bytes below which a transfer batch is small: its transfer takes less time than an additional submission.
const FEW_BYTES: u64 = 64 << 10;

/// A transfer batch: the rows that one task waits for from one device.
#[derive(Clone, Copy, Debug)]
pub struct TransferBatch {
    /// The pass that writes the last of the rows.
    pub ready: u32,
    /// The pass that reads the rows.
    pub due: u32,
    pub bytes: u64,
}

/// Schedule of a transfer batch: the passes between which its rows are transferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BatchSchedule {
    /// Pass after which the batch leaves: `ready` or later, and before `due`.
    pub leaves_behind: u32,
    /// Pass before which the batch arrives: after `leaves_behind`, and at most `due`.
    pub arrives_before: u32,
}

/// Schedules each transfer batch. `end` is one past the last pass.
pub fn schedule_batches(batches: &[TransferBatch], end: u32) -> Vec<BatchSchedule> {
    let is_large = |batch: &&TransferBatch| batch.bytes >= FEW_BYTES;
    // Passes before which all devices split submissions, in order. They also split at `end`, before the stitch.
    let mut stops = vec![end];
    let stop_at = |stops: &mut Vec<u32>, pass| {
        if let Err(place) = stops.binary_search(&pass) {
            stops.insert(place, pass);
        }
    };
    for batch in batches.iter().filter(is_large) {
        stop_at(&mut stops, batch.ready + 1);
        stop_at(&mut stops, batch.due);
    }
    // Small batches share stops. In order of `due`, a batch gets a stop of its own, at `due`, only if there is no stop
    // after `ready` and up to `due` yet.
    let mut small: Vec<&TransferBatch> = batches.iter().filter(|batch| !is_large(batch)).collect();
    small.sort_by_key(|batch| batch.due);
    for batch in small {
        let next = stops.partition_point(|&stop| stop <= batch.ready);
        if stops.get(next).is_none_or(|&stop| stop > batch.due) {
            stop_at(&mut stops, batch.due);
        }
    }
    let trip = |batch: &TransferBatch| {
        let stops = &stops[stops.partition_point(|&stop| stop <= batch.ready)..];
        let first = stops.first().copied().unwrap_or(end);
        let last = stops[..stops.partition_point(|&stop| stop <= batch.due)].last().copied().unwrap_or(first);
        BatchSchedule { leaves_behind: first - 1, arrives_before: last }
    };
    batches.iter().map(trip).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const END: u32 = 20;

    fn trips_of(batches: &[(u32, u32, u64)]) -> Vec<(u32, u32)> {
        let batches: Vec<TransferBatch> =
            batches.iter().map(|&(ready, due, bytes)| TransferBatch { ready, due, bytes }).collect();
        schedule_batches(&batches, END).iter().map(|trip| (trip.leaves_behind, trip.arrives_before)).collect()
    }

    #[test]
    fn few_rows_travel_together_and_late() {
        assert_eq!(trips_of(&[(0, 5, 1)]), [(4, 5)]);
        // The second batch is ready only when the first is due. The third leaves with the first and arrives with the
        // second.
        assert_eq!(trips_of(&[(0, 5, 1), (5, 8, 1), (1, 12, 1)]), [(4, 5), (7, 8), (4, 8)]);
        assert_eq!(trips_of(&[(3, END, 1), (15, END, 1)]), [(END - 1, END); 2]);
    }

    #[test]
    fn large_batches_leave_at_once_with_small_ones() {
        assert_eq!(trips_of(&[(0, 5, FEW_BYTES), (0, 5, 1)]), [(0, 5); 2]);
        assert_eq!(trips_of(&[(2, 9, FEW_BYTES), (0, 5, 1), (4, 12, 1)]), [(2, 9), (2, 3), (8, 9)]);
    }

    #[test]
    fn batches_travel_between_ready_and_due() {
        let mut random = 1u32;
        let mut below = |most: u32| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 8) % most
        };
        for count in 0..200 {
            let batch = |_| {
                let ready = below(END - 1);
                let due = (ready + 1 + below(END)).min(END);
                TransferBatch { ready, due, bytes: u64::from(below(2)) * FEW_BYTES }
            };
            let batches: Vec<TransferBatch> = (0..count % 20).map(batch).collect();
            for (TransferBatch { ready, due, bytes }, trip) in batches.iter().zip(schedule_batches(&batches, END)) {
                let BatchSchedule { leaves_behind, arrives_before } = trip;
                assert!(
                    *ready <= leaves_behind && leaves_behind < arrives_before && arrives_before <= *due,
                    "{trip:?}"
                );
                assert!(*bytes < FEW_BYTES || (leaves_behind, arrives_before) == (*ready, *due), "{trip:?}");
            }
        }
    }
}
