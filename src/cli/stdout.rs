//! Standard output of commands. If it cannot be written, a command first writes its files, and then fails.

use std::fmt::Arguments;
use std::io::{self, Write};
use std::sync::OnceLock;

use anyhow::anyhow;

use super::failure::Failure;

/// The first error of standard output.
static FAILED: OnceLock<io::Error> = OnceLock::new();

/// Prints a line to standard output. [`finish`] reports an error.
pub fn print_line(text: Arguments) {
    keep(writeln!(io::stdout(), "{text}"));
}

/// Keeps the first error of standard output. A closed pipe, as `head` leaves behind, is no error.
pub fn keep(written: io::Result<()>) {
    if let Err(error) = written
        && error.kind() != io::ErrorKind::BrokenPipe
    {
        FAILED.get_or_init(|| error);
    }
}

/// Flushes standard output.
///
/// # Errors
/// [`Failure::Run`] if the process could not write all of its output.
pub fn finish() -> Result<(), Failure> {
    keep(io::stdout().flush());
    let failed = |error| Err(Failure::Run(anyhow!("cannot write to standard output: {error}")));
    FAILED.get().map_or(Ok(()), failed)
}
