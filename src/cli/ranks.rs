//! Several processes that render together, as `mpirun` starts them: rank 0 runs the command, the others serve it with
//! their devices.

use std::sync::{Arc, OnceLock};

use diptych::device::GpuDevice;
use diptych::exec::ranks::{Host, Load, Node};
use diptych::scene::folder::Source;
use diptych::stages::SceneTables;

use super::failure::Failure;
use super::interrupt;
use super::options::RunOptions;
use super::setup;

static NODE: OnceLock<Arc<Node>> = OnceLock::new();

/// Joins the other processes that were started together with this one, if any were.
pub fn join() -> Result<(), Failure> {
    #[cfg(feature = "mpi")]
    if diptych::exec::ranks::MpiLink::is_wanted() {
        let node = Node::join(diptych::exec::ranks::MpiLink::new, interrupt::raise);
        let node = node.map_err(|what| Failure::Run(anyhow::anyhow!("cannot join the other ranks: {what}")))?;
        let node = NODE.get_or_init(|| node);
        if node.rank() == 0 {
            node.meet()?;
        }
    }
    Ok(())
}

/// Whether this process serves another.
pub fn serves() -> bool {
    NODE.get().is_some_and(|node| node.rank() > 0)
}

/// What leads from rank 0 to others, if there are any.
pub fn others() -> Option<&'static Arc<Node>> {
    NODE.get().filter(|node| node.rank() == 0 && node.ranks() > 1)
}

/// Serves rank 0 until it ends; returns its exit status.
pub fn serve(options: Option<&RunOptions>) -> Result<u8, Failure> {
    let Some(node) = NODE.get() else { return Ok(0) };
    interrupt::watch()?;
    match diptych::exec::ranks::serve(node, &mut Here { options }) {
        Ok(status) => Ok(status),
        Err(lost) => {
            // One rank says it, and the others end with it.
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
        node.end(status);
    }
}

/// This process, by its own command line.
struct Here<'a> {
    options: Option<&'a RunOptions>,
}

impl Here<'_> {
    fn options(&self) -> Result<&RunOptions, String> {
        self.options.ok_or_else(|| "its command line is not one that renders".to_owned())
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

    fn interrupted(&self) -> Option<i32> {
        interrupt::signal()
    }
}
