//! Device faults: records of those that happened, and faults that are injected to test recovery.

use crate::device::FailureKind;
use crate::frame::Injection;
pub use crate::plan::InjectedKind;

/// A dropped device, and how the frame recovered.
#[derive(Clone, Debug, serde::Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Fault {
    pub frame: u32,
    /// Number of the device in the run. The numbers of other devices do not change.
    pub device: usize,
    pub kind: FailureKind,
    pub what: String,
    /// Number of attempts until the frame was complete.
    pub attempts: u32,
    /// Time that a viewer waited for the frame, in milliseconds: from the start of its first attempt until the other
    /// devices completed it. It includes the time until the fault was detected. If the device failed while images of a
    /// complete frame were read, from the start of this read.
    pub recovery_ms: f64,
    /// Time at which the fault was detected, in milliseconds since the renderer's origin.
    #[serde(skip)]
    pub noticed_ms: f64,
}

/// The faults to inject into devices.
#[derive(Clone, Debug, Default)]
pub struct InjectedFaults {
    /// Faults that are still to be injected.
    pub injections: Vec<Injection>,
    /// Number of times that each device runs its dispatches, in every frame. Devices without an entry run them once.
    pub slowdown: Vec<u32>,
}

impl InjectedFaults {
    /// Returns how many times a device runs each of its dispatches in a frame, and the fault to inject in addition, if
    /// any. Each slow injection of the frame doubles the number. Removes the fault that it returns, which happens once.
    pub fn take(&mut self, device: usize, frame: u32) -> (u32, Option<InjectedKind>) {
        let mut runs = self.slowdown.get(device).copied().unwrap_or(1);
        let mut fault = None;
        self.injections.retain(|i| match i.kind {
            InjectedKind::Slow => {
                if i.device == device && i.frames.contains(&frame) {
                    runs = runs.saturating_mul(2);
                }
                true
            }
            kind => {
                let is_due = i.device == device && i.frames.start == frame && fault.is_none();
                if is_due {
                    fault = Some(kind);
                }
                !is_due
            }
        });
        (runs, fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_occur_once_and_slowdowns_span_frames() {
        let all = ["loss:dev1@frame3", "slow:dev1@2..4", "slow:dev1@3", "oom:dev1@frame3", "hang:dev0@frame3"];
        let injections = all.iter().map(|i| i.parse().unwrap()).collect();
        let mut injected = InjectedFaults { injections, slowdown: vec![1, 3] };
        assert_eq!(injected.take(1, 1), (3, None));
        assert_eq!(injected.take(1, 2), (6, None));
        assert_eq!(injected.take(1, 3), (12, Some(InjectedKind::Loss)));
        assert_eq!(injected.take(1, 3), (12, Some(InjectedKind::Oom)));
        assert_eq!(injected.take(1, 3), (12, None));
        assert_eq!(injected.take(1, 4), (3, None));
        assert_eq!(injected.take(0, 3), (1, Some(InjectedKind::Hang)));
        assert_eq!(injected.take(2, 3), (1, None));
    }
}
