//! Disturbances of a run: faults of devices, and jumps of the camera. They test recovery and the control loop.

use std::fmt;
use std::str::FromStr;

use diptych::exec::{Injection, frames_of};

/// A disturbance of a run at given frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Disturbance {
    Device(Injection),
    /// Makes the camera jump before this frame.
    SceneCut {
        frame: u32,
    },
}

/// Kind of disturbance that has no device.
const SCENE_CUT: &str = "scene-cut";

impl Disturbance {
    /// Returns the first disturbed frame.
    pub fn first_frame(&self) -> u32 {
        match self {
            Self::Device(injection) => injection.frames.start,
            Self::SceneCut { frame } => *frame,
        }
    }

    /// Returns the fault of a device; `None` if no device is disturbed.
    pub fn injection(&self) -> Option<&Injection> {
        match self {
            Self::Device(injection) => Some(injection),
            Self::SceneCut { .. } => None,
        }
    }
}

impl FromStr for Disturbance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let what = text.split(['@', ':']).next().unwrap_or_default();
        if what != SCENE_CUT {
            let is_known = text.contains(":dev") && text.contains('@');
            return match is_known {
                true => text.parse().map(Self::Device),
                false => Err("write KIND:devI@FRAME with loss, hang, oom or slow as KIND, e.g. loss:dev1@3, \
                              slow:devI@FROM..TO, or scene-cut@FRAME"
                    .to_owned()),
            };
        }
        let when = text.strip_prefix(SCENE_CUT).and_then(|rest| rest.strip_prefix('@'));
        let when = when.ok_or("a scene cut has no device: write scene-cut@FRAME, e.g. scene-cut@150")?;
        let frames = frames_of(when)?;
        match frames.len() {
            1 => Ok(Self::SceneCut { frame: frames.start }),
            _ => Err(format!("a scene cut is at one frame: write scene-cut@{}", frames.start)),
        }
    }
}

impl fmt::Display for Disturbance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Device(injection) => injection.fmt(f),
            Self::SceneCut { frame } => write!(f, "{SCENE_CUT}@{frame}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::exec::InjectedKind;

    #[test]
    fn disturbances_round_trip_through_text() {
        let slow = |frames| Disturbance::Device(Injection { kind: InjectedKind::Slow, device: 1, frames });
        assert_eq!("slow:dev1@100..200".parse(), Ok(slow(100..200)));
        assert_eq!("slow:dev1@5".parse(), Ok(slow(5..6)));
        assert_eq!("scene-cut@150".parse(), Ok(Disturbance::SceneCut { frame: 150 }));
        for text in ["slow:dev1@100..200", "loss:dev0@7", "scene-cut@150"] {
            assert_eq!(text.parse::<Disturbance>().unwrap().to_string(), text);
        }
        // The spelling of earlier versions.
        assert_eq!("slow:dev1@frame5".parse(), Ok(slow(5..6)));
        assert_eq!("hang:dev2@frame3".parse::<Disturbance>().unwrap().to_string(), "hang:dev2@3");
    }

    #[test]
    fn rejects_invalid_disturbances_with_a_hint() {
        for (wrong, reason) in [
            ("", "write KIND:devI@FRAME"),
            ("slow", "write KIND:devI@FRAME"),
            ("cut@3", "scene-cut@FRAME"),
            ("slow:1@0..2", "e.g. loss:dev1@3"),
            ("melt:dev1@3", "choose loss, hang, oom or slow"),
            ("slow:dev1@9..3", "the frame range 9..3 is empty"),
            ("slow:devx@0..2", "'x' is not a device number"),
            ("loss:dev1@3..5", "write loss:dev1@3"),
            ("scene-cut@x", "'x' is not a frame number"),
            ("scene-cut@3..5", "write scene-cut@3"),
            ("scene-cut:dev1@3", "has no device"),
            ("scene-cut", "write scene-cut@FRAME"),
            ("loss:dev1@4294967295", "is not a frame number"),
        ] {
            let said = wrong.parse::<Disturbance>().unwrap_err();
            assert!(said.contains(reason) && !said.contains('\n'), "{wrong}: {said}");
        }
    }
}
