//! The command line. Everything it does is in the library; see [`diptych`].

mod cli;

fn main() -> std::process::ExitCode {
    cli::run()
}
