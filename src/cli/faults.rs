//! Devices that fail: options to make them, limits, and what is said when it happens.

use std::time::Duration;

use diptych::exec::{InjectedFaults, Renderer};
use diptych::trace::frames::record_fault;

use super::failure::Failure;
use super::progress::Progress;
use super::setup::Tracing;

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = super::options::TESTS)]
pub struct FaultOptions {
    /// Make a device fail in the middle of a frame: loss, hang, oom, or slow, as loss:dev1@frame3; for tests
    #[arg(long = "inject", value_name = "KIND:devI@frameF")]
    pub injections: Vec<diptych::exec::Injection>,
    /// How often devices run their work, one number for all or one per device; for tests of unequal devices
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub slowdown: Vec<u32>,
    /// Drop a device that is silent for MS milliseconds [default: by frame times, at least 10 s; in play and view
    /// 0.6 s]
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=86_400_000))]
    pub watchdog_ms: Option<u64>,
}

impl FaultOptions {
    /// The faults to inject into so many devices.
    pub fn injected(&self, devices: usize) -> Result<InjectedFaults, Failure> {
        let refuse = |what: String| Err(Failure::Input(anyhow::anyhow!(what)));
        if let Some(i) = self.injections.iter().find(|i| i.device >= devices) {
            return refuse(format!("--inject: there is no device {}, but only {devices}, from 0 on", i.device));
        }
        let slowdown = match &self.slowdown[..] {
            [] => Vec::new(),
            [all] => vec![*all; devices],
            each if each.len() == devices => each.to_vec(),
            each => return refuse(format!("--slowdown: {} numbers for {devices} devices: give one each", each.len())),
        };
        Ok(InjectedFaults { injections: self.injections.clone(), slowdown })
    }

    pub fn watchdog(&self) -> Option<Duration> {
        self.watchdog_ms.map(Duration::from_millis)
    }
}

/// Says each fault once.
#[derive(Default)]
pub struct FaultLog {
    said: usize,
}

impl FaultLog {
    pub fn say_new(&mut self, renderer: &Renderer, tracing: &Tracing, progress: &Progress) {
        for fault in &renderer.faults()[self.said..] {
            progress.warn(&format!(
                "device {} failed in frame {}: {}; the frame was whole at attempt {}, {:.0} ms later, without it",
                fault.device, fault.frame, fault.what, fault.attempts, fault.recovery_ms
            ));
            record_fault(&tracing.recorder, fault);
        }
        self.said = renderer.faults().len();
    }
}

/// For measurements, which mean nothing once a device is missing.
pub fn refuse_faults(renderer: &Renderer) -> Result<(), Failure> {
    renderer.faults().first().map_or(Ok(()), |f| {
        Err(Failure::Run(anyhow::anyhow!("device {} failed while it was measured: {}", f.device, f.what)))
    })
}
