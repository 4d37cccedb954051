//! Disturbances of a run, which tests and studies ask for.

use anyhow::{anyhow, ensure};

use diptych::exec::{InjectedFaults, Injection};
use diptych::frame::settings::Settings;

use super::failure::Failure;

/// Returns the faults to inject into this number of devices.
pub fn injected(settings: &Settings, devices: usize) -> Result<InjectedFaults, Failure> {
    let refuse = |what: String| Err(Failure::Input(anyhow!(what)));
    let injections: Vec<Injection> = settings.disturb.iter().filter_map(|d| d.injection().cloned()).collect();
    if let Some(i) = injections.iter().find(|i| i.device >= devices) {
        let device = i.device;
        return refuse(format!("disturb {i}: there is no device {device}: there are {devices}, numbered from 0"));
    }
    let slowdown = match &settings.slowdown[..] {
        [] => Vec::new(),
        [all] => vec![*all; devices],
        each if each.len() == devices => each.to_vec(),
        each => return refuse(format!("slowdown: {} numbers for {devices} devices: give one each", each.len())),
    };
    Ok(InjectedFaults { injections, slowdown })
}

/// Checks the disturbances of a run of this number of frames. [`injected`] checks their devices.
pub fn check(settings: &Settings, frames: u32, makes_cuts: bool) -> Result<(), anyhow::Error> {
    for disturbance in &settings.disturb {
        let (first, last) = (disturbance.first_frame(), frames.saturating_sub(1));
        ensure!(first <= last, "disturb {disturbance}: there is no frame {first}: the last is frame {last}");
        let is_made = makes_cuts || disturbance.injection().is_some();
        ensure!(is_made, "disturb {disturbance}: only `diptych play` makes scene cuts: leave it out");
    }
    Ok(())
}
