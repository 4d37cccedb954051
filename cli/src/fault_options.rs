//! The option for fault injection.

use anyhow::ensure;

use super::disturb::Disturbance;
use super::failure::Failure;
use diptych::exec::{InjectedFaults, Injection};

#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = super::headings::TESTS)]
pub struct FaultOptions {
    /// Disturb the run, e.g. loss:dev1@3, slow:dev1@5..9 or scene-cut@7
    ///
    /// Write KIND:devI@FRAME for a fault of device I. KIND is loss, hang, oom (out of memory) or slow, which runs each
    /// dispatch twice; slow:devI@FROM..TO lasts until before frame TO. scene-cut@FRAME makes the camera of `play` jump.
    /// Repeat the option for several disturbances.
    #[arg(hide_short_help = true, long = "disturb", value_name = "WHAT@WHEN")]
    pub disturbances: Vec<Disturbance>,
    /// True if the command makes scene cuts.
    #[arg(skip)]
    pub makes_cuts: bool,
}

impl FaultOptions {
    /// Returns the faults to inject into this number of devices.
    pub fn injected(&self, slowdown: &[u32], devices: usize) -> Result<InjectedFaults, Failure> {
        let refuse = |what: String| Err(Failure::Input(anyhow::anyhow!(what)));
        let injections: Vec<Injection> = self.disturbances.iter().filter_map(|d| d.injection().cloned()).collect();
        if let Some(i) = injections.iter().find(|i| i.device >= devices) {
            let device = i.device;
            return refuse(format!("--disturb {i}: there is no device {device}: there are {devices}, numbered from 0"));
        }
        let slowdown = match slowdown {
            [] => Vec::new(),
            [all] => vec![*all; devices],
            each if each.len() == devices => each.to_vec(),
            each => return refuse(format!("slowdown: {} numbers for {devices} devices: give one each", each.len())),
        };
        Ok(InjectedFaults { injections, slowdown })
    }

    /// Checks the disturbances of a run of this number of frames. [`Self::injected`] checks their devices.
    pub fn check(&self, frames: u32) -> Result<(), anyhow::Error> {
        for disturbance in &self.disturbances {
            let (first, last) = (disturbance.first_frame(), frames.saturating_sub(1));
            ensure!(first <= last, "--disturb {disturbance}: there is no frame {first}: the last is frame {last}");
            let is_made = self.makes_cuts || disturbance.injection().is_some();
            ensure!(is_made, "--disturb {disturbance}: only `diptych play` makes scene cuts: leave it out");
        }
        Ok(())
    }
}
