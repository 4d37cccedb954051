//! Options that remedy errors of the library, whose messages name no options.

use std::error::Error;

use diptych::accel::AccelError;
use diptych::device::DeviceError;
use diptych::exec::ranks::{DeviceMismatch, RankError};
use diptych::exec::{BuildError, ExecError};
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

fn options(error: &(dyn Error + 'static)) -> Option<&'static str> {
    if let Some(inner) = inner(error) {
        return options(inner);
    }
    if let Some(error) = error.downcast_ref::<SceneError>() {
        return of_scene(error);
    }
    if let Some(AccelError::Memory { .. }) = error.downcast_ref::<AccelError>() {
        return Some(MEMORY);
    }
    if let Some(TableError::Memory(_)) = error.downcast_ref::<TableError>() {
        return Some(MEMORY);
    }
    if let Some(error) = error.downcast_ref::<LimitExceeded>() {
        return Some(of_limit(error.remedy()));
    }
    match error.downcast_ref::<DeviceError>() {
        Some(DeviceError::NoRayQueries { .. }) => return Some(TRAVERSAL_OR_ADAPTER),
        Some(DeviceError::Lacks { .. }) => return Some(ADAPTER),
        _ => {}
    }
    if let Some(RankError::Devices { mismatch: DeviceMismatch::Traversal { .. }, .. }) =
        error.downcast_ref::<RankError>()
    {
        return Some("--set traversal=NAME");
    }
    if let Some(ImageError::SizeMismatch { .. }) = error.downcast_ref::<ImageError>() {
        return Some("render --size");
    }
    if let Some(TraceError::NoFrames { .. }) = error.downcast_ref::<TraceError>() {
        return Some("render --trace");
    }
    None
}

/// Option that chooses another adapter.
pub const ADAPTER: &str = "--devices";
const MEMORY: &str = "--set max_scene_memory=SIZE";
const TRAVERSAL_OR_ADAPTER: &str = "--set traversal=compute, --devices";

/// Returns the inner error of a `#[error(transparent)]` variant. Such a variant returns the cause of the inner error as
/// its own, so the chain of causes never contains the inner error.
fn inner<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a (dyn Error + 'static)> {
    match error.downcast_ref::<LoadError>() {
        Some(LoadError::Scene(error)) => return Some(error),
        Some(LoadError::Accel(error)) => return Some(error),
        Some(LoadError::Tables(error)) => return Some(error),
        _ => {}
    }
    match error.downcast_ref::<BuildError>() {
        Some(BuildError::Device(error)) => return Some(error),
        Some(BuildError::Exec(error)) => return Some(error),
        _ => {}
    }
    match error.downcast_ref::<ExecError>() {
        Some(ExecError::Setting(error)) => return Some(error),
        Some(ExecError::Stage(error)) => return Some(error),
        Some(ExecError::Rank(error)) => return Some(error),
        _ => {}
    }
    if let Some(StageError::Limit(error)) = error.downcast_ref::<StageError>() {
        return Some(error);
    }
    #[cfg(feature = "xr")]
    if let Some(diptych::headset::HeadsetError::Device(error)) = error.downcast_ref::<diptych::headset::HeadsetError>()
    {
        return Some(error);
    }
    None
}

fn of_scene(error: &SceneError) -> Option<&'static str> {
    match error {
        SceneError::Refused { refusal: Refusal::Outside(_), .. } => Some("--set allow_outside=on"),
        SceneError::Refused { refusal: Refusal::Memory(_), .. } => Some(MEMORY),
        SceneError::Setting { setting: Setting::Baseline, .. } => Some("--set baseline=M"),
        SceneError::Setting { setting: Setting::Camera(_), .. } => Some("--set camera=N"),
        SceneError::Setting { setting: Setting::View, .. } => Some("--set position=X,Y,Z, --set target=X,Y,Z"),
        _ => None,
    }
}

fn of_limit(remedy: Remedy) -> &'static str {
    match remedy {
        Remedy::SmallerSize => "--size, --devices",
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
