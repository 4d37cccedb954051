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

/// Samples per pixel of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleCounts {
    pub least: u32,
    /// `least`, or one more in frames whose tiles differ.
    pub most: u32,
    /// True if the only sample of a pixel is at the pixel's centre. Several samples are always jittered.
    pub centres_one: bool,
}

impl SampleCounts {
    /// Returns true if some pixels take their only sample at the centre.
    fn has_centres(self) -> bool {
        self.centres_one && self.least == 1
    }
}

/// One run of a kernel in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    pub args: [u32; 3],
    /// Samples per pixel that this run takes; 1 for [`Launch::Once`].
    pub samples: u32,
    /// True if the samples are jittered over their pixels.
    pub jitter: bool,
}

/// Returns the runs in a frame. If some pixels take one sample at their centre and others several, a launch of samples
/// has runs for both.
pub fn runs(launches: &[Launch], counts: SampleCounts) -> impl Iterator<Item = Run> {
    let has_centres = counts.has_centres();
    launches.iter().flat_map(move |launch| {
        let (centres, jittered, most, third) = match *launch {
            Launch::Once(args) => (Some(Run { args, samples: 1, jitter: !has_centres }), 0, 1, 0),
            Launch::Samples { most, third, only_jittered } => {
                let centres = Run { args: [0, 1, third], samples: 1, jitter: false };
                let jittered = if has_centres && counts.most == 1 { 0 } else { counts.most };
                (Some(centres).filter(|_| has_centres && !only_jittered), jittered, most, third)
            }
        };
        let batch = move |i: u32| {
            let (begin, end) = (i * most, (i * most + most).min(jittered));
            Run { args: [begin, end, third], samples: end - begin, jitter: true }
        };
        centres.into_iter().chain((0..jittered.div_ceil(most)).map(batch))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_taken_in_batches() {
        let means = Launch::Samples { most: 4, third: 7, only_jittered: true };
        let always = Launch::Samples { most: 4, third: 0, only_jittered: false };
        let all = |least, most, centres_one| {
            let counts = SampleCounts { least, most, centres_one };
            runs(&[Launch::Once([1, 2, 3]), means, always], counts).collect::<Vec<_>>()
        };
        let run = |jitter, args, samples| Run { args, samples, jitter };
        let once = |jitter| run(jitter, [1, 2, 3], 1);
        assert_eq!(all(1, 1, true), [once(false), run(false, [0, 1, 0], 1)]);
        assert_eq!(all(1, 1, false), [once(true), run(true, [0, 1, 7], 1), run(true, [0, 1, 0], 1)]);
        let both = [once(false), run(true, [0, 2, 7], 2), run(false, [0, 1, 0], 1), run(true, [0, 2, 0], 2)];
        assert_eq!(all(1, 2, true), both);
        let batches = |third| [run(true, [0, 4, third], 4), run(true, [4, 6, third], 2)];
        for counts in [all(6, 6, true), all(5, 6, true)] {
            assert_eq!(counts, [&[once(true)][..], &batches(7), &batches(0)].concat());
        }
    }
}
