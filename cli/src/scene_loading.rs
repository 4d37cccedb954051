//! Loading of scenes with the settings of a command line.

use etcetera::BaseStrategy;
use sysinfo::{MemoryRefreshKind, RefreshKind, System};

use super::units;
use diptych::accel::TreeCache;
use diptych::frame::settings::Settings;
use diptych::scene::budget::{Budget, ByteSize};
use diptych::scene::complete::Look;
use diptych::scene::folder::{Access, Source};
use diptych::scene::load::load_shot_within;
use diptych::scene::shot::Shot;
use diptych::scene::{Scene, SceneError};

/// Returns the memory that a scene may take.
pub fn budget(settings: &Settings) -> Budget {
    Budget::new(settings.max_scene_memory.unwrap_or_else(|| ByteSize(host_memory() / 2)))
}

/// Returns the cache of trees. There is none without a folder for caches.
pub fn tree_cache(settings: &Settings) -> TreeCache {
    let usual = || etcetera::choose_base_strategy().ok().map(|base| base.cache_dir().join("diptych"));
    match &settings.scene_cache {
        Some(folder) if folder.as_os_str() == "off" => TreeCache::off(),
        Some(folder) => TreeCache::in_folder(folder.clone()),
        None => usual().map_or_else(TreeCache::off, TreeCache::in_folder),
    }
}

/// Loads a shot and its scene for other programs. The path of an animated camera begins at the settings' time.
pub fn load(settings: &Settings, shot: &str) -> Result<(Shot, Scene), SceneError> {
    load_from(settings, Source::Disk, (shot, Look::Plain), settings.time, &budget(settings))
}

/// Loads a shot and its scene from another source of files.
pub fn load_from(
    settings: &Settings,
    source: Source,
    (shot, look): (&str, Look),
    time_s: f64,
    budget: &Budget,
) -> Result<(Shot, Scene), SceneError> {
    let Settings { allow_outside, strict, .. } = *settings;
    let access = Access { budget, allow_outside, strict, source };
    let (shot, mut scene) = load_shot_within(shot, &settings.overrides(look, time_s), access)?;
    scene.warnings.extend(units::warning(settings, &shot.rig, &scene));
    Ok((shot, scene))
}

/// Returns the memory of this machine, or of the container if that has less, in bytes.
pub fn host_memory() -> u64 {
    /// Default if the system reports none, in bytes.
    const UNKNOWN: u64 = 8 << 30;
    let ram = RefreshKind::nothing().with_memory(MemoryRefreshKind::nothing().with_ram());
    let system = System::new_with_specifics(ram);
    let container = system.cgroup_limits().map_or(u64::MAX, |limits| limits.total_memory);
    match system.total_memory().min(container) {
        0 => UNKNOWN,
        bytes => bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn host_memory_is_plausible() {
        assert!((1 << 27..1 << 51).contains(&host_memory()), "{}", host_memory());
    }
}
