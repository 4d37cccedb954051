//! Device faults: records of those that happened, and faults that are injected to test recovery.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::device::FailureKind;
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

/// A fault to inject, written `KIND:devI@FRAME`, or `slow:devI@FROM..TO`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Injection {
    pub kind: InjectedKind,
    pub device: usize,
    /// Frames in which the device is slow. Other faults happen once, in the first of these frames.
    pub frames: Range<u32>,
}

/// Parses `FRAME` or `FROM..TO`. Accepts `frameN` for a frame number N, the spelling of earlier versions.
///
/// # Errors
/// A message if a number is invalid or the range is empty.
pub fn frames_of(text: &str) -> Result<Range<u32>, String> {
    let frame = |text: &str| {
        let number = text.strip_prefix("frame").unwrap_or(text).parse::<u32>();
        number.ok().filter(|n| *n < u32::MAX).ok_or_else(|| format!("'{text}' is not a frame number"))
    };
    let Some((from, to)) = text.split_once("..") else { return frame(text).map(|n| n..n + 1) };
    let frames = frame(from)?..frame(to)?;
    if frames.is_empty() {
        return Err(format!("the frame range {from}..{to} is empty: write FROM..TO with FROM below TO"));
    }
    Ok(frames)
}

impl FromStr for Injection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once(":dev").and_then(|(kind, place)| Some((kind, place.split_once('@')?)));
        let Some((name, (device, when))) = parts else {
            return Err("write KIND:devI@FRAME, e.g. loss:dev1@3, or slow:devI@FROM..TO".to_owned());
        };
        let kind = InjectedKind::ALL.into_iter().find(|(known, _)| *known == name);
        let (_, kind) = kind.ok_or_else(|| format!("'{name}' is not a fault: choose loss, hang, oom or slow"))?;
        let device = device.parse().map_err(|_| format!("'{device}' is not a device number"))?;
        let frames = frames_of(when)?;
        if kind != InjectedKind::Slow && frames.len() > 1 {
            return Err(format!("only slow lasts for several frames: write {name}:dev{device}@{}", frames.start));
        }
        Ok(Self { kind, device, frames })
    }
}

impl fmt::Display for Injection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Range { start, end } = self.frames;
        write!(f, "{}:dev{}@{start}", self.kind.name(), self.device)?;
        if self.frames.len() > 1 { write!(f, "..{end}") } else { Ok(()) }
    }
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
    fn injections_parse_or_are_rejected() {
        let hang = Injection { kind: InjectedKind::Hang, device: 12, frames: 345..346 };
        assert_eq!("hang:dev12@345".parse(), Ok(hang.clone()));
        assert_eq!("hang:dev12@frame345".parse(), Ok(hang));
        for wrong in ["", "loss", "loss:dev1", "loss:1@3", "melt:dev1@frame3", "loss:devx@frame3", "oom:dev1@frame-3"] {
            assert!(wrong.parse::<Injection>().is_err(), "{wrong}");
        }
    }

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
