//! Options that remedy errors of the library, whose messages name no options.

use std::error::Error;

use diptych::accel::AccelError;
use diptych::device::DeviceError;
use diptych::exec::ranks::{DeviceMismatch, RankError};
use diptych::exec::{BuildError, ExecError};
#[cfg(feature = "xr")]
use diptych::headset::HeadsetError;
use diptych::image::ImageError;
use diptych::loaded::LoadError;
use diptych::scene::{Refusal, SceneError, Setting};
use diptych::stages::StageError;
use diptych::tables::{LimitExceeded, Remedy, TableError};
use diptych::trace::TraceError;

/// Formats an error without its causes, followed by the options that remedy it, if there are any.
pub fn with_options(error: &(dyn Error + 'static)) -> String {
    options(error).map_or_else(|| error.to_string(), |options| format!("{error} ({options})"))
}

/// Evaluates to the value of the first pattern that an error matches, as `TYPE { PATTERN => VALUE }`; `None` without a
/// match.
macro_rules! find {
    ($error:expr, $($type:ty { $($pattern:pat => $value:expr),+ $(,)? })+) => {
        'found: {
            $(match $error.downcast_ref::<$type>() {
                $(Some($pattern) => break 'found Some($value),)+
                _ => {}
            })+
            None
        }
    };
}

fn options(error: &(dyn Error + 'static)) -> Option<&'static str> {
    if let Some(inner) = inner(error) {
        return options(inner);
    }
    find! {
        error,
        SceneError {
            SceneError::Refused { refusal: Refusal::Outside(_), .. } => "--set allow_outside=on",
            SceneError::Refused { refusal: Refusal::Memory(_), .. } => MEMORY,
            SceneError::Setting { setting: Setting::Baseline, .. } => "--set baseline=M",
            SceneError::Setting { setting: Setting::Camera(_), .. } => "--set camera=N",
            SceneError::Setting { setting: Setting::View, .. } => "--set position=X,Y,Z, --set target=X,Y,Z",
        }
        AccelError { AccelError::Memory { .. } => MEMORY }
        TableError { TableError::Memory(_) => MEMORY }
        LimitExceeded { error => of_limit(error.remedy()) }
        DeviceError {
            DeviceError::NoRayQueries { .. } => TRAVERSAL_OR_ADAPTER,
            DeviceError::Lacks { .. } => ADAPTER,
        }
        RankError {
            RankError::Devices { mismatch: DeviceMismatch::Traversal { .. }, .. } => "--set traversal=NAME",
        }
        ImageError { ImageError::SizeMismatch { .. } => "render --size" }
        TraceError { TraceError::NoFrames { .. } => "render --trace" }
    }
}

/// Option that chooses another adapter.
pub const ADAPTER: &str = "--set devices=N";
const MEMORY: &str = "--set max_scene_memory=SIZE";
const TRAVERSAL_OR_ADAPTER: &str = "--set traversal=compute, --set devices=N";

/// Returns the inner error of a `#[error(transparent)]` variant. Such a variant returns the cause of the inner error as
/// its own, so the chain of causes never contains the inner error.
fn inner<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a (dyn Error + 'static)> {
    let found: Option<&(dyn Error + 'static)> = find! {
        error,
        LoadError {
            LoadError::Scene(error) => error,
            LoadError::Accel(error) => error,
            LoadError::Tables(error) => error,
        }
        BuildError {
            BuildError::Device(error) => error,
            BuildError::Exec(error) => error,
        }
        ExecError {
            ExecError::Setting(error) => error,
            ExecError::Stage(error) => error,
            ExecError::Rank(error) => error,
        }
        StageError { StageError::Limit(error) => error }
    };
    #[cfg(feature = "xr")]
    let found = found.or_else(|| find! { error, HeadsetError { HeadsetError::Device(error) => error } });
    found
}

fn of_limit(remedy: Remedy) -> &'static str {
    match remedy {
        Remedy::SmallerSize => "--size, --set devices=N",
        Remedy::ComputeTraversal => TRAVERSAL_OR_ADAPTER,
        Remedy::FewerTriangles | Remedy::SmallerTextures | Remedy::SmallerEnvironment | Remedy::SmallerPass => ADAPTER,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::scene::budget::{Budget, ByteSize};

    fn outside() -> SceneError {
        SceneError::Refused { path: "a.toml".into(), place: String::new(), refusal: Refusal::Outside("../b".into()) }
    }

    #[test]
    fn options_follow_the_message_of_their_error() {
        let text = with_options(&outside());
        assert!(
            text.starts_with("'a.toml' is refused: ") && text.ends_with(" if you trust it (--set allow_outside=on)"),
            "{text}"
        );
        let plain = SceneError::UnknownBuiltin { name: "a".into(), known: "b".into() };
        assert_eq!(with_options(&plain), plain.to_string());
    }

    #[test]
    fn errors_within_transparent_ones_have_their_options() {
        let exceeded = Budget::new(ByteSize(1)).reserve(2).unwrap_err();
        let refused = SceneError::Refused { path: String::new(), place: String::new(), refusal: exceeded.into() };
        let mismatch = DeviceMismatch::Traversal { its: Default::default(), first: Default::default() };
        let rank = RankError::Devices { rank: 1, host: String::new(), mismatch };
        let no_queries = DeviceError::NoRayQueries { index: 0, name: String::new(), driver: String::new() };
        let errors: [(&(dyn Error + 'static), _); 6] = [
            (&LoadError::Scene(outside()), "--set allow_outside=on"),
            (&LoadError::Scene(refused), MEMORY),
            (&LoadError::Accel(AccelError::Memory { triangles: 1, exceeded }), MEMORY),
            (&LoadError::Tables(TableError::Memory(exceeded)), MEMORY),
            (&BuildError::Device(no_queries), TRAVERSAL_OR_ADAPTER),
            (&BuildError::Exec(ExecError::Rank(rank)), "--set traversal=NAME"),
        ];
        for (error, expected) in errors {
            assert_eq!(options(error), Some(expected), "{error}");
        }
    }
}
