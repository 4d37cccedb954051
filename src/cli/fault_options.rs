//! Options for fault injection and for the watchdog.

use std::time::Duration;

use super::failure::Failure;
use crate::exec::InjectedFaults;

#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = super::headings::TESTS)]
pub struct FaultOptions {
    /// Inject a fault (loss, hang, oom, slow), as loss:dev1@frame3
    #[arg(hide_short_help = true, long = "inject", value_name = "KIND:devI@frameF")]
    pub injections: Vec<crate::exec::Injection>,
    /// Repeat each device's work N times: one number, or one per device
    #[arg(hide_short_help = true, long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub slowdown: Vec<u32>,
    /// Drop a device that is silent for MS milliseconds [default: by frame times]
    ///
    /// A device is silent while its worker shows no progress. The default follows from the times of past frames; it is
    /// at least 10 s, or 0.6 s in play and view.
    #[arg(hide_short_help = true, long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=86_400_000))]
    pub watchdog_ms: Option<u64>,
}

impl FaultOptions {
    /// Returns the faults to inject into this number of devices.
    pub fn injected(&self, devices: usize) -> Result<InjectedFaults, Failure> {
        let refuse = |what: String| Err(Failure::Input(anyhow::anyhow!(what)));
        if let Some(i) = self.injections.iter().find(|i| i.device >= devices) {
            return refuse(format!("--inject: there is no device {}: there are {devices}, numbered from 0", i.device));
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
