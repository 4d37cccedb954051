//! The program `diptych`: the commands of [`diptych_cli`].

fn main() -> std::process::ExitCode {
    // SAFETY: the program has no other thread yet, and the threads that it starts later read the environment only
    // through `std::env`.
    unsafe { diptych_cli::prepare_environment() };
    diptych_cli::run()
}
