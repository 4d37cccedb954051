//! Messages about failed devices.

use diptych::exec::Renderer;
use diptych::trace::frames::record_fault;

use super::failure::Failure;
use super::progress::Progress;
use super::setup::Tracing;

/// Log of device faults, which reports each fault once.
#[derive(Default)]
pub struct FaultLog {
    said: usize,
}

impl FaultLog {
    pub fn say_new(&mut self, renderer: &Renderer, tracing: &Tracing, progress: &Progress) {
        for fault in &renderer.faults()[self.said..] {
            progress.warn(&format!(
                "device {} failed in frame {}: {}; the other devices completed the frame at attempt {}, {:.0} ms after \
                 its start",
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
