//! Processes that `mpirun` starts together: rank 0 runs the command, the others serve it with their devices.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use diptych::device::GpuDevice;
use diptych::exec::ranks::{Host, Load};
use diptych::passes::Declarations;
use diptych::scene::folder::Source;
use diptych::tables::SceneTables;
use diptych::trace::HostSpans;

use super::failure::Failure;
use super::node::NODE;
use super::options::RunOptions;
use super::registry::registered;
use super::{hints, interrupt, setup};

/// Joins the other processes that were started together with this one, if any were.
pub fn join() -> Result<(), Failure> {
    #[cfg(feature = "mpi")]
    if diptych::exec::ranks::started_as().is_some() {
        let node = diptych::exec::ranks::Node::join(diptych::exec::ranks::MpiLink::new, interrupt::raise);
        let node = node.map_err(|what| Failure::Run(anyhow::anyhow!("cannot join the other ranks: {what}")))?;
        let node = NODE.get_or_init(|| node);
        if node.rank() == 0 {
            node.meet()?;
        }
    }
    Ok(())
}

/// Fails if this process is one of several. Without MPI they cannot distribute the work, and each would write the same
/// files.
#[cfg(not(feature = "mpi"))]
pub fn check_alone() -> Result<(), Failure> {
    let Some(number) = diptych::exec::ranks::started_as() else { return Ok(()) };
    // One process reports the error first; the launcher then ends the others.
    if number > 0 {
        std::thread::sleep(std::time::Duration::from_secs(1));
    }
    let what = "this is one of several processes started by an MPI launcher, but this diptych was built without MPI: \
                build it with `--features mpi`, or start one process";
    Err(Failure::Run(anyhow::anyhow!(what)))
}

#[cfg(feature = "mpi")]
pub fn check_alone() -> Result<(), Failure> {
    Ok(())
}

/// True if this process serves rank 0.
pub fn serves() -> bool {
    NODE.get().is_some_and(|node| node.rank() > 0)
}

/// Serves rank 0 until rank 0 ends. Returns the exit status that rank 0 sends.
pub fn serve(options: Option<&RunOptions>) -> Result<u8, Failure> {
    let Some(node) = NODE.get() else { return Ok(0) };
    interrupt::watch_signals()?;
    match diptych::exec::ranks::serve(node, &mut Here { options, spans: None }) {
        Ok(status) => Ok(status),
        Err(lost) => {
            // One rank reports the error first; the launcher then ends the others.
            if node.rank() > 1 {
                std::thread::sleep(std::time::Duration::from_secs(1));
            }
            Err(lost.into())
        }
    }
}

/// Ends all processes with this exit status.
pub fn end(status: u8) {
    if let Some(node) = NODE.get() {
        // Processes that do not end together make the launcher report an error.
        let _ending = interrupt::writing();
        node.end(status);
    }
}

/// This process as a [`Host`], with the options of its own command line.
struct Here<'a> {
    options: Option<&'a RunOptions>,
    /// Trace spans of this process; `None` if it records none.
    spans: Option<HostSpans>,
}

impl Here<'_> {
    fn options(&self) -> Result<&RunOptions, String> {
        self.options.ok_or_else(|| "its command does not render".to_owned())
    }
}

impl Host for Here<'_> {
    fn open(&mut self, virtual_devices: usize) -> Result<Vec<GpuDevice>, String> {
        setup::open_here(self.options()?, virtual_devices).map_err(|failure| failure.line())
    }

    fn load(&mut self, what: &Load) -> Result<Arc<SceneTables>, String> {
        let source = what.files.as_ref().map_or(Source::Disk, Source::Sent);
        setup::load_here(self.options()?, what, source).map(|loaded| loaded.tables).map_err(|failure| failure.line())
    }

    fn record(&mut self, zero: Instant) -> Result<(), String> {
        self.spans = Some(HostSpans::install(zero).map_err(|e| e.to_string())?);
        Ok(())
    }

    fn recorded(&mut self) -> Vec<u8> {
        self.spans.as_mut().map_or_else(Vec::new, HostSpans::take)
    }

    fn passes(&self) -> Declarations {
        registered().clone()
    }

    fn describe(&self, error: &(dyn Error + 'static)) -> String {
        hints::with_options(error)
    }

    fn interrupted(&self) -> Option<i32> {
        interrupt::signal()
    }
}
