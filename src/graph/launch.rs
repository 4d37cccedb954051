//! Kernel runs that make up a pass.

/// Runs of a kernel over the rows of a pass, with the kernel's three arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Launch {
    Once([u32; 3]),
    /// One run per batch of at most `most` samples per pixel. The arguments are the index of the first sample, the
    /// index after the last sample, and `third`.
    Samples {
        most: u32,
        third: u32,
        /// True if the kernel does not run in frames whose only sample is at the pixel's centre.
        only_jittered: bool,
    },
}

/// One run of a kernel in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    pub args: [u32; 3],
    /// Samples per pixel that this run takes; 1 for [`Launch::Once`].
    pub samples: u32,
}

/// Returns the runs in a frame with `spp` samples per pixel. `jitter` is false if the only sample is at the pixel's
/// centre.
pub fn runs(launches: &[Launch], spp: u32, jitter: bool) -> impl Iterator<Item = Run> {
    launches.iter().flat_map(move |launch| {
        let (samples, most, one) = match *launch {
            Launch::Once(args) => (0, 1, Some(Run { args, samples: 1 })),
            Launch::Samples { only_jittered, .. } if only_jittered && !jitter => (0, 1, None),
            Launch::Samples { most, .. } => (spp, most, None),
        };
        let batch = move |i: u32| {
            let (begin, end) = (i * most, (i * most + most).min(spp));
            let third = if let Launch::Samples { third, .. } = *launch { third } else { 0 };
            Run { args: [begin, end, third], samples: end - begin }
        };
        one.into_iter().chain((0..samples.div_ceil(most)).map(batch))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_taken_in_batches() {
        let means = Launch::Samples { most: 4, third: 7, only_jittered: true };
        let all = |spp, jitter| runs(&[Launch::Once([1, 2, 3]), means], spp, jitter).collect::<Vec<_>>();
        let run = |args, samples| Run { args, samples };
        assert_eq!(all(1, false), [run([1, 2, 3], 1)]);
        assert_eq!(all(6, true), [run([1, 2, 3], 1), run([0, 4, 7], 4), run([4, 6, 7], 2)]);
    }
}
