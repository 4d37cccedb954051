//! `diptych bench --preset bmfr`: dropping linearly dependent features from the fit, against adding noise to all
//! features and against `svgf`. The renderers take turns.

use crate::device::DeviceInfo;
use crate::quality::{Denoiser, Quality};
use crate::report::Table;
use crate::report::bmfr::{DENOISERS, NOTE, Row, bmfr_csv, bmfr_table, cited};
use crate::report::csv::{Column, Csv};
use crate::report::frames::FrameLine;

use super::args::Args;
use super::findings::{Findings, section};
use super::judge::Judge;
use super::over_shots::over_shots;
use super::reference::own;
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::RenderOptions;
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Tracing};

pub const REFUSES: &[&str] = &["size_factor", "instants", "frames", "simulate", "fresh"];

fn quality(denoiser: Denoiser) -> Quality {
    let iterations = [Denoiser::DEFAULT_ITERATIONS.min(denoiser.most_iterations()); 3];
    Quality { spp: 1, bounces: 6, denoiser: Some(denoiser), iterations, fovea: None, polar: None, scale: 1.0 }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let frames = DENOISERS.map(|denoiser| u64::from(args.frames_of(&quality(denoiser)))).iter().sum();
    let mut found = Found::default();
    over_shots(args, frames, |args, progress, tracing| found.measure(args, progress, tracing))?;
    found.write(args)
}

#[derive(Default)]
struct Found {
    rows: Vec<Row>,
    /// Timed frames, each with its shot and denoiser.
    frames: Vec<([String; 2], FrameLine)>,
    devices: Vec<DeviceInfo>,
    /// A note on each reference.
    notes: Vec<String>,
}

impl Found {
    /// Measures all denoisers on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let options = &args.options;
        let loaded = setup::load(options)?;
        let reference = own(args, &loaded, tracing, None)?;
        interrupt::check()?;
        self.notes.push(reference.note(&options.shot, options.size));
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        for denoiser in DENOISERS {
            let name = format!("{} of {}", Denoiser::name_of(Some(denoiser)), options.shot);
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            turns.add(name, RenderOptions::single(options.clone(), &quality(denoiser)), gpus)?;
        }
        let mut judges = DENOISERS.map(|_| Judge::new(&loaded, &reference, options.time));
        // All of these denoisers keep a history, so they have the same number of warm-up frames.
        let of_all = quality(Denoiser::SVGF);
        for i in 0..args.frames_of(&of_all) {
            let time_s = args.time_s(&of_all, i);
            let frames = turns.render(time_s, i)?;
            let Some(number) = i.checked_sub(args.warm_up_of(&of_all)) else { continue };
            for (which, frame) in frames.iter().enumerate() {
                let row = turns.keep(which, time_s, frame, number);
                judges[which].add(frame, &row, &turns.renderers[which].read_linear()?)?;
            }
        }
        for (denoiser, judge) in DENOISERS.into_iter().zip(judges) {
            let measured = judge.conclude();
            let of = [options.shot.clone(), Denoiser::name_of(Some(denoiser)).to_owned()];
            self.frames.extend(measured.frames.iter().map(|line| (of.clone(), line.clone())));
            self.rows.push(Row::measured(options.shot.clone(), denoiser, &measured));
        }
        self.devices = turns.renderers[0].devices().to_vec();
        Ok(())
    }

    fn write(mut self, args: &Args) -> Result<(), Failure> {
        self.rows.extend(cited());
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns: [Column<[String; 2]>; 2] =
            [("shot", |[shot, _]| shot.clone()), ("denoiser", |[_, denoiser]| denoiser.clone())];
        let frames = Csv::new(&columns, &of).beside(FrameLine::csv(&lines));
        let notes = [NOTE.to_owned()].into_iter().chain(self.notes).collect();
        Findings {
            title: format!("Dependent features of bmfr, at {}", args.options.size),
            rows: &self.rows,
            files: vec![("bmfr.csv", bmfr_csv(&self.rows)), ("frames.csv", frames)],
            run: None,
            tables: vec![section("Features left out, and noise", notes, bmfr_table(&self.rows))],
            more: vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))],
        }
        .write(args)
    }
}
