//! The console of a command: where it writes, and the command line that started it. Each thread runs one command at a
//! time.

use std::cell::RefCell;
use std::ffi::OsString;
use std::fmt::Arguments;
use std::io::{self, IsTerminal, Write};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Instant;

use anyhow::anyhow;

use super::core_time::CoreTime;
use super::failure::Failure;
use super::given::Given;
use diptych::device::DevicePool;

/// Streams that a command writes to, and pool from which it takes devices.
#[derive(Default)]
pub struct Console {
    /// Standard output and standard error of the command, if they are not those of the process.
    streams: Option<[Stream; 2]>,
    devices: Option<DevicePool>,
    core_time: Option<Clock>,
}

type Clock = Box<dyn Fn() -> Option<CoreTime> + Send + Sync>;

type Stream = Mutex<Box<dyn Write + Send>>;

impl Console {
    /// Returns the console of this process: its standard streams and its signals.
    pub fn process() -> Self {
        Self::default()
    }

    /// Creates a console with these streams as standard output and standard error. Its commands ignore signals.
    pub fn new(out: impl Write + Send + 'static, error: impl Write + Send + 'static) -> Self {
        Self { streams: Some([Mutex::new(Box::new(out)), Mutex::new(Box::new(error))]), ..Self::default() }
    }

    /// Takes devices from this pool, and leaves them there for the next command.
    #[must_use]
    pub fn devices(self, pool: DevicePool) -> Self {
        Self { devices: Some(pool), ..self }
    }

    /// Sets the clock that tells how long other programs ran, so that tests do not depend on the load of the machine.
    #[must_use]
    pub fn core_time(self, clock: impl Fn() -> Option<CoreTime> + Send + Sync + 'static) -> Self {
        Self { core_time: Some(Box::new(clock)), ..self }
    }
}

/// A command that runs.
#[derive(Default)]
struct Run {
    console: Console,
    args: Vec<OsString>,
    given: OnceLock<Arc<Given>>,
    begun: OnceLock<Instant>,
    /// The first error of standard output.
    failed: OnceLock<io::Error>,
}

thread_local! {
    static RUN: RefCell<Arc<Run>> = RefCell::default();
}

/// The run of a thread. Its end restores the previous one.
pub struct Entered(Arc<Run>);

impl Drop for Entered {
    fn drop(&mut self) {
        RUN.set(Arc::clone(&self.0));
    }
}

/// Begins a command with these arguments, the name of the program first, on this thread.
pub fn begin(args: Vec<OsString>, console: Console) -> Entered {
    Entered(RUN.replace(Arc::new(Run { console, args, begun: Instant::now().into(), ..Run::default() })))
}

/// Returns a function that lets another thread take part in the command of this one.
#[cfg(feature = "view")]
pub fn enter() -> impl FnOnce() -> Entered + Send {
    let run = run();
    move || Entered(RUN.replace(run))
}

fn run() -> Arc<Run> {
    RUN.with_borrow(Arc::clone)
}

/// Returns the arguments of this command, the name of the program first.
pub fn args() -> Vec<OsString> {
    run().args.clone()
}

/// Returns when this command began; now if none has.
pub fn begun() -> Instant {
    *run().begun.get_or_init(Instant::now)
}

/// Returns the command line. Bytes that are not UTF-8 become replacement characters.
pub fn command_line() -> String {
    run().args.iter().map(|arg| arg.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

/// Keeps the options that the command was started with.
pub fn keep_options(given: Given) {
    run().given.get_or_init(|| Arc::new(given));
}

impl Given {
    /// Returns the options of this command; `None` before they are kept, as in tests.
    pub fn here() -> Option<Arc<Self>> {
        run().given.get().cloned()
    }
}

/// Pool of all commands of this process that have none of their own.
#[cfg(feature = "python")]
static POOL: OnceLock<DevicePool> = OnceLock::new();

/// Keeps the devices of this process, with their compiled pipelines, for later use.
#[cfg(feature = "python")]
pub fn keep_devices() {
    POOL.get_or_init(DevicePool::default);
}

/// Returns the pool of devices, if there is one.
pub fn devices() -> Option<DevicePool> {
    let own = run().console.devices.clone();
    #[cfg(feature = "python")]
    let own = own.or_else(|| POOL.get().cloned());
    own
}

/// Returns for how long other programs ran; `None` if the system does not tell.
pub fn core_time() -> Option<CoreTime> {
    let run = run();
    run.console.core_time.as_ref().map_or_else(CoreTime::read, |clock| clock())
}

/// True if the command has the streams and signals of the process.
pub fn is_of_process() -> bool {
    run().console.streams.is_none()
}

/// True if messages appear on a terminal.
pub fn is_terminal() -> bool {
    is_of_process() && io::stderr().is_terminal()
}

/// Calls `write` with standard output, or with standard error.
fn with_stream(is_error: bool, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    match &run().console.streams {
        Some(streams) => write(&mut *streams[usize::from(is_error)].lock().unwrap_or_else(PoisonError::into_inner)),
        None if is_error => write(&mut io::stderr()),
        None => write(&mut io::stdout()),
    }
}

/// Keeps the first error of standard output. A closed pipe, as `head` leaves behind, is no error.
fn keep(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != io::ErrorKind::BrokenPipe
    {
        run().failed.get_or_init(|| error);
    }
}

/// Prints to standard output. [`finish`] reports an error.
pub fn print(text: Arguments) {
    keep(with_stream(false, |out| out.write_fmt(text)));
}

/// Prints a line to standard error, and ignores errors, which could be reported nowhere else.
pub fn log(text: Arguments) {
    let _ = with_stream(true, |error| writeln!(error, "{text}"));
}

/// Prints help to standard output, or what is wrong with the command line to standard error.
pub fn print_parsed(error: &clap::Error) {
    let is_error = error.use_stderr();
    let printed = match is_of_process() {
        true => error.print(),
        false => with_stream(is_error, |stream| write!(stream, "{}", error.render())),
    };
    if !is_error {
        keep(printed);
    }
}

/// Flushes standard output.
///
/// # Errors
/// [`Failure::Run`] if the command could not write all of its output.
pub fn finish() -> Result<(), Failure> {
    keep(with_stream(false, |out| out.flush()));
    let failed = |error| Err(Failure::Run(anyhow!("cannot write to standard output: {error}")));
    run().failed.get().map_or(Ok(()), failed)
}
