//! The program `diptych`: the commands of [`diptych::cli`].

fn main() -> std::process::ExitCode {
    // SAFETY: the program has no other thread yet, and none of those that it starts later reads the environment but
    // through
    // `std::env`.
    unsafe { diptych::cli::prepare_environment() };
    diptych::cli::run()
}
