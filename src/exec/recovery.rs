//! Renders frames again after devices have failed.

use super::frames::{Attempt, CompleteFrame, InFlight};
use super::{ExecError, Renderer};
use crate::device::DeviceFailure;

impl Renderer {
    pub(super) fn drop_device(
        &mut self,
        frame: u32,
        failures: impl IntoIterator<Item = (usize, DeviceFailure)>,
    ) -> Result<(), ExecError> {
        let planner = &mut self.planner;
        self.frames.drop_device(frame, failures.into_iter().collect(), |place| planner.remove_device(place))
    }

    /// Begins all frames again that were in flight when devices failed, oldest first. The oldest continues its series
    /// of attempts, so that the faults are attributed to it. The others start with a first attempt.
    pub(super) fn restart(&mut self, frames: Vec<InFlight>) {
        for (i, InFlight { inputs, attempt, .. }) in frames.into_iter().enumerate() {
            self.dispatch_frame(inputs, (i == 0).then_some(Attempt { number: attempt.number + 1, ..attempt }));
        }
    }

    /// Renders the last complete frame again on the other devices, since the device with its images failed in a read
    /// that began at `begin_ms`.
    pub(super) fn render_again(&mut self, failure: DeviceFailure, begin_ms: f64) -> Result<(), ExecError> {
        let Some(CompleteFrame { inputs, primary, .. }) = self.frames.whole.take() else {
            return Err(ExecError::NoFrame);
        };
        let attempt = Attempt { number: 2, ..self.frames.first_attempt(begin_ms) };
        self.drop_device(inputs.constants.sampling.index, [(primary, failure)])?;
        self.dispatch_frame(inputs, Some(attempt));
        self.finish_last(&mut |_| {}).map(drop)
    }
}
