//! Faults of devices: those to inject, and messages about those that happened.

use anyhow::{anyhow, ensure};

use diptych::exec::{InjectedFaults, Injection, Renderer};
use diptych::frame::settings::Settings;
use diptych::trace::frames::record_fault;

use super::failure::Failure;
use super::options::RunOptions;
use super::progress::Progress;
use super::setup::Tracing;

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
pub fn check(run: &RunOptions, frames: u32) -> Result<(), anyhow::Error> {
    for disturbance in &run.settings.disturb {
        let (first, last) = (disturbance.first_frame(), frames.saturating_sub(1));
        ensure!(first <= last, "disturb {disturbance}: there is no frame {first}: the last is frame {last}");
        let is_made = run.makes_cuts || disturbance.injection().is_some();
        ensure!(is_made, "disturb {disturbance}: only `diptych play` makes scene cuts: leave it out");
    }
    Ok(())
}

/// Log of device faults, which reports each fault once.
#[derive(Default)]
pub struct FaultLog {
    said: usize,
}

impl FaultLog {
    pub fn say_new(&mut self, renderer: &Renderer, tracing: &Tracing, progress: &Progress) {
        for fault in &renderer.faults()[self.said..] {
            progress.warn(&format!(
                "device {} failed in frame {}: {}; the other devices completed the frame at attempt {}, {:.0} ms after its start",
                fault.device, fault.frame, fault.what, fault.attempts, fault.recovery_ms
            ));
            record_fault(&tracing.recorder, fault);
        }
        self.said = renderer.faults().len();
    }
}

/// Fails if a device was lost, which makes measurements meaningless.
pub fn refuse_faults(renderer: &Renderer) -> Result<(), Failure> {
    renderer.faults().first().map_or(Ok(()), |f| {
        Err(Failure::Run(anyhow::anyhow!("device {} failed while it was measured: {}", f.device, f.what)))
    })
}
