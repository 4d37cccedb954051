//! Timed frames of a setting after its warm-up, with their images.

use std::time::Instant;

use crate::report::run::FrameRow;
use diptych::device::DeviceInfo;
use diptych::exec::{FrameReport, PerView};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::trace::frames::record_devices;

use super::args::StudyArgs;
use crate::bench::axes::FRAMES_MAX;
use crate::failure::Failure;
use crate::faults::refuse_faults;
use crate::interrupt;
use crate::options::RenderOptions;
use crate::progress::Progress;
use crate::setup::{self, Tracing};

/// Inputs that all settings share.
pub struct Timed<'a> {
    pub args: &'a StudyArgs,
    pub loaded: &'a LoadedScene,
    pub progress: &'a Progress,
    pub tracing: &'a Tracing,
}

/// A named setting. Its `number` makes the frame numbers in the trace unique across settings.
pub struct Setting {
    pub number: u32,
    pub name: String,
    pub options: RenderOptions,
    /// Virtual devices on each chosen adapter; `None` for a single device in total.
    pub virtual_devices: Option<u16>,
}

/// The frames of a setting after its warm-up, and the devices that rendered them.
pub struct Warm {
    pub frames: Vec<TimedFrame>,
    pub devices: Vec<DeviceInfo>,
    /// Time that building the renderer took, seconds.
    pub warm_up_s: f64,
}

/// A frame after the warm-up.
pub struct TimedFrame {
    pub report: FrameReport,
    /// The frame's entry in run.json.
    pub row: FrameRow,
    pub linear: PerView<RgbImage>,
}

impl Timed<'_> {
    pub fn frames(&self, setting: &Setting) -> Result<Warm, Failure> {
        let Self { args, loaded, progress, tracing } = self;
        let Setting { number, name, options, virtual_devices } = setting;
        let mut gpus = setup::open_devices(options, virtual_devices.map_or(1, usize::from))?;
        if virtual_devices.is_none() {
            gpus.truncate(1);
        }
        let begin = Instant::now();
        progress.part(0.0, "starting");
        let mut renderer = setup::renderer(options, loaded, gpus, tracing.recorder.origin())?;
        let warm_up_s = begin.elapsed().as_secs_f64();
        record_devices(&tracing.recorder, renderer.devices());
        let mut frames = Vec::new();
        for i in 0..args.warm_up + args.repeats {
            let report = renderer.render(&renderer.frame(&loaded.shot.rig, options.settings.time, i))?;
            refuse_faults(&renderer)?;
            interrupt::check()?;
            let makespan_ms = report.makespan_ms;
            let event = serde_json::json!({ "event": "frame", "setting": name, "makespan_ms": makespan_ms });
            progress.step(format!("{name}, {makespan_ms:.1} ms"), &event);
            if i >= args.warm_up {
                // Frame numbers in the trace are unique across settings.
                let report = FrameReport { index: number * FRAMES_MAX + i, ..report };
                tracing.record(&options.quality(), None, &report);
                let row = FrameRow::new(&report, &options.quality(), &loaded.shot.rig, options.settings.time);
                let row = FrameRow { index: i - args.warm_up, ..row };
                frames.push(TimedFrame { report, row, linear: renderer.read_linear()? });
            }
        }
        Ok(Warm { frames, devices: renderer.devices().to_vec(), warm_up_s })
    }
}
