//! Device faults: records of those that happened, and faults that are injected to test recovery.

use std::str::FromStr;

use crate::device::FailureKind;

/// A dropped device, and how the frame recovered.
#[derive(Clone, Debug, serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Fault {
    pub frame: u32,
    /// Number of the device in the run. The numbers of other devices do not change.
    pub device: usize,
    pub kind: FailureKind,
    pub what: String,
    /// Number of attempts until the frame was complete.
    pub attempts: u32,
    /// Time from the detection of the fault until the frame was complete, in milliseconds.
    pub recovery_ms: f64,
    /// Time at which the fault was detected, in milliseconds since the renderer's origin.
    #[serde(skip)]
    pub noticed_ms: f64,
}

/// Fault to inject into a device in the middle of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub enum InjectedKind {
    /// The device is destroyed.
    Loss,
    /// Its worker blocks for ever.
    Hang,
    /// Its dispatches run twice.
    Slow,
    /// It reports that it is out of memory.
    Oom,
}

/// A fault to inject once, written `KIND:devI@frameF`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Injection {
    pub kind: InjectedKind,
    pub device: usize,
    pub frame: u32,
}

impl FromStr for Injection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once(":dev").and_then(|(kind, place)| Some((kind, place.split_once("@frame")?)));
        let Some((kind, (device, frame))) = parts else {
            return Err("write KIND:devI@frameF, e.g. loss:dev1@frame3".to_owned());
        };
        let kind = match kind {
            "loss" => InjectedKind::Loss,
            "hang" => InjectedKind::Hang,
            "slow" => InjectedKind::Slow,
            "oom" => InjectedKind::Oom,
            other => return Err(format!("'{other}' is not a fault: choose loss, hang, slow or oom")),
        };
        let device = device.parse().map_err(|_| format!("'{device}' is not a device number"))?;
        let frame = frame.parse().map_err(|_| format!("'{frame}' is not a frame number"))?;
        Ok(Self { kind, device, frame })
    }
}

/// The faults to inject into devices.
#[derive(Clone, Debug, Default)]
pub struct InjectedFaults {
    /// Faults that are still to be injected, each once.
    pub injections: Vec<Injection>,
    /// Number of times that each device runs its dispatches, in every frame. Devices without an entry run them once.
    pub slowdown: Vec<u32>,
}

impl InjectedFaults {
    /// Returns how many times a device runs each of its dispatches in a frame, and the fault to inject in addition, if
    /// any. Removes the injections that it returns, so that each happens once.
    pub fn take(&mut self, device: usize, frame: u32) -> (u32, Option<InjectedKind>) {
        let mut runs = self.slowdown.get(device).copied().unwrap_or(1);
        let mut fault = None;
        self.injections.retain(|i| {
            let is_due = i.device == device && i.frame == frame && (i.kind == InjectedKind::Slow || fault.is_none());
            match i.kind {
                InjectedKind::Slow if is_due => runs *= 2,
                kind if is_due => fault = Some(kind),
                _ => {}
            }
            !is_due
        });
        (runs, fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn injections_are_read_as_they_are_written() {
        let hang = Injection { kind: InjectedKind::Hang, device: 12, frame: 345 };
        assert_eq!("hang:dev12@frame345".parse(), Ok(hang));
        for wrong in ["", "loss", "loss:dev1", "loss:1@3", "melt:dev1@frame3", "loss:devx@frame3", "oom:dev1@frame-3"] {
            assert!(wrong.parse::<Injection>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn each_injection_happens_once() {
        let all = ["loss:dev1@frame3", "slow:dev1@frame3", "oom:dev1@frame3", "hang:dev0@frame3"];
        let injections = all.iter().map(|i| i.parse().unwrap()).collect();
        let mut injected = InjectedFaults { injections, slowdown: vec![1, 3] };
        assert_eq!(injected.take(1, 2), (3, None));
        assert_eq!(injected.take(1, 3), (6, Some(InjectedKind::Loss)));
        assert_eq!(injected.take(1, 3), (3, Some(InjectedKind::Oom)));
        assert_eq!(injected.take(1, 3), (3, None));
        assert_eq!(injected.take(0, 3), (1, Some(InjectedKind::Hang)));
        assert_eq!(injected.take(2, 3), (1, None));
    }
}
