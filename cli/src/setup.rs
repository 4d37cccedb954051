//! Builds a renderer from options: scene, BVH, devices and policy.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::anyhow;
use diptych::device::{self, DeviceError, GpuDevice, Selection, Traversal, TraversalChoice, Wanted};
use diptych::exec::ranks::{Devices, Load, Loading, Recorded, Request};
use diptych::exec::{FrameReport, Renderer};
use diptych::frame::RunConfig;
use diptych::frame::settings::Settings;
use diptych::image::Extent;
use diptych::loaded::LoadedScene;
use diptych::passes::Display;
use diptych::quality::Quality;
use diptych::scene::complete::Look;
use diptych::scene::folder::Source;
use diptych::scene::head::HeadMotion;
use diptych::scene::rig::Rig;
use diptych::scene::{Scene, SceneError};
use diptych::schedule::Policy;
use diptych::trace::frames::{FrameControl, record_frame};
use diptych::trace::{Recorder, TraceFile};

use super::failure::Failure;
use super::interrupt::INTERRUPTED;
use super::options::{RenderOptions, RunOptions};
use super::registry::registered;
use super::scene_loading::{budget, load_from, tree_cache};
use super::{console, disturbances, node};

/// Prints the warnings of the scene's file, and notes on what was chosen for it.
pub fn tell_remarks(scene: &Scene) {
    scene.warnings.iter().for_each(|warning| log!("warning: {warning}"));
    scene.notes.iter().for_each(|note| log!("note: {note}"));
}

/// Loads the scene on all ranks, and head motion on this one.
pub fn load(options: &RunOptions) -> Result<LoadedScene, Failure> {
    let loaded = load_rig(options)?;
    check_eyes(&loaded.shot.rig)?;
    Ok(loaded)
}

/// Refuses a rig without exactly two views.
pub fn check_eyes(rig: &Rig) -> Result<(), Failure> {
    let what = "this takes two views; `render`, `scale` and `graph` take any number: the shot has";
    if rig.views == 2 { Ok(()) } else { Err(Failure::Input(anyhow!("{what} {}", rig.views))) }
}

/// Loads the scene, whose rig may have any number of views.
pub fn load_rig(options: &RunOptions) -> Result<LoadedScene, Failure> {
    let mut loaded = load_scene(options)?;
    if let Some(path) = &options.settings.motion {
        if let Some(what) = not_motion(path) {
            return Err(Failure::Input(anyhow!("motion {}: {what}", path.display())));
        }
        let motion = HeadMotion::read(path, &budget(&options.settings))?;
        let invalid = |what| SceneError::Invalid { path: path.display().to_string(), what };
        loaded.follow(&motion, options.settings.size).map_err(invalid)?;
    }
    Ok(loaded)
}

/// Returns a message if a file that should hold head motion is a shot or a scene by its name.
fn not_motion(path: &Path) -> Option<&'static str> {
    match path.extension()?.to_ascii_lowercase().to_str()? {
        "toml" => Some("this is a shot: give it in place of the scene; motion takes a recording of `play` or `view`"),
        "gltf" | "glb" => Some("this is a scene; motion takes a recording of `play` or `view`"),
        _ => None,
    }
}

/// Loads the scene on all ranks, without head motion, which only rank 0 needs.
fn load_scene(options: &RunOptions) -> Result<LoadedScene, Failure> {
    let what = Load { shot: options.shot.clone(), time_s: options.settings.time, files: None };
    let Some(node) = node::others() else { return load_here(options, &what, Source::Disk) };
    if !options.broadcasts_scene() {
        let loading = Loading::begin(node, what.clone());
        let loaded = load_here(options, &what, Source::Disk)?;
        loading.check(&loaded.tables)?;
        return Ok(loaded);
    }
    let kept = Mutex::default();
    let loaded = load_here(options, &what, Source::Kept(&kept))?;
    let files = kept.into_inner().unwrap_or_else(PoisonError::into_inner);
    let bytes: usize = files.values().map(Vec::len).sum();
    if bytes > MOST_SENT_BYTES {
        let what =
            format!("--broadcast-scene: the scene files have {bytes} bytes; at most {MOST_SENT_BYTES} can be sent");
        return Err(Failure::Input(anyhow::anyhow!(what)));
    }
    Loading::begin(node, Load { files: Some(files), ..what }).check(&loaded.tables)?;
    Ok(loaded)
}

/// Maximum bytes of scene files in an MPI message, which leaves room for their names.
const MOST_SENT_BYTES: usize = i32::MAX as usize - (1 << 20);

/// Loads a scene in this process, without head motion.
pub fn load_here(options: &RunOptions, what: &Load, source: Source) -> Result<LoadedScene, Failure> {
    let _span = tracing::info_span!("load scene").entered();
    let budget = budget(&options.settings);
    let (shot, scene) = load_from(&options.settings, source, (&what.shot, Look::Studio), what.time_s, &budget)?;
    Ok(LoadedScene::new(shot, scene, &budget, &tree_cache(&options.settings))?)
}

/// Loads a scene in this process, for the defaults of all but these settings.
pub fn load_alone(shot: &str, settings: &Settings) -> Result<LoadedScene, Failure> {
    let budget = budget(settings);
    let (shot, scene) = load_from(settings, Source::Disk, (shot, Look::Studio), settings.time, &budget)?;
    tell_remarks(&scene);
    Ok(LoadedScene::new(shot, scene, &budget, &tree_cache(settings))?)
}

/// Returns a warning if frames between these times lie beyond the ends of the camera's path.
pub fn beyond_path(rig: &Rig, from_s: f64, to_s: f64) -> Option<String> {
    let [first, .., last] = &rig.keys[..] else { return None };
    if to_s > last.time_s {
        return Some(format!("the camera's path ends at {} s, and its last key is held to {to_s} s", last.time_s));
    }
    let begins =
        || format!("the camera's path begins at {} s, and its first key is held from {from_s} s", first.time_s);
    (from_s < first.time_s).then(begins)
}

fn selection(options: &RunOptions, virtual_devices: usize) -> Selection {
    let settings = &options.settings;
    let threads = &settings.threads_per_device;
    Selection {
        adapters: (!settings.devices.is_empty()).then(|| settings.devices.clone()),
        virtual_devices,
        most_virtual_devices: usize::from(options.most_virtual_devices),
        threads_per_device: (!threads.is_empty()).then(|| threads.iter().copied().map(usize::from).collect()),
        traversal: options.settings.traversal,
        pool: console::devices(),
    }
}

/// Returns the ray traversal of the devices that the options request.
pub fn traversal(options: &RunOptions) -> Result<Traversal, Failure> {
    Ok(device::chosen_traversal(&selection(options, 1))?)
}

/// Opens devices on all ranks, `virtual_devices` on each adapter.
pub fn open_devices(options: &RunOptions, virtual_devices: usize) -> Result<Devices, Failure> {
    open_devices_with(options, virtual_devices, |_| Ok(None))
}

/// Opens devices like [`open_devices`], except that `first` may open the first device of this process itself.
pub fn open_devices_with(
    options: &RunOptions,
    virtual_devices: usize,
    first: impl FnOnce(&Wanted<'_>) -> Result<Option<GpuDevice>, DeviceError>,
) -> Result<Devices, Failure> {
    let opening = node::others().map(|node| Devices::open(node, virtual_devices));
    let _span = tracing::info_span!("open devices").entered();
    let own = device::open_with(&selection(options, virtual_devices), first)?;
    match opening {
        None => Ok(own.into()),
        Some(opening) => Ok(opening.with(own)?),
    }
}

/// Opens devices in this process.
pub fn open_here(options: &RunOptions, virtual_devices: usize) -> Result<Vec<GpuDevice>, Failure> {
    let _span = tracing::info_span!("open devices").entered();
    Ok(device::open(&selection(options, virtual_devices))?)
}

/// Creates the policy that the options request, for traced images of this size.
pub fn policy(options: &RunOptions, grid: Extent, devices: usize) -> Result<Box<dyn Policy>, Failure> {
    Ok(options.settings.policy().policy(grid.height, devices, &options.settings.ratios)?)
}

pub fn renderer(
    options: &RenderOptions,
    loaded: &LoadedScene,
    gpus: Devices,
    origin: Instant,
) -> Result<Renderer, Failure> {
    renderer_with(options, loaded, gpus, origin, |grid, devices| policy(options, grid, devices))
}

/// Creates a renderer like [`renderer`] with another policy, which `policy` makes for traced images of a size
/// and a number of devices.
pub fn renderer_with(
    options: &RenderOptions,
    loaded: &LoadedScene,
    gpus: Devices,
    origin: Instant,
    policy: impl FnOnce(Extent, usize) -> Result<Box<dyn Policy>, Failure>,
) -> Result<Renderer, Failure> {
    let injected = disturbances::injected(&options.settings, gpus.len())?;
    let config = config(options, loaded)?;
    let policy = policy(config.grid(), gpus.len())?;
    let _span = tracing::info_span!("start renderer").entered();
    let builder = Renderer::builder(loaded).config(config).policy(|_, _| policy);
    let mut renderer = builder.on(gpus).origin(origin).stop(Arc::clone(&INTERRUPTED)).build()?;
    renderer.set_injected_faults(injected);
    if let Some(ms) = options.settings.watchdog_ms {
        renderer.set_watchdog(Duration::from_millis(ms.into()));
    }
    Ok(renderer)
}

/// Returns the configuration of all frames.
pub fn config(options: &RenderOptions, loaded: &LoadedScene) -> Result<RunConfig, Failure> {
    let config = RunConfig::for_envelope(loaded, options.settings.size, options.envelope);
    let mut config = config.map_err(|what| Failure::Input(anyhow!("{what}")))?;
    config.apply(&options.settings);
    let buffers = &mut config.buffers;
    if !options.settings.skip_unused {
        buffers.needs = loaded.needs.widened();
    }
    if let Display::Resampled { is_late, .. } = &mut buffers.display {
        *is_late = options.is_late;
    }
    buffers.aovs.clone_from(&options.aovs);
    buffers.declarations = registered().clone();
    // A renderer replaces this with the traversal of its devices. `diptych graph` has no devices and uses the requested
    // one.
    if let Some(moving) = &mut buffers.moving {
        moving.hardware = options.settings.traversal == TraversalChoice::Hardware;
    }
    if let Some(gaze) = &options.gaze {
        config.gaze.clone_from(gaze);
    }
    Ok(config)
}

/// Trace file of a run, and its recorder.
pub struct Tracing {
    file: Option<TraceFile>,
    pub recorder: Recorder,
}

impl Tracing {
    /// Starts the trace file, if requested. Other ranks then record too.
    pub fn start(options: &RunOptions) -> Result<Self, Failure> {
        let file = options.trace.as_deref().map(TraceFile::start).transpose()?;
        if let Some(node) = node::others().filter(|_| file.is_some()) {
            node.ask(&Request::Record).wait()?;
        }
        let recorder = file.as_ref().map_or_else(Recorder::off, TraceFile::recorder);
        Ok(Self { file, recorder })
    }

    pub fn record(&self, quality: &Quality, control: Option<&FrameControl>, frame: &FrameReport) {
        self.take_recorded();
        record_frame(&self.recorder, frame, quality, control);
    }

    /// Adds the events that other ranks have recorded to the trace.
    fn take_recorded(&self) {
        let Some(node) = node::others().filter(|_| self.recorder.is_on()) else { return };
        let epoch_us = self.recorder.time_us(node.epoch());
        for Recorded { rank, zero_ms, residual_us, text } in node.recorded() {
            self.recorder.rank_host(rank as u32, &node.host(rank), epoch_us + zero_ms * 1e3, &text);
            if let Some(residual_us) = residual_us {
                self.recorder.note_residual(&format!("rank_{rank}"), residual_us);
            }
        }
    }

    pub fn finish(self) -> Result<(), Failure> {
        if let Some(node) = node::others().filter(|_| self.file.is_some()) {
            node.ask(&Request::Recorded).wait()?;
            self.take_recorded();
        }
        Ok(self.file.map_or(Ok(()), TraceFile::finish)?)
    }
}
