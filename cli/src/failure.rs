//! Failures of commands, and their exit statuses.

use diptych::accel::AccelError;
use diptych::accumulation::{AccumulateError, CheckpointError};
use diptych::device::DeviceError;
use diptych::exec::{BuildError, ExecError};
use diptych::graph::StripesError;
use diptych::image::ImageError;
use diptych::loaded::LoadError;
use diptych::scene::SceneError;
use diptych::session::CalibrationError;

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
    pub fn message(&self) -> String {
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

    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Run(_) => 1,
            Self::Interrupted => signals::exit_status(),
        }
    }
}

/// Errors count as failures of the run, unless the conversions below classify them as input errors.
impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Self::Run(error)
    }
}

macro_rules! input_errors {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::Input(error.into())
            }
        })*
    };
}

input_errors!(SceneError, AccelError, LoadError, StripesError);

impl From<BuildError> for Failure {
    fn from(error: BuildError) -> Self {
        match error {
            BuildError::Device(error) => error.into(),
            BuildError::Exec(error) => error.into(),
            error => Self::Input(error.into()),
        }
    }
}

impl From<DeviceError> for Failure {
    fn from(error: DeviceError) -> Self {
        match error {
            DeviceError::UnknownAdapter { .. }
            | DeviceError::NoRayQueries { .. }
            | DeviceError::TooMany(_)
            | DeviceError::ThreadCounts { .. } => Self::Input(error.into()),
            _ => Self::Run(error.into()),
        }
    }
}

impl From<ExecError> for Failure {
    fn from(error: ExecError) -> Self {
        match error {
            ExecError::Setting(error) => Self::Input(error.into()),
            error => Self::Run(error.into()),
        }
    }
}

impl From<CalibrationError> for Failure {
    fn from(error: CalibrationError) -> Self {
        match error {
            CalibrationError::Exec(error) => error.into(),
            CalibrationError::Stopped => Self::Interrupted,
            error => Self::Run(error.into()),
        }
    }
}

#[cfg(feature = "xr")]
impl From<diptych::headset::HeadsetError> for Failure {
    fn from(error: diptych::headset::HeadsetError) -> Self {
        Self::Run(error.into())
    }
}

impl From<diptych::exec::ranks::RankError> for Failure {
    fn from(error: diptych::exec::ranks::RankError) -> Self {
        Self::Run(error.into())
    }
}

impl From<ImageError> for Failure {
    fn from(error: ImageError) -> Self {
        Self::Run(error.into())
    }
}

/// A checkpoint that cannot be written fails the run; one that cannot be used is an input error.
impl From<CheckpointError> for Failure {
    fn from(error: CheckpointError) -> Self {
        match error {
            CheckpointError::Write(_) => Self::Run(error.into()),
            _ => Self::Input(error.into()),
        }
    }
}

impl From<AccumulateError> for Failure {
    fn from(error: AccumulateError) -> Self {
        match error {
            AccumulateError::Exec(error) => error.into(),
            AccumulateError::Checkpoint(error) => error.into(),
        }
    }
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
