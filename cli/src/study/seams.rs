//! `diptych study seams`: image errors at the seams between stripes, by seam policy and number of devices.

use std::time::Instant;

use anyhow::anyhow;

use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::run::{FrameRow, RunReport};
use crate::report::statistics::quartiles;
use crate::report::study::{LERIA_NOTE, ONE_DEVICE, SEAM_NOTE, SeamErrors, SeamRow, leria_table, seam_csv, seam_table};
use crate::report::{Csv, Table};
use diptych::device::DeviceInfo;
use diptych::exec::{FrameReport, PerView};
use diptych::image::{ImageError, RgbImage};
use diptych::loaded::LoadedScene;
use diptych::metrics::Pair;
use diptych::passes::denoise;
use diptych::scene::rig::Eye;
use diptych::schedule::Balance;

use super::args::StudyArgs;
use super::locked;
use super::turns::Turns;
use crate::bench::reference::{Reference, own};
use crate::failure::Failure;
use crate::interrupt;
use crate::options::{RenderOptions, RunOptions};
use crate::output::{self, same_bits};
use crate::page::{self, and_page};
use crate::progress::Progress;
use crate::settings;
use crate::setup::{self, Tracing};
use diptych::frame::settings::{SeamMode, Value};

pub fn run(args: &StudyArgs) -> Result<(), Failure> {
    let options = settings(args)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(&options)?;
    let loaded = setup::load(&options)?;
    setup::tell_remarks(&loaded.scene);
    let reference = own(&args.reference(&args.options, options.quality().bounces), &loaded, &tracing, None)?;
    let frames = u64::from(args.warm_up + args.repeats);
    let settings = 1 + counts(args).len() * SEAMS.len();
    let progress = Progress::new(settings as u64 * frames, options.quiet, options.json);
    let turns = |number| Turns::new(&loaded, &progress, &tracing, number);
    let found = Study { options, reference, loaded: &loaded }.measure(args, turns)?;
    let _writing = interrupt::writing();
    progress.finish();
    tracing.finish()?;
    found.write(args)?;
    interrupt::check()
}

/// Returns the options of the study: those of Leria et al. as published. Stripes are even by default, so that the seams are
/// on the same rows with every seam policy.
fn settings(args: &StudyArgs) -> Result<RenderOptions, Failure> {
    let mut run: RunOptions = args.options.clone();
    if run.settings.balance.is_empty() && run.settings.ratios.is_empty() {
        run.settings.balance = vec![Balance::Even];
    }
    let applied = locked::published("leria").apply(&mut run.settings, &[("frames_in_flight", "1")]);
    applied.map_err(|error| Failure::Input(error.into()))?;
    let quality = run.settings.quality();
    let options = RenderOptions::new(run, quality);
    options.check().map_err(Failure::Input)?;
    if counts(args).is_empty() {
        return Err(Failure::Input(anyhow!("--counts: seams need at least two devices, e.g. 2,3,4")));
    }
    Ok(options)
}

/// Returns the numbers of virtual devices on each adapter, above 1.
fn counts(args: &StudyArgs) -> Vec<u16> {
    args.counts.iter().copied().filter(|count| *count > 1).collect()
}

/// All filtering across stripes, in the order of the tables.
const SEAMS: [SeamMode; 3] = [SeamMode::None, SeamMode::Filter, SeamMode::Halo];

/// The frames of a setting after its warm-up, and the devices that rendered them.
struct Warm {
    frames: Vec<TimedFrame>,
    devices: Vec<DeviceInfo>,
    /// Time that building the renderer took, seconds.
    warm_up_s: f64,
}

/// A frame after the warm-up.
struct TimedFrame {
    report: FrameReport,
    /// The frame's entry in run.json.
    row: FrameRow,
    linear: PerView<RgbImage>,
}

impl Warm {
    /// Renders the frames of a setting on virtual devices, or on a single device in total.
    fn render(
        args: &StudyArgs,
        mut turns: Turns<'_>,
        name: String,
        options: RenderOptions,
        virtual_devices: Option<u16>,
    ) -> Result<Self, Failure> {
        let mut gpus = setup::open_devices(&options, virtual_devices.map_or(1, usize::from))?;
        if virtual_devices.is_none() {
            gpus.truncate(1);
        }
        let (begin, time_s) = (Instant::now(), options.settings.time);
        turns.add(name, options, gpus)?;
        let (warm_up_s, mut frames) = (begin.elapsed().as_secs_f64(), Vec::new());
        for i in 0..args.warm_up + args.repeats {
            let report = turns.render(time_s, i)?.remove(0);
            if i >= args.warm_up {
                let row = turns.keep(0, time_s, &report, i - args.warm_up);
                frames.push(TimedFrame { report, row, linear: turns.renderers[0].read_linear()? });
            }
        }
        Ok(Self { frames, devices: turns.renderers[0].devices().to_vec(), warm_up_s })
    }
}

struct Study<'a> {
    options: RenderOptions,
    reference: Reference,
    loaded: &'a LoadedScene,
}

/// Results of the study.
struct Results<'a> {
    study: Study<'a>,
    rows: Vec<SeamRow>,
    /// Devices of each measured count; the first entry is the run on a single device.
    devices: Vec<Vec<DeviceInfo>>,
    /// Total time that building the renderers took, seconds.
    warm_up_s: f64,
    /// Timed frames, each with its seam policy.
    frames: Vec<(String, FrameRow)>,
}

impl<'a> Study<'a> {
    /// Measures all settings. `turns` starts one, of which this number came before.
    fn measure<'t>(self, args: &StudyArgs, turns: impl Fn(usize) -> Turns<'t>) -> Result<Results<'a>, Failure> {
        let one = Warm::render(args, turns(0), "1 device".into(), self.options.clone(), None)?;
        let mut rows = self.rows("-", &one, &one.frames)?.to_vec();
        let mut frames = Vec::new();
        let mut keep = |policy: &str, warm: &Warm| {
            frames.extend(warm.frames.iter().map(|f| (policy.to_owned(), f.row.clone())));
        };
        keep(ONE_DEVICE, &one);
        let (mut devices, mut warm_up_s, mut number) = (vec![one.devices.clone()], one.warm_up_s, 1);
        'all: for count in counts(args) {
            for seam in SEAMS {
                let policy = seam.text();
                let mut options = self.options.clone();
                options.run.settings.seam = seam;
                let name = format!("{count} devices, {policy}");
                let warm = Warm::render(args, turns(number), name, options, Some(count));
                // A signal ends the measurement, and the results so far are written.
                let Some(warm) = interrupt::as_none(warm)? else { break 'all };
                rows.extend(self.rows(&policy, &warm, &one.frames)?);
                keep(&policy, &warm);
                warm_up_s += warm.warm_up_s;
                number += 1;
                if seam == SeamMode::Halo {
                    devices.push(warm.devices);
                }
            }
        }
        Ok(Results { study: self, rows, devices, warm_up_s, frames })
    }

    /// Returns a row per eye; `one` holds the same frames, rendered on one device.
    fn rows(&self, policy: &str, warm: &Warm, one: &[TimedFrame]) -> Result<[SeamRow; 2], Failure> {
        let Warm { frames, devices, .. } = warm;
        let time_ms = quartiles(frames.iter().map(|f| f.report.makespan_ms).collect());
        let same_bytes = frames.iter().zip(one).all(|(f, o)| same_bits(&f.linear, &o.linear));
        let row = |eye: Eye| -> Result<SeamRow, Failure> {
            let (reference, shown_ev) = (self.reference.images.of(eye), self.loaded.shot.exposure_ev);
            let mut errors = Vec::new();
            for (frame, one) in frames.iter().zip(one) {
                let [image, one] = [frame, one].map(|f| f.linear.of(eye));
                errors.push(seam_errors(reference, image, one, &seam_rows(frame, eye), shown_ev)?);
            }
            let (devices, policy, exposure_ev) = (devices.len(), policy.to_owned(), self.loaded.exposure_ev());
            let errors = SeamErrors::mean_of(&errors);
            Ok(SeamRow { devices, policy, eye, exposure_ev, errors, same_bytes, time_ms })
        };
        Ok([row(Eye::LEFT)?, row(Eye::RIGHT)?])
    }
}

/// Returns the first row of each of the denoiser's stripes, except the topmost.
fn seam_rows(frame: &TimedFrame, view: Eye) -> Vec<u32> {
    let height = frame.linear.left().extent.height;
    let edges = frame.report.assignment.stripes(denoise::PARTITION, view).inner_edges();
    edges.iter().copied().filter(|edge| (1..height).contains(edge)).collect()
}

fn seam_errors(
    reference: &RgbImage,
    image: &RgbImage,
    one: &RgbImage,
    edges: &[u32],
    exposure_ev: f32,
) -> Result<SeamErrors, ImageError> {
    let pair = |reference, image| Pair::new(reference, image, exposure_ev);
    let (own, to_one) = (pair(reference, image)?, pair(one, image)?);
    let seam = own.seam_error(edges);
    let near_of_one = pair(reference, one)?.seam_error(edges).near_rmse;
    let (errors, errors_one) = (own.errors(), to_one.errors());
    Ok(SeamErrors {
        psnr: errors.psnr,
        flip: errors.flip,
        cambi: own.cambi(),
        seam: seam.ratio,
        seam_over_one: seam.near_rmse.zip(near_of_one).and_then(|(own, one)| (one > 0.0).then_some(own / one)),
        psnr_one: errors_one.psnr,
        flip_one: errors_one.flip,
        seam_rmse_one: to_one.seam_error(edges).near_rmse,
    })
}

impl Results<'_> {
    fn write(&self, args: &StudyArgs) -> Result<(), Failure> {
        let Self { study: Study { options, reference, .. }, rows, devices, .. } = self;
        seam_csv(rows).write(&options.out.join("seams.csv"))?;
        self.write_run()?;
        let title = format!("Seams of {} at {}", options.shot, options.settings.size);
        let mut settings = Table::of_fields(&settings::in_force(options, self.study.loaded.exposure_ev(), &[]));
        settings.rows.retain(|row| row.first().is_none_or(|name| name != "seam"));
        let mut notes = vec![format!("Reference: {}.", reference.origin)];
        notes.extend(reference.noise.as_ref().map(|n| format!("Its noise (smaller errors mean nothing): {n}.")));
        let table = Table::of_devices(devices.iter().map(Vec::as_slice));
        let sections = [
            Section { heading: "Settings", notes, table: Some(settings), figure: None },
            Section { heading: "Devices", table: Some(table), ..Section::default() },
            Section {
                heading: "Seams",
                notes: vec![SEAM_NOTE.to_owned()],
                table: Some(seam_table(rows)),
                figure: None,
            },
            Section {
                heading: "Comparison with Leria et al.",
                notes: vec![LERIA_NOTE.to_owned()],
                table: Some(leria_table(rows)),
                figure: None,
            },
        ];
        if args.report {
            page::write(&options.out, &title, &sections)?;
        }
        self.say(args.report)
    }

    /// Writes frames.csv and run.json, with all timed frames and the devices of the last count.
    fn write_run(&self) -> Result<(), Failure> {
        let Self { study: Study { options, loaded, .. }, devices, warm_up_s, frames, .. } = self;
        let (policies, rows): (Vec<_>, Vec<_>) = frames.iter().cloned().unzip();
        let policy = Csv::new(&[("seam_policy", |policy: &String| policy.clone())], &policies);
        policy.beside(FrameLine::csv_of(&rows)).write(&options.out.join("frames.csv"))?;
        let settings = settings::in_force(options, loaded.exposure_ev(), &[]);
        let devices = devices.last().map_or(&[][..], Vec::as_slice);
        let mut report =
            RunReport::new(settings, devices, &loaded.scene, loaded.needs, options.settings.skip_unused, rows);
        report.warm_up_s = *warm_up_s;
        Ok(report.write(&options.out.join("run.json"))?)
    }

    fn say(&self, report: bool) -> Result<(), Failure> {
        let Self { study: Study { options, reference, .. }, rows, .. } = self;
        if options.json {
            say!("{}", serde_json::json!({ "event": "result", "reference": reference.origin, "rows": rows }));
        } else if !options.quiet {
            say!("reference: {}", reference.origin);
            say!("{}\n{SEAM_NOTE}\n", seam_table(rows).text().trim_end());
            say!("{}\n{LERIA_NOTE}", leria_table(rows).text().trim_end());
            say!("{}seams.csv, frames.csv and run.json: {}", and_page(report), options.out.display());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::image::Extent;

    /// The compared greys are far above white at 0 EV, but not at the shot's exposure.
    #[test]
    fn seam_flip_uses_the_exposure_of_the_shot() {
        let grey = |value: f32| RgbImage::filled(Extent::new(12, 12), [value; 3]);
        let flips = |exposure_ev| {
            let found = seam_errors(&grey(1e6), &grey(5e5), &grey(2.5e5), &[6], exposure_ev).unwrap();
            [found.flip, found.flip_one]
        };
        let [white, shown] = [0.0, -20.0].map(flips);
        assert!(white.iter().all(|flip| *flip < 1e-3) && shown.iter().all(|flip| *flip > 0.1), "{white:?}, {shown:?}");
    }
}
