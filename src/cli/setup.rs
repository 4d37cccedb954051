//! From options to a renderer: scene, tree, devices, policy.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::anyhow;
use diptych::accel::{Accel, Layout};
use diptych::device::{self, DeviceError, GpuDevice, Selection, Traversal, TraversalChoice, Wanted};
use diptych::exec::ranks::{Devices, Load, Loading, Recorded, Request};
use diptych::exec::{FrameReport, RenderSettings, Renderer};
use diptych::image::Extent;
use diptych::passes::Moving;
use diptych::quality::Quality;
use diptych::scene::folder::Source;
use diptych::scene::head::{HeadMotion, Space};
use diptych::scene::needs::SceneNeeds;
use diptych::scene::optics::Optics;
use diptych::scene::rig::Rig;
use diptych::scene::shot::{Gaze, Shot};
use diptych::scene::{Scene, SceneError};
use diptych::schedule::{Even, Heft, Measured, Policy, Static};
use diptych::stages::{SceneTables, StageSettings};
use diptych::trace::frames::{FrameControl, record_frame};
use diptych::trace::{Recorder, TraceFile};

use super::failure::Failure;
use super::options::{Balance, HaloOption, RenderOptions, RunOptions};
use super::ranks;

/// A scene ready to be put on devices.
pub struct Loaded {
    /// With the head motion that was asked for.
    pub shot: Shot,
    /// Where the left and the right eye look: the shot's, or that of the head motion.
    pub gaze: [Gaze; 2],
    /// What head motion is relative to.
    pub space: Space,
    /// As it moves.
    pub scene: Scene,
    pub needs: SceneNeeds,
    pub tables: Arc<SceneTables>,
}

impl Loaded {
    /// The scene at one time, with nothing that moves.
    pub fn at(&self, time_s: f64) -> Cow<'_, Scene> {
        if self.scene.motion.is_empty() { Cow::Borrowed(&self.scene) } else { Cow::Owned(self.scene.at(time_s)) }
    }

    /// The shot's exposure as its file says it: -0.9, where the nearest f32 is -0.8999999761581421.
    pub fn exposure_ev(&self) -> f64 {
        let ev = self.shot.exposure_ev;
        ev.to_string().parse().unwrap_or(f64::from(ev))
    }
}

/// Loads the scene, on all ranks.
pub fn load(options: &RunOptions) -> Result<Loaded, Failure> {
    let mut loaded = load_scene(options)?;
    if let Some(path) = &options.motion {
        let motion = HeadMotion::read(path, &options.scene.budget())?;
        let invalid = |what| SceneError::Invalid { path: path.display().to_string(), what };
        loaded.space = motion.space(&loaded.shot.rig).map_err(invalid)?;
        loaded.shot.rig = motion.rig(&loaded.shot.rig).map_err(invalid)?.plain_at(options.size);
        loaded.gaze = motion.gaze().unwrap_or(loaded.gaze);
        loaded.shot.gaze = loaded.gaze[0].clone();
    }
    Ok(loaded)
}

/// Without head motion, which rank 0 alone has to know.
fn load_scene(options: &RunOptions) -> Result<Loaded, Failure> {
    let what = Load { shot: options.shot.clone(), time_s: options.time, files: None };
    let Some(node) = ranks::others() else { return load_here(options, &what, Source::Disk) };
    if !options.broadcasts_scene() {
        let loading = Loading::begin(node, &what);
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
            format!("--broadcast-scene: its files have {bytes} bytes, of at most {MOST_SENT_BYTES} that are sent");
        return Err(Failure::Input(anyhow::anyhow!(what)));
    }
    Loading::begin(node, &Load { files: Some(files), ..what }).check(&loaded.tables)?;
    Ok(loaded)
}

/// What one message of MPI holds, with room for names.
const MOST_SENT_BYTES: usize = i32::MAX as usize - (1 << 20);

/// Loads a scene in this process, without head motion.
pub fn load_here(options: &RunOptions, what: &Load, source: Source) -> Result<Loaded, Failure> {
    let _span = tracing::info_span!("load scene").entered();
    let budget = options.scene.budget();
    let (shot, scene) = options.scene.load_from(source, &what.shot, what.time_s, &budget)?;
    let space = Space::of(&shot.rig);
    let accel = {
        let _span = tracing::info_span!("build tree").entered();
        Accel::build_within(&scene, Layout::Auto, &budget)?
    };
    let tables = SceneTables::within(&scene, accel, &budget).map_err(|e| Failure::Input(e.into()))?;
    let needs = SceneNeeds { instances: tables.has_instances(), ..SceneNeeds::of(&scene) };
    let gaze = [shot.gaze.clone(), shot.gaze.clone()];
    Ok(Loaded { shot, gaze, space, scene, needs, tables: Arc::new(tables) })
}

/// Says where frames between these times are beyond the ends of the camera's path.
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
    Selection {
        adapters: options.devices.clone(),
        virtual_devices,
        threads_per_device: options.threads_per_device.as_ref().map(|t| t.iter().copied().map(usize::from).collect()),
        traversal: options.traversal,
    }
}

/// How the devices that the options ask for follow rays.
pub fn traversal(options: &RunOptions) -> Result<Traversal, Failure> {
    Ok(device::chosen_traversal(&selection(options, 1))?)
}

/// Opens devices on all ranks, so many on each adapter.
pub fn open_devices(options: &RunOptions, virtual_devices: usize) -> Result<Devices, Failure> {
    open_devices_with(options, virtual_devices, |_| Ok(None))
}

/// [`open_devices`], but for the first, if `first` has one for it.
pub fn open_devices_with(
    options: &RunOptions,
    virtual_devices: usize,
    first: impl FnOnce(&Wanted<'_>) -> Result<Option<GpuDevice>, DeviceError>,
) -> Result<Devices, Failure> {
    let opening = ranks::others().map(|node| Devices::open(node, virtual_devices));
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

/// The policy that the options ask for, of traced images of this size.
pub fn policy(options: &RenderOptions, grid: Extent, devices: usize) -> Result<Box<dyn Policy>, Failure> {
    let height = grid.height;
    Ok(match options.balance() {
        Balance::Even => Box::new(Even::new(height, devices)),
        Balance::Static => Box::new(Static::new(height, devices, &options.ratios)?),
        Balance::Measured => Box::new(Measured::new(height, devices)),
        Balance::Heft => Box::new(Heft::new(height, devices)),
    })
}

pub fn renderer(options: &RenderOptions, loaded: &Loaded, gpus: Devices, origin: Instant) -> Result<Renderer, Failure> {
    varying_renderer(options, loaded, gpus, origin, false)
}

/// A renderer of frames that have at most the options' samples and iterations; `mixes_spp`: some have one sample, others
/// several.
pub fn varying_renderer(
    options: &RenderOptions,
    loaded: &Loaded,
    gpus: Devices,
    origin: Instant,
    mixes_spp: bool,
) -> Result<Renderer, Failure> {
    let injected = options.faults.injected(gpus.len())?;
    let settings = render_settings(options, loaded, mixes_spp)?;
    let policy = policy(options, settings.stages.grid(), gpus.len())?;
    let _span = tracing::info_span!("start renderer").entered();
    let mut renderer = Renderer::new(gpus, Arc::clone(&loaded.tables), settings, policy, origin)?;
    renderer.set_injected_faults(injected);
    if let Some(limit) = options.faults.watchdog() {
        renderer.set_watchdog(limit);
    }
    Ok(renderer)
}

/// Pixels of rectified frames over those of the eyes, along each axis, where these look straight ahead.
const DENSITY: f64 = 1.25;

/// Columns and rows of the rectified images of these eyes, for images of this size that they show.
pub fn rectified(optics: &Optics, size: Extent) -> Result<Extent, Failure> {
    optics.grid(size, DENSITY).map_err(|what| Failure::Input(anyhow!("{what}")))
}

/// What the options ask of all frames.
pub fn render_settings(options: &RenderOptions, loaded: &Loaded, mixes_spp: bool) -> Result<RenderSettings, Failure> {
    let optics = loaded.shot.rig.optics.as_ref();
    let quality = options.quality();
    let needs =
        if options.no_skip { SceneNeeds { gloss: loaded.needs.gloss, ..SceneNeeds::ALL } } else { loaded.needs };
    // Renderers go by what their devices are opened for; without any, by what is asked for.
    let hardware = options.traversal == TraversalChoice::Hardware;
    let stages = StageSettings {
        sampler: options.sampler,
        spp: options.spp,
        mixes_spp,
        filter: quality.denoiser,
        iterations: quality.most_iterations(),
        reproject: options.reprojects(),
        sparse: options.scale < 1.0,
        foveation: options.foveated.layers(&loaded.gaze),
        polar: options.foveated.polar(&loaded.gaze),
        rectified: optics.map(|optics| rectified(optics, options.size)).transpose()?,
        is_late: options.is_late,
        aovs: options.aovs(),
        frames_in_flight: usize::from(options.frames_in_flight),
        checks: options.shader_checks,
        moving: loaded.tables.moving().map(|moving| Moving { hardware, ..moving }),
        ..StageSettings::new(options.size, needs)
    };
    Ok(RenderSettings {
        stages,
        seam: options.seam(),
        adapts_halo: options.halo == HaloOption::Cost,
        seed: options.seed,
        bounces: options.bounces,
        scale: options.scale,
        indirect_clamp: options.clamp.unwrap_or(0.0),
        exposure_ev: loaded.shot.exposure_ev,
        later: None,
        max_dispatch_ms: options.max_dispatch_ms,
    })
}

/// The trace-file of a run and the zero of its times.
pub struct Tracing {
    file: Option<TraceFile>,
    pub recorder: Recorder,
}

impl Tracing {
    /// Other ranks record as well where this one does.
    pub fn start(options: &RunOptions) -> Result<Self, Failure> {
        let file = options.trace.as_deref().map(TraceFile::start).transpose()?;
        if let Some(node) = ranks::others().filter(|_| file.is_some()) {
            node.ask(|_| Request::Record).wait()?;
        }
        let recorder = file.as_ref().map_or_else(Recorder::off, TraceFile::recorder);
        Ok(Self { file, recorder })
    }

    pub fn record(&self, quality: &Quality, control: Option<FrameControl>, frame: &FrameReport) {
        self.take_recorded();
        record_frame(&self.recorder, frame, quality, control);
    }

    /// What other ranks have recorded.
    fn take_recorded(&self) {
        let Some(node) = ranks::others().filter(|_| self.recorder.is_on()) else { return };
        let epoch_us = self.recorder.time_us(node.epoch());
        for Recorded { rank, zero_ms, residual_us, text } in node.recorded() {
            self.recorder.rank_host(rank as u32, &node.host(rank), epoch_us + zero_ms * 1e3, &text);
            if let Some(residual_us) = residual_us {
                self.recorder.note_residual(&format!("rank_{rank}"), residual_us);
            }
        }
    }

    pub fn finish(self) -> Result<(), Failure> {
        if let Some(node) = ranks::others().filter(|_| self.file.is_some()) {
            node.ask(|_| Request::Recorded).wait()?;
            self.take_recorded();
        }
        Ok(self.file.map_or(Ok(()), TraceFile::finish)?)
    }
}

/// An option's value as it is typed.
pub fn name(value: &impl clap::ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned())
}
