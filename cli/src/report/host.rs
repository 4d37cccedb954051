//! The computer and the build of a run, for `run.json` and `machine.json`.

use serde::Serialize;
use sysinfo::{CpuRefreshKind, RefreshKind, System};

use crate::scene_loading::host_memory;

/// The computer of a run, on which its rank 0 runs, and the build of diptych.
#[derive(Clone, Debug, Default, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct HostSummary {
    /// Name of the processor; `null` if the system does not tell.
    pub processor: Option<String>,
    /// Logical processors that this process may use.
    pub cores: usize,
    /// Memory of the machine, or of the container if that has less, MiB.
    pub memory_mib: u64,
    /// Kernel of the operating system, with its version.
    pub kernel: String,
    /// Commit that diptych was built from: `DIPTYCH_COMMIT` of the build's environment.
    pub commit: Option<&'static str>,
}

impl HostSummary {
    /// Describes this computer.
    pub fn here() -> Self {
        let system = System::new_with_specifics(RefreshKind::nothing().with_cpu(CpuRefreshKind::nothing()));
        let brand = system.cpus().first().map(|cpu| cpu.brand().trim().to_owned());
        Self {
            processor: brand.filter(|brand| !brand.is_empty()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            memory_mib: host_memory() >> 20,
            kernel: System::kernel_long_version(),
            commit: option_env!("DIPTYCH_COMMIT"),
        }
    }
}
