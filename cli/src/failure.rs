//! Failures of commands, and their exit statuses.

use diptych::accel::AccelError;
use diptych::accumulation::{AccumulateError, CheckpointError};
use diptych::denoise::DenoiseError;
use diptych::device::DeviceError;
use diptych::exec::ranks::RankError;
use diptych::exec::{BuildError, ExecError};
use diptych::graph::StripesError;
use diptych::image::ImageError;
use diptych::loaded::LoadError;
use diptych::scene::SceneError;
use diptych::session::CalibrationError;
use diptych::trace::TraceError;

use super::{hints, signals};

/// A command's failure: in the user's input, or in the run itself.
pub enum Failure {
    Input(anyhow::Error),
    Run(anyhow::Error),
    /// Interrupted by a signal, such as Ctrl-C.
    Interrupted,
}

impl Failure {
    /// Formats the error on one line and each cause on a further line. Each is followed by the options that remedy it.
    fn message(&self) -> String {
        let (Self::Input(error) | Self::Run(error)) = self else { return "interrupted".to_owned() };
        let begins = std::iter::once("error").chain(std::iter::repeat("  because"));
        let lines = begins.zip(error.chain()).map(|(begin, error)| format!("{begin}: {}", hints::with_options(error)));
        lines.collect::<Vec<_>>().join("\n")
    }

    /// Formats the error and its causes on a single line, without the prefix `error:`.
    pub fn line(&self) -> String {
        let (Self::Input(error) | Self::Run(error)) = self else { return "interrupted".to_owned() };
        let texts: Vec<_> = error.chain().map(hints::with_options).collect();
        texts.join(": ").replace('\n', " ")
    }

    /// Prints the failure and returns the exit status.
    pub fn tell(&self) -> u8 {
        log!("{}", self.message());
        match self {
            Self::Input(_) => 2,
            Self::Run(_) => 1,
            Self::Interrupted => signals::exit_status(),
        }
    }
}

/// Converts types of errors to failures: `TYPE { PATTERN => FAILURE }`.
macro_rules! failures {
    ($($error:ty { $($pattern:pat => $failure:expr),+ $(,)? })+) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                match error {
                    $($pattern => $failure),+
                }
            }
        })+
    };
}

failures! {
    // Errors count as failures of the run, unless they are classified here as input errors.
    anyhow::Error { error => Self::Run(error) }
    SceneError { error => Self::Input(error.into()) }
    AccelError { error => Self::Input(error.into()) }
    LoadError { error => Self::Input(error.into()) }
    StripesError { error => Self::Input(error.into()) }
    RankError { error => Self::Run(error.into()) }
    ImageError { error => Self::Run(error.into()) }
    BuildError {
        BuildError::Device(error) => error.into(),
        BuildError::Exec(error) => error.into(),
        error => Self::Input(error.into()),
    }
    DeviceError {
        error @ (DeviceError::UnknownAdapter { .. }
        | DeviceError::NoRayQueries { .. }
        | DeviceError::TooMany(_)
        | DeviceError::ThreadCounts { .. }) => Self::Input(error.into()),
        error => Self::Run(error.into()),
    }
    ExecError {
        ExecError::Setting(error) => Self::Input(error.into()),
        ExecError::Stopped => Self::Interrupted,
        error => Self::Run(error.into()),
    }
    DenoiseError {
        error @ (DenoiseError::Setting(_) | DenoiseError::Given(_)) => Self::Input(error.into()),
        DenoiseError::Open(error) => error.into(),
        error => Self::Run(error.into()),
    }
    CalibrationError {
        CalibrationError::Exec(error) => error.into(),
        CalibrationError::Stopped => Self::Interrupted,
        error => Self::Run(error.into()),
    }
    // A checkpoint that cannot be written fails the run; one that cannot be used is an input error.
    CheckpointError {
        CheckpointError::Write(error) => Self::Run(error.into()),
        error => Self::Input(error.into()),
    }
    AccumulateError {
        AccumulateError::Exec(error) => error.into(),
        AccumulateError::Checkpoint(error) => error.into(),
    }
    // Errors in a trace file are input errors, except in the trace that a run writes.
    TraceError {
        error @ (TraceError::Write(_) | TraceError::SubscriberTaken) => Self::Run(error.into()),
        error => Self::Input(error.into()),
    }
}

#[cfg(feature = "xr")]
failures! {
    diptych::headset::HeadsetError { error => Self::Run(error.into()) }
}

#[cfg(test)]
mod tests {
    use anyhow::Context;

    use super::*;
    use diptych::image::Extent;

    #[test]
    fn options_follow_the_cause_that_they_remedy() {
        let (first, second) = (Extent::new(1, 2), Extent::new(3, 4));
        let failed: Result<(), _> = Err(ImageError::SizeMismatch { first, second });
        let failure = Failure::Input(failed.context("cannot compare them").unwrap_err());
        let cause =
            "the images differ in size, 1x2 and 3x4: check that both were rendered at the same size (render --size)";
        assert_eq!(failure.message(), format!("error: cannot compare them\n  because: {cause}"));
        assert_eq!(failure.line(), format!("cannot compare them: {cause}"));
    }
}
