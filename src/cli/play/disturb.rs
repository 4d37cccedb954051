//! Disturbances that test the control loop.

use crate::cli::failure::Failure;
use std::ops::Range;
use std::str::FromStr;

/// A disturbance of a run at given frames.
#[derive(Clone, Debug, PartialEq)]
pub enum Disturbance {
    /// Makes the device run its work twice in these frames.
    Slow { device: usize, frames: Range<u32> },
    /// Makes the camera jump before this frame.
    SceneCut { frame: u32 },
}

const FORMS: &str = "write slow:devI@FROM..TO, e.g. slow:dev1@100..200, or scene-cut@FRAME, e.g. scene-cut@150";

impl FromStr for Disturbance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (what, when) = text.split_once('@').ok_or(FORMS)?;
        let frame = |text: &str| text.parse::<u32>().map_err(|_| format!("'{text}' is not a frame number"));
        if what == "scene-cut" {
            return Ok(Self::SceneCut { frame: frame(when)? });
        }
        let device = what.strip_prefix("slow:dev").ok_or(FORMS)?;
        let device = device.parse().map_err(|_| format!("'{device}' is not a device number"))?;
        let (from, to) = when.split_once("..").ok_or(FORMS)?;
        let frames = frame(from)?..frame(to)?;
        if frames.is_empty() {
            return Err(format!("the frame range {from}..{to} is empty"));
        }
        Ok(Self::Slow { device, frames })
    }
}

/// All disturbances of a run.
pub struct Disturbances<'a>(pub &'a [Disturbance]);

impl Disturbances<'_> {
    /// Checks the disturbances against the length of the run and the number of devices.
    ///
    /// # Errors
    /// [`Failure::Input`] for frames and devices that the run does not have.
    pub fn check(&self, frames: u32, devices: usize) -> Result<(), Failure> {
        for disturbance in self.0 {
            let (first, device) = match disturbance {
                Disturbance::Slow { device, frames } => (frames.start, *device),
                Disturbance::SceneCut { frame } => (*frame, 0),
            };
            let refuse = |what: String| Err(Failure::Input(anyhow::anyhow!("--disturb: {what}")));
            if first >= frames {
                return refuse(format!("there is no frame {first}: the last of {frames} is {}", frames - 1));
            }
            if device >= devices {
                return refuse(format!("there is no device {device}: there are {devices}, numbered from 0"));
            }
        }
        Ok(())
    }

    /// Returns the number of times that each device runs its work in this frame; `base` has the numbers without
    /// disturbances.
    pub fn slowdown(&self, frame: u32, base: &[u32], devices: usize) -> Vec<u32> {
        let mut runs: Vec<u32> = (0..devices).map(|d| base.get(d).copied().unwrap_or(1)).collect();
        for disturbance in self.0 {
            if let Disturbance::Slow { device, frames } = disturbance
                && frames.contains(&frame)
            {
                runs[*device] *= 2;
            }
        }
        runs
    }

    pub fn cuts_before(&self, frame: u32) -> bool {
        self.0.contains(&Disturbance::SceneCut { frame })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disturbances_are_read_as_they_are_written() {
        assert_eq!("slow:dev1@100..200".parse(), Ok(Disturbance::Slow { device: 1, frames: 100..200 }));
        assert_eq!("scene-cut@150".parse(), Ok(Disturbance::SceneCut { frame: 150 }));
        for wrong in
            ["", "slow", "slow:dev1@5", "slow:dev1@9..3", "slow:1@0..2", "slow:devx@0..2", "cut@3", "scene-cut@x"]
        {
            assert!(wrong.parse::<Disturbance>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_device_is_slow_in_its_frames_alone() {
        let all = ["slow:dev1@2..4".parse().unwrap(), "slow:dev1@3..9".parse().unwrap()];
        let runs = |frame| Disturbances(&all).slowdown(frame, &[1, 3], 2);
        assert_eq!([1, 2, 3, 8, 9].map(runs), [[1, 3], [1, 6], [1, 12], [1, 6], [1, 3]]);
    }
}
