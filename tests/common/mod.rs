//! Helpers of the renderer's tests: load a subject, and create a renderer for it.

#![allow(dead_code, unused_imports)] // Each test binary uses a part.

mod effort;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use diptych::RunConfig;
use diptych::accel::{Accel, Layout};
use diptych::device::{self, GpuDevice, Selection, Traversal, TraversalChoice};
use diptych::exec::ranks::Devices;
use diptych::exec::{ExecError, FrameParams, FrameReport, InjectedFaults, PerView, Renderer};
use diptych::frame::Foveation;
use diptych::frame::settings::Value as _;
use diptych::graph::{Life, Pass};
use diptych::image::{Extent, Image, RgbImage};
use diptych::passes::tonemap::LINEAR;
use diptych::passes::{Declarations, declare};
use diptych::projection::PolarSpace;
use diptych::quality::{Denoiser, Filter};
use diptych::scene::Scene;
use diptych::scene::load::load_shot;
use diptych::scene::needs::SceneNeeds;
use diptych::scene::rig::{Eye, Rig, RigKey};
use diptych::scene::shot::Gaze;
use diptych::schedule::{Even, Policy};
use diptych::tables::SceneTables;
pub use effort::{is_thorough, sampled};

/// A scene ready for upload, and its camera.
pub struct Subject {
    pub name: String,
    pub scene: Scene,
    pub rig: Rig,
    pub needs: SceneNeeds,
    pub tables: Arc<SceneTables>,
}

impl Subject {
    pub fn new(name: &str, scene: Scene, rig: Rig) -> Self {
        Self::laid_out(name, scene, rig, Layout::Auto)
    }

    pub fn laid_out(name: &str, scene: Scene, rig: Rig, layout: Layout) -> Self {
        let accel = Accel::build_with(&scene, layout).unwrap_or_else(|e| panic!("{name}: {e}"));
        let tables = SceneTables::new(&scene, accel).unwrap_or_else(|e| panic!("{name}: {e}"));
        Self { name: name.to_owned(), needs: SceneNeeds::of(&scene), scene, rig, tables: Arc::new(tables) }
    }

    /// Loads `builtin:NAME` or a file, like the command line.
    pub fn load(shot: &str) -> Self {
        let (parsed, scene) = load_shot(shot).unwrap_or_else(|e| panic!("{shot}: {e}"));
        Self::new(shot, scene, parsed.rig)
    }

    /// Returns settings with one sample per pixel, traced in both eyes through a pinhole, six bounces and no denoising.
    /// A quick run uses the features of [`shared_shaders`].
    pub fn settings(&self, width: u32, height: u32) -> RunConfig {
        let needs = if is_thorough() { self.needs } else { shared_shaders(self.needs) };
        let mut settings = RunConfig::of_scene(Extent::new(width, height), &self.scene, needs, &self.tables);
        settings.buffers.reproject = false;
        settings.envelope.most.filter = None;
        settings
    }

    /// Creates a renderer on these devices, with stripes of equal height.
    pub fn renderer(&self, gpus: Vec<GpuDevice>, settings: &RunConfig) -> Result<Renderer, ExecError> {
        let policy = Box::new(Even::new(settings.grid().height, gpus.len()));
        Renderer::new(gpus, Arc::clone(&self.tables), settings.clone(), policy, Instant::now())
    }

    /// Returns [`Self::settings`] with reprojection into the right eye and five filter iterations.
    pub fn denoised(&self, width: u32, height: u32) -> RunConfig {
        let mut settings = self.settings(width, height);
        settings.buffers.reproject = true;
        settings.envelope.most.filter = Some(Filter::new(Denoiser::ATROUS, 5));
        settings
    }

    /// Returns [`Self::denoised`] with temporal accumulation.
    pub fn accumulated(&self, width: u32, height: u32) -> RunConfig {
        let mut settings = self.denoised(width, height);
        settings.envelope.most.filter = Some(Filter::new(Denoiser::SVGF, 5));
        settings
    }
}

/// Returns a configuration with a change.
pub fn with(mut config: RunConfig, change: impl FnOnce(&mut RunConfig)) -> RunConfig {
    change(&mut config);
    config
}

/// Adds foveal layers around the gaze that are filtered with these iterations, of à-trous if there is no denoiser yet.
pub fn foveate(config: &mut RunConfig, gaze: [Gaze; 2], layers: Foveation, iterations: [u32; 3]) {
    let Foveation { radii, unsampled_fraction } = layers;
    (config.gaze, config.unsampled_fraction) = (gaze, unsampled_fraction);
    let denoiser = config.denoiser().or(Some(Denoiser::ATROUS));
    let filter = Filter::in_effect(denoiser, iterations);
    (config.envelope.most.fovea, config.envelope.most.filter) = (Some(radii), filter);
}

/// Traces images in this polar projection around the gaze.
pub fn project(config: &mut RunConfig, gaze: [Gaze; 2], space: PolarSpace) {
    (config.gaze, config.envelope.most.polar) = (gaze, Some(space));
}

/// Returns one of two feature sets that covers `needs`: drivers take longer to compile shaders for each scene than to
/// render small frames. Gloss is kept as needed, because it changes the image; the tables add instances.
fn shared_shaders(needs: SceneNeeds) -> SceneNeeds {
    let all = SceneNeeds { instances: false, ..needs.widened() };
    let common = SceneNeeds {
        second_uvs: false,
        transmission: false,
        diffuse_transmission: false,
        transparent_shadows: false,
        clearcoat: false,
        sheen: false,
        iridescence: false,
        anisotropy: false,
        dispersion: false,
        unlit: false,
        vertex_colors: false,
        alpha: false,
        alpha_emitters: false,
        coated_emitters: false,
        environment_map: false,
        ..all
    };
    let suffices = needs.constants().iter().zip(common.constants()).all(|(needed, (_, has))| !needed.1 || has);
    if suffices { common } else { all }
}

/// Returns the devices that no test uses at present. They keep their compiled pipelines.
fn idle() -> MutexGuard<'static, Vec<GpuDevice>> {
    static IDLE: Mutex<Vec<GpuDevice>> = Mutex::new(Vec::new());
    IDLE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the ray traversal for tests: `DIPTYCH_TRAVERSAL`, or the default.
///
/// # Panics
/// If the variable is invalid.
pub fn traversal() -> TraversalChoice {
    let Some(name) = std::env::var_os("DIPTYCH_TRAVERSAL") else { return TraversalChoice::Auto };
    let name = name.to_string_lossy();
    TraversalChoice::parse(&name).unwrap_or_else(|_| panic!("DIPTYCH_TRAVERSAL cannot be {name}"))
}

/// Returns `count` single-threaded devices of the first suitable adapter, which is the same for every count. Tests run
/// concurrently, and each device's compiled pipelines serve it alone and among others.
pub fn devices(count: usize) -> Vec<GpuDevice> {
    // Prefer devices with the most pipelines, so that few devices compile the common ones.
    devices_by(count, |gpu| std::cmp::Reverse(gpu.pipelines.len()))
}

/// Returns [`devices`] for a test that does not return all of them: those with the fewest pipelines.
pub fn devices_to_lose(count: usize) -> Vec<GpuDevice> {
    devices_by(count, |gpu| gpu.pipelines.len())
}

/// Opens a device while no other test does.
pub fn open_alone<T>(open: impl FnOnce() -> T) -> T {
    let _guard = idle();
    open()
}

/// Returns a device of [`devices`], so that other tests can use it.
pub fn give_back(gpu: GpuDevice) {
    idle().push(gpu);
}

fn devices_by<K: Ord>(count: usize, key: impl FnMut(&GpuDevice) -> K) -> Vec<GpuDevice> {
    let mut idle = idle();
    let mut devices = std::mem::take(&mut *idle);
    devices.sort_by_key(key);
    idle.extend(devices.drain(count.min(devices.len())..));
    // Open devices while the lock is held: drivers have crashed on concurrent creation. Mesa 22.3 and 25 have not
    // crashed on pipelines created this way.
    if devices.len() < count {
        let traversal = traversal();
        let is_hardware = traversal == TraversalChoice::Hardware;
        let adapters = device::adapters().into_iter();
        let adapter = adapters.filter(|a| a.missing.is_empty()).find(|a| a.ray_queries || !is_hardware);
        assert!(adapter.is_some() || !is_hardware, "DIPTYCH_TRAVERSAL=hardware: no adapter here has ray queries");
        let adapter = adapter.expect("these tests need an adapter: on Linux, install mesa-vulkan-drivers");
        devices.extend(open_on(adapter.index, count - devices.len(), traversal));
    }
    devices.iter_mut().enumerate().for_each(|(i, gpu)| gpu.info.index = i);
    devices
}

/// Opens `count` single-threaded devices of an adapter.
pub fn open_on(adapter: usize, count: usize, traversal: TraversalChoice) -> Vec<GpuDevice> {
    open(&Selection {
        adapters: Some(vec![adapter]),
        virtual_devices: count,
        threads_per_device: Some(vec![1]),
        traversal,
        ..Selection::default()
    })
}

pub fn open(selection: &Selection) -> Vec<GpuDevice> {
    // SAFETY: tests access the environment only through `std::env`, and list adapters only through the library.
    unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
    device::open(selection).unwrap_or_else(|e| panic!("these tests need a device: {e}"))
}

/// Returns the renderer's own passes, with these images as additional outputs.
pub fn with_outputs(names: &'static [&'static str]) -> Declarations {
    let shown = move |mut pass: Pass| {
        let images = pass.uses.iter_mut().map(|used| &mut used.image.resource);
        images.filter(|image| names.contains(&image.name)).for_each(|image| image.life = Life::Output);
        pass
    };
    Declarations::new(move |spec| declare(spec).passes.into_iter().map(shown).collect())
}

/// A renderer and the subject that it renders.
pub struct Stage<'a> {
    subject: &'a Subject,
    renderer: Option<Renderer>,
    devices: usize,
    frames_in_flight: usize,
    change: Box<dyn Fn(&mut FrameParams) + 'a>,
}

impl<'a> Stage<'a> {
    pub fn alone(subject: &'a Subject, settings: &RunConfig) -> Self {
        Self::even(subject, settings, 1)
    }

    pub fn with(subject: &'a Subject, settings: &RunConfig, devices: usize, policy: Box<dyn Policy>) -> Self {
        Self::on(self::devices(devices), subject, settings, policy)
    }

    /// Creates a stage on `devices` devices with stripes of equal height.
    pub fn even(subject: &'a Subject, settings: &RunConfig, devices: usize) -> Self {
        let policy = Even::new(settings.grid().height, devices);
        Self::with(subject, settings, devices, Box::new(policy))
    }

    /// Creates a stage on these devices.
    pub fn on(gpus: impl Into<Devices>, subject: &'a Subject, settings: &RunConfig, policy: Box<dyn Policy>) -> Self {
        let gpus: Devices = gpus.into();
        let devices = gpus.len();
        let is_slow = gpus.infos().iter().any(|g| g.threads.is_some() && g.traversal == Traversal::Hardware);
        let mut renderer = Renderer::new(gpus, Arc::clone(&subject.tables), settings.clone(), policy, Instant::now())
            .unwrap_or_else(|e| panic!("{}: {e}", subject.name));
        if is_slow {
            // Tests may take longer than the usual timeout before the first frame.
            renderer.set_watchdog(Duration::from_secs(600));
        }
        let frames_in_flight = settings.execution.frames_in_flight;
        Self { subject, renderer: Some(renderer), devices, frames_in_flight, change: Box::new(|_| ()) }
    }

    /// Returns its devices, which no other test reuses.
    pub fn into_devices(self) -> Vec<GpuDevice> {
        self.into_all_devices().into_own()
    }

    /// Returns its devices together with those of other ranks.
    pub fn into_all_devices(mut self) -> Devices {
        self.renderer.take().map_or_else(Devices::default, Renderer::into_devices)
    }

    /// Renders a frame and asserts that every sample is finite.
    #[track_caller]
    pub fn frame_at(&mut self, time_s: f64, index: u32) -> Frame {
        let frame = self.render(time_s, index);
        for (eye, tally) in Eye::of_rig(frame.report.tallies.len()).zip(&frame.report.tallies) {
            assert_eq!(tally.nonfinite, 0, "{self}: samples of {eye} were dropped");
        }
        frame
    }

    /// Changes the parameters of all later frames.
    pub fn set(&mut self, change: impl Fn(&mut FrameParams) + 'a) {
        self.change = Box::new(change);
    }

    /// Returns the parameters of a frame for the subject's camera, with the changes of [`Self::set`].
    pub fn params(&mut self, time_s: f64, index: u32) -> FrameParams {
        let rig = &self.subject.rig;
        let mut params = self.renderer().frame(rig, time_s, index);
        (self.change)(&mut params);
        params
    }

    /// Lets devices fail as `injections` say, and slows each down by a factor.
    pub fn inject(&mut self, injections: &[&str], slowdown: &[u32]) {
        let injections = injections.iter().map(|i| i.parse().unwrap()).collect();
        self.renderer().set_injected_faults(InjectedFaults { injections, slowdown: slowdown.to_vec() });
    }

    fn render(&mut self, time_s: f64, index: u32) -> Frame {
        let params = self.params(time_s, index);
        let report = self.renderer().render(&params).unwrap_or_else(|e| panic!("{self}: {e}"));
        let linear = self.renderer().read_linear().unwrap_or_else(|e| panic!("{self}: {e}"));
        Frame { linear, report }
    }

    /// Renders frames at these times, with as many in flight as the settings allow.
    pub fn frames_in_flight(&mut self, times_s: &[f64]) -> Vec<Frame> {
        let mut times = (0..).zip(times_s);
        let mut frames = Vec::new();
        loop {
            while self.renderer().in_flight() < self.frames_in_flight
                && let Some((index, &time_s)) = times.next()
            {
                let params = self.params(time_s, index);
                self.renderer().begin(&params, &[LINEAR]).unwrap_or_else(|e| panic!("{e}"));
            }
            let Some(report) = self.renderer().finish().unwrap_or_else(|e| panic!("{e}")) else { return frames };
            let linear = self.renderer().read_linear().unwrap_or_else(|e| panic!("{self}: {e}"));
            frames.push(Frame { linear, report });
        }
    }

    /// Renders a frame that may have dropped samples.
    pub fn frame_with_drops(&mut self, index: u32) -> Frame {
        self.render(0.0, index)
    }

    #[track_caller]
    pub fn frame(&mut self, index: u32) -> Frame {
        self.frame_at(0.0, index)
    }

    pub fn renderer(&mut self) -> &mut Renderer {
        self.renderer.as_mut().expect("it is taken only when the stage ends")
    }

    /// Returns the last frame in display encoding, as encoded by the devices.
    pub fn display(&mut self) -> PerView<Image<[u8; 4]>> {
        self.renderer().read_display().unwrap_or_else(|e| panic!("{}: {e}", self.subject.name))
    }

    /// Returns the i-th auxiliary image of the settings.
    pub fn aov(&mut self, i: usize) -> PerView<Vec<Vec<f32>>> {
        self.renderer().read_aov(i).unwrap_or_else(|e| panic!("{}: {e}", self.subject.name))
    }
}

impl Drop for Stage<'_> {
    fn drop(&mut self) {
        if let Some(renderer) = self.renderer.take() {
            idle().extend(renderer.into_devices().into_own());
        }
    }
}

impl std::fmt::Display for Stage<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} on {} device(s)", self.subject.name, self.devices)
    }
}

pub struct Frame {
    pub linear: PerView<RgbImage>,
    pub report: FrameReport,
}

impl Frame {
    /// Returns the fraction of the right eye's pixels that are holes after reprojection.
    pub fn hole_fraction(&self) -> f64 {
        let holes: u64 = self.report.tallies[1].holes.iter().sum();
        holes as f64 / self.linear.right().extent.area() as f64
    }
}

/// Returns the file of a large scene, if it exists: in `DIPTYCH_SCENES`, or in `../shared/scenes` beside the crate.
pub fn shared_shot(name: &str) -> Option<String> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
    let folder = std::env::var_os("DIPTYCH_SCENES").map_or(beside, PathBuf::from);
    let shot = folder.join(format!("{name}.toml"));
    if shot.is_file() {
        return Some(shot.display().to_string());
    }
    eprintln!("\nSKIPPED: {name}: there is no {} (DIPTYCH_SCENES names another folder)\n", shot.display());
    None
}

/// Returns a rig whose eyes both see the image of a pinhole at `origin`; the eyes differ in their random numbers.
pub fn still_rig(origin: glam::Vec3, forward: glam::Vec3, up: glam::Vec3, tan_half_yfov: f32) -> Rig {
    let position = origin.as_dvec3();
    let key = RigKey { time_s: 0.0, position, target: position + forward.as_dvec3(), up: up.as_dvec3() };
    let yfov_rad = 2.0 * f64::from(tan_half_yfov).atan();
    Rig { yfov_rad, baseline_m: 0.0, ..Rig::of_keys(vec![key]) }
}
