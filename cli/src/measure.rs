//! `diptych info --check`: how fast this machine renders, and whether its images are right.

mod means;
mod options;

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::report::host::HostSummary;
use crate::report::machine::{FrameTimes, ImageCheck, LargestSize, Machine, Scaled};
use crate::report::{median_of, text_table};
use diptych::device::{self, AdapterReport, DeviceError, Selection, Traversal, TraversalChoice};
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, Renderer};
use diptych::image::{Extent, RgbImage, display};
use diptych::loaded::LoadedScene;
use diptych::quality::Quality;

use super::failure::Failure;
use super::faults::refuse_faults;
use super::interrupt::INTERRUPTED;
use super::play::fitting_size;
use super::progress::Progress;
use super::{console, interrupt, output, page};
use means::{BLOCKS, MOST_OFF, Measured, SCENES};
pub use options::Options;

/// Frames before the timed ones, and timed frames.
const WARM_UP: u32 = 3;
const FRAMES: usize = 10;
/// Frame rate at which the camera moves, 1/s.
const FPS: f64 = 60.0;
/// Fraction of all time that the frames of one scene and size may take.
const LONGEST_CELL: f64 = 0.04;
/// Budgets for which the largest size is searched for, ms, and the largest size of all.
const WITHIN_MS: [f64; 2] = [11.0, 20.0];
const LARGEST: Extent = Extent::new(3840, 2160);
/// Size, samples per pixel and frames of the images that are checked.
const CHECKED: Extent = Extent::new(160, 90);
const CHECKED_SPP: u32 = 16;
const CHECKED_FRAMES: u32 = 4;

struct Measuring<'a> {
    args: &'a Options,
    begin: Instant,
    progress: Progress,
    machine: Machine,
    /// The open devices; empty while a renderer has them.
    devices: Devices,
}

/// A scene on an adapter.
#[derive(Clone, Copy)]
struct Place<'a> {
    adapter: usize,
    traversal: Traversal,
    name: &'a str,
    loaded: &'a LoadedScene,
}

pub fn run(args: &Options) -> Result<(), Failure> {
    let (ready, adapters) = ready()?;
    output::prepare(&args.out, "--out")?;
    let per_scene = args.sizes.len() + WITHIN_MS.len() + 1;
    let other = |a: &AdapterReport| if a.ray_queries { 2 * SCENES.len() } else { 0 };
    let steps: usize = ready.iter().map(|a| SCENES.len() * per_scene + other(a)).sum();
    let mut measuring = Measuring::begin(args, steps + 2, adapters)?;
    let loaded = SCENES.iter().map(|scene| {
        measuring.progress.part(0.0, "loading");
        Ok(LoadedScene::load(&format!("builtin:{}", scene.name))?)
    });
    let loaded = loaded.collect::<Result<Vec<_>, Failure>>()?;
    match measuring.all_adapters(&ready, &loaded) {
        Err(Failure::Interrupted) if !measuring.machine.frames.is_empty() => {
            measuring.machine.left_out.push("everything after the signal that ended this measurement".to_owned());
        }
        measured => measured?,
    }
    let _writing = interrupt::writing();
    measuring.finish()?;
    interrupt::check()
}

/// Measures which sizes of a shot's images fit frame budgets on the first adapter, at the default quality.
pub fn shot(args: &Options, loaded: &LoadedScene) -> Result<(), Failure> {
    let (ready, adapters) = ready()?;
    let mut measuring = Measuring::begin(args, args.sizes.len() + WITHIN_MS.len(), adapters)?;
    let (adapter, name) = (ready[0].index, loaded.shot.name.as_str());
    let place = Place { adapter, traversal: measuring.open(&[adapter], TraversalChoice::Auto, 1, 1)?, name, loaded };
    let sizes = measuring.sizes(place, &args.sizes);
    let all = sizes.and_then(|()| WITHIN_MS.into_iter().try_for_each(|within_ms| measuring.largest(place, within_ms)));
    // After a signal, print the results so far.
    interrupt::as_none(all)?;
    measuring.progress.finish();
    let Machine { frames, largest, left_out, .. } = &measuring.machine;
    if args.json {
        say!("{}", serde_json::json!({ "shot": name, "frames": frames, "largest": largest, "left_out": left_out }));
        return interrupt::check();
    }
    let fits = |ms: f64, within_ms: f64| match ms / within_ms {
        factor if factor <= 1.0 => "fits".to_owned(),
        factor => format!("{factor:.1} times too slow"),
    };
    let row = |frame: &FrameTimes| {
        let ms = frame.median_ms;
        let in_budgets = WITHIN_MS.map(|within_ms| fits(ms, within_ms));
        [vec![frame.size.clone(), format!("{ms:.1}")], in_budgets.to_vec()].concat()
    };
    let rows: Vec<_> = frames.iter().map(row).collect();
    if rows.is_empty() {
        return interrupt::check();
    }
    let headers = ["size of each eye", "frame, ms", "in 11 ms", "in 20 ms"];
    say!("{}", text_table(&headers, &rows).trim_end());
    for found in largest {
        let within_ms = found.within_ms;
        match (&found.size, found.median_ms) {
            (Some(size), Some(ms)) => say!("within {within_ms} ms: {size}, {ms:.1} ms"),
            _ => say!("within {within_ms} ms: no size"),
        }
    }
    left_out.iter().for_each(|what| say!("left out: {what}"));
    interrupt::check()
}

/// Returns the adapters that can render, GPUs first, and all adapters.
fn ready() -> Result<(Vec<AdapterReport>, Vec<AdapterReport>), Failure> {
    let adapters = device::adapters();
    let mut ready: Vec<_> = adapters.iter().filter(|a| a.missing.is_empty()).cloned().collect();
    ready.sort_by_key(|a| !a.kind.ends_with("GPU"));
    if ready.is_empty() {
        return Err(DeviceError::NoAdapter.into());
    }
    Ok((ready, adapters))
}

impl<'a> Measuring<'a> {
    fn begin(args: &'a Options, steps: usize, adapters: Vec<AdapterReport>) -> Result<Self, Failure> {
        interrupt::watch()?;
        let host = HostSummary::here();
        let machine =
            Machine { diptych: env!("CARGO_PKG_VERSION"), cores: host.cores, host, adapters, ..Machine::default() };
        let progress = Progress::new(steps as u64, args.quiet, args.json);
        Ok(Self { args, begin: Instant::now(), progress, machine, devices: Devices::default() })
    }

    /// Opens devices in place of the open ones, `each` on each adapter, and returns their traversal. They have as many
    /// threads as if there were `most` on each.
    fn open(
        &mut self,
        adapters: &[usize],
        traversal: TraversalChoice,
        each: usize,
        most: usize,
    ) -> Result<Traversal, Failure> {
        self.devices = Devices::default();
        self.devices = device::open(&Selection {
            adapters: Some(adapters.to_vec()),
            virtual_devices: each,
            most_virtual_devices: most,
            traversal,
            pool: console::devices(),
            ..Selection::default()
        })?
        .into();
        Ok(self.devices.infos()[0].traversal)
    }

    /// Creates a renderer on the open devices. [`Self::put_back`] takes them from it.
    fn renderer(&mut self, loaded: &LoadedScene, size: Extent, quality: Quality) -> Result<Renderer, Failure> {
        let builder = Renderer::builder(loaded).size(size.width, size.height).quality(quality);
        Ok(builder.on(std::mem::take(&mut self.devices)).stop(Arc::clone(&INTERRUPTED)).build()?)
    }

    fn all(&self) -> Duration {
        Duration::from_secs_f64(60.0 * self.args.minutes)
    }

    fn left(&self) -> Duration {
        self.all().saturating_sub(self.begin.elapsed())
    }

    fn step(&self, what: String) {
        let event = serde_json::json!({ "event": "measured", "what": what });
        self.progress.step(what, &event);
    }

    fn leave_out(&mut self, what: String) {
        self.step(format!("{what}: left out"));
        self.machine.left_out.push(what);
    }

    fn all_adapters(&mut self, ready: &[AdapterReport], loaded: &[LoadedScene]) -> Result<(), Failure> {
        ready.iter().try_for_each(|adapter| self.adapter(adapter, loaded))?;
        let last = loaded.len() - 1;
        self.scaling(ready, (SCENES[last].name, &loaded[last]))
    }

    /// Measures all scenes on one adapter.
    fn adapter<'b>(&mut self, adapter: &AdapterReport, loaded: &'b [LoadedScene]) -> Result<(), Failure> {
        let auto = self.open(&[adapter.index], TraversalChoice::Auto, 1, 1)?;
        let place = |traversal, (scene, loaded): (&'static Measured, &'b LoadedScene)| Place {
            adapter: adapter.index,
            traversal,
            name: scene.name,
            loaded,
        };
        for (scene, loaded) in SCENES.iter().zip(loaded) {
            let place = place(auto, (scene, loaded));
            self.sizes(place, &self.args.sizes)?;
            WITHIN_MS.into_iter().try_for_each(|within_ms| self.largest(place, within_ms))?;
            self.check(place, &scene.means)?;
        }
        if !adapter.ray_queries {
            return Ok(());
        }
        let other = match auto {
            Traversal::Hardware => TraversalChoice::Compute,
            Traversal::Compute => TraversalChoice::Hardware,
        };
        let other = self.open(&[adapter.index], other, 1, 1)?;
        for (scene, loaded) in SCENES.iter().zip(loaded) {
            let place = place(other, (scene, loaded));
            let smallest = self.args.sizes.iter().copied().min_by_key(|size| size.area());
            self.sizes(place, smallest.as_slice())?;
            self.check(place, &scene.means)?;
        }
        Ok(())
    }

    /// Times frames of a scene at several sizes.
    fn sizes(&mut self, place: Place, sizes: &[Extent]) -> Result<(), Failure> {
        let Place { adapter, traversal, name, loaded } = place;
        let mut last: Option<(f64, f64)> = None;
        for &size in sizes {
            let what = format!("{name} at {size}, adapter {adapter}, {}", traversal.name());
            let expected_ms = last.map_or(0.0, |(ms, area)| ms * size.area() as f64 / area);
            // There is at least a frame before the timed ones and a timed one.
            if self.left().as_secs_f64() <= 2e-3 * expected_ms {
                self.leave_out(what);
                continue;
            }
            let frames = self.time(loaded, size)?;
            let times = FrameTimes::of(&frames, (adapter, traversal), name, size);
            last = Some((times.median_ms, size.area() as f64));
            self.machine.frames.push(times);
            self.step(what);
        }
        Ok(())
    }

    /// Renders some frames of a size and returns their reports, without those of the first frames.
    fn time(&mut self, loaded: &LoadedScene, size: Extent) -> Result<Vec<FrameReport>, Failure> {
        let tell = |progress: &Progress, timed: usize| {
            progress.part(timed as f64 / FRAMES as f64, &format!("{} at {size}", loaded.shot.name));
        };
        tell(&self.progress, 0);
        let mut renderer = self.renderer(loaded, size, self.machine.quality)?;
        let (begin, limit) = (Instant::now(), self.all().mul_f64(LONGEST_CELL));
        let mut timed = Vec::new();
        let mut index = 0;
        while timed.len() < FRAMES && (timed.is_empty() || begin.elapsed() < limit) {
            interrupt::check()?;
            let frame = renderer.frame(&loaded.shot.rig, f64::from(index) / FPS, index);
            let report = renderer.render(&frame)?;
            index += 1;
            tell(&self.progress, timed.len());
            if index > WARM_UP || begin.elapsed() > limit / 2 {
                timed.push(report);
            }
        }
        refuse_faults(&renderer)?;
        self.devices = renderer.into_devices();
        Ok(timed)
    }

    /// Searches for the largest size of a scene whose frames take at most `within_ms`.
    fn largest(&mut self, place: Place, within_ms: f64) -> Result<(), Failure> {
        let Place { adapter, name, loaded, .. } = place;
        let what = format!("{name}: the largest size within {within_ms} ms, adapter {adapter}");
        let timed = self.machine.frames.iter().filter(|f| f.adapter == adapter && f.scene == name);
        let most = timed.max_by_key(|f| f.pixels).map(|f| f.median_ms * LARGEST.area() as f64 / f.pixels as f64);
        let Some(most_ms) = most.filter(|_| !self.left().is_zero()) else {
            self.leave_out(what);
            return Ok(());
        };
        let time = |size| Ok::<_, Failure>(median_ms(&self.time(loaded, size)?));
        let found = fitting_size::search(LARGEST, most_ms, [within_ms; 2], time)?;
        self.machine.largest.push(LargestSize {
            adapter,
            scene: name.to_owned(),
            within_ms,
            size: found.map(|(size, _)| size.to_string()),
            median_ms: found.map(|(_, ms)| ms),
        });
        self.step(what);
        Ok(())
    }

    /// Compares the means of an image with stored ones.
    fn check(&mut self, place: Place, stored: &[f64]) -> Result<(), Failure> {
        let Place { adapter, traversal, name, loaded } = place;
        let quality = Quality { spp: CHECKED_SPP.into(), filter: None, ..Quality::default() };
        let mut renderer = self.renderer(loaded, CHECKED, quality)?;
        let mut means = vec![0.0; stored.len()];
        for index in 0..CHECKED_FRAMES {
            interrupt::check()?;
            renderer.render(&renderer.frame(&loaded.shot.rig, 0.0, index))?;
            let image = renderer.read_linear()?.into_left();
            means.iter_mut().zip(block_means(&image)).for_each(|(sum, m)| *sum += m / f64::from(CHECKED_FRAMES));
        }
        refuse_faults(&renderer)?;
        let scale = stored.len() as f64 / stored.iter().sum::<f64>();
        let off = means.iter().zip(stored).map(|(mean, right)| scale * (mean - right).abs()).fold(0.0, f64::max);
        let (scene, is_right) = (name.to_owned(), off <= MOST_OFF);
        self.machine.images.push(ImageCheck { adapter, traversal, scene, means, off, is_right });
        self.step(format!("{name}: image, adapter {adapter}, {}", traversal.name()));
        self.devices = renderer.into_devices();
        Ok(())
    }

    /// Times one device and several: one on each GPU if there are several, else two on the first adapter.
    fn scaling(&mut self, ready: &[AdapterReport], (name, loaded): (&str, &LoadedScene)) -> Result<(), Failure> {
        let gpus: Vec<_> = ready.iter().filter(|a| a.kind.ends_with("GPU")).map(|a| a.index).collect();
        let (adapters, each) = if gpus.len() > 1 { (gpus, 1) } else { (vec![ready[0].index], 2) };
        let size = self.args.sizes[self.args.sizes.len() / 2];
        let mut alone_ms = None;
        for (adapters, count) in [(&adapters[..1], 1), (&adapters[..], each)] {
            let what = format!("{name} at {size}, {} device(s)", adapters.len() * count);
            if self.left().is_zero() {
                self.leave_out(what);
                continue;
            }
            self.open(adapters, TraversalChoice::Auto, count, each)?;
            let count = self.devices.len();
            let median_ms = median_ms(&self.time(loaded, size)?);
            let alone_ms = *alone_ms.get_or_insert(median_ms);
            self.machine.scaling.push(Scaled {
                scene: name.to_owned(),
                size: size.to_string(),
                devices: count,
                share_adapter: adapters.len() < count,
                median_ms,
                speedup: alone_ms / median_ms,
            });
            self.step(what);
        }
        Ok(())
    }

    /// Writes the files and prints the tables.
    fn finish(mut self) -> Result<(), Failure> {
        self.progress.finish();
        let (args, machine) = (self.args, &mut self.machine);
        machine.seconds = self.begin.elapsed().as_secs_f64();
        let text = serde_json::to_string_pretty(machine).map_err(anyhow::Error::from)?;
        output::write_text(&args.out, "machine.json", &text)?;
        let sections = machine.sections().map_err(anyhow::Error::from)?;
        page::write(&args.out, "This machine", &sections)?;
        if args.json {
            say!("{}", serde_json::json!({ "event": "result", "machine": machine }));
        } else if !args.quiet {
            let tables =
                [machine.frames_table(), machine.largest_table(), machine.scaling_table(), machine.images_table()];
            tables.iter().for_each(|table| say!("{}", table.text()));
            machine.left_out.iter().for_each(|what| say!("left out: {what}"));
            say!("report.html and machine.json are in {}", args.out.display());
        }
        let wrong: Vec<_> = machine.images.iter().filter(|c| !c.is_right).map(|c| c.scene.as_str()).collect();
        if wrong.is_empty() {
            return Ok(());
        }
        Err(Failure::Run(anyhow::anyhow!(
            "images of {} differ from the stored means: the driver may be at fault; the table says by how much",
            wrong.join(", ")
        )))
    }
}

fn median_ms(frames: &[FrameReport]) -> f64 {
    median_of(frames.iter().map(|f| f.makespan_ms).collect())
}

/// Returns the mean luminance of each block of an image.
fn block_means(image: &RgbImage) -> Vec<f64> {
    let Extent { width, height } = image.extent;
    let [columns, rows] = BLOCKS;
    let mut sums = vec![0.0; (columns * rows) as usize];
    for (i, pixel) in (0..).zip(&image.pixels) {
        let (x, y) = (i % width * columns / width, i / width * rows / height);
        sums[(y * columns + x) as usize] += display::luminance(pixel.map(f64::from));
    }
    let pixels = image.extent.area() as f64 / sums.len() as f64;
    sums.iter().map(|sum| sum / pixels).collect()
}
