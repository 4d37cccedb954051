//! Disturbances of a run: faults of devices, and jumps of the camera. They test recovery and the control loop.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use crate::plan::InjectedKind;

/// A fault to inject, written `KIND:devI@FRAME`, or `slow:devI@FROM..TO`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Injection {
    pub kind: InjectedKind,
    pub device: usize,
    /// Frames in which the device is slow. Other faults happen once, in the first of these frames.
    pub frames: Range<u32>,
}

/// Parses `FRAME` or `FROM..TO`. Accepts `frameN` for a frame number N, the spelling of earlier versions.
fn frames_of(text: &str) -> Result<Range<u32>, String> {
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
            return Err("write KIND:devI@FRAME with loss, hang, oom or slow as KIND, e.g. loss:dev1@3, \
                        slow:devI@FROM..TO, or scene-cut@FRAME"
                .to_owned());
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

    /// Returns true if frame `index` is disturbed.
    pub fn is_at(&self, index: u32) -> bool {
        match self {
            Self::Device(injection) => injection.frames.contains(&index),
            Self::SceneCut { frame } => *frame == index,
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
            return text.parse().map(Self::Device);
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
