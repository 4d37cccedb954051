//! Results of `diptych scale`: rows, files and the page.

use anyhow::Context;

use crate::failure::Failure;
use crate::options::RenderOptions;
use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::lanes::median_frame;
use crate::report::run::{FrameRow, RunReport, RunSettings};
use crate::report::scale::chart::{scale_sections, scale_svg};
use crate::report::scale::{ScaleRow, scale_csv};
use crate::report::simulation::{self, simulation_svg, simulation_table};
use crate::report::{Csv, Table};
use crate::simulate::Learned;
use crate::{interrupt, output, page, settings};
use diptych::device::DeviceInfo;
use diptych::loaded::LoadedScene;

use super::quiet::Quiet;
use super::seen::Seen;
use super::turns::{Measuring, Subject};

/// Returns the number of threads of each device, if it is known and the same for all.
fn common_threads(devices: &[DeviceInfo]) -> Option<usize> {
    let (first, others) = devices.split_first()?;
    first.threads.filter(|_| others.iter().all(|other| other.threads == first.threads))
}

/// Results of all counts.
#[derive(Default)]
pub struct Results {
    pub rows: Vec<ScaleRow>,
    /// Devices of each row.
    devices: Vec<Vec<DeviceInfo>>,
    warm_up_s: f64,
    pub others_share: Option<f64>,
    /// Timed frames of all counts.
    frames: Vec<FrameRow>,
    policies: Vec<String>,
    pub learned: Vec<Learned>,
    pub simulated: Vec<simulation::SimulationRow>,
    seen: Seen,
}

impl Results {
    /// Creates results without rows, after a warm-up that took this long.
    pub fn new(warm_up_s: f64) -> Self {
        Self { warm_up_s, ..Self::default() }
    }

    /// Adds the results of a number of devices. Of its frames, those of quiet turns count.
    pub fn add(&mut self, of: &Measuring<'_>, subject: Subject, quiet: &Quiet) -> Result<(), Failure> {
        let Measuring { args, options, loaded, .. } = of;
        let Subject { options: own, frames, costs, mut renderer, oversubscribed, .. } = subject;
        let (infos, policy) = (renderer.devices().to_vec(), renderer.policy_name().to_owned());
        let area = |options: &RenderOptions| options.settings.size.area() as f64;
        let mut row = ScaleRow::new(infos.len(), area(&own) / area(options), &quiet.of_turns(&frames));
        row.policy.clone_from(&policy);
        (row.threads_per_device, row.others_share) = (common_threads(&infos), quiet.others_share);
        row.oversubscribed = oversubscribed;
        self.rows.push(row.over(self.rows.first()));
        let quality = options.quality();
        self.frames.extend(frames.iter().zip(0..).map(|(frame, index)| {
            let row = FrameRow::new(frame, &quality, &loaded.shot.rig, args.time_s(frame.index));
            FrameRow { index, ..row }
        }));
        self.policies.resize(self.frames.len(), policy.clone());
        let costs = quiet.of_turns(&costs);
        let spec = frames.last().map(|frame| frame.spec.clone()).context("no frame was timed")?;
        self.learned.push(Learned { devices: infos.len(), policy, oversubscribed, spec, costs });
        self.devices.push(infos);
        if args.report {
            let makespans_ms: Vec<f64> = frames.iter().map(|f| f.makespan_ms).collect();
            let shown = frames.into_iter().nth(median_frame(&makespans_ms));
            // A signal may leave frames in flight, and counts with different last frames.
            let picture = (!interrupt::is_set()).then(|| renderer.read_linear()).transpose()?;
            self.seen.add(picture, shown);
        }
        Ok(())
    }

    /// Writes frames.csv and run.json with all timed frames and the devices of the largest count, which include those
    /// of smaller counts.
    pub fn write_run(&mut self, options: &RenderOptions, loaded: &LoadedScene) -> Result<(), Failure> {
        let settings = self.settings(options, loaded.exposure_ev());
        let devices = self.devices.last().map_or(&[][..], Vec::as_slice);
        let frames = std::mem::take(&mut self.frames);
        let mut report =
            RunReport::new(settings, devices, &loaded.scene, loaded.needs, options.settings.skip_unused, frames);
        (report.warm_up_s, report.others_share) = (self.warm_up_s, self.others_share);
        let mut csv = FrameLine::csv_of(&report.frames);
        if options.settings.balances().len() > 1 {
            csv = csv.beside(Csv::new(&[("policy", |policy: &String| policy.clone())], &self.policies));
        }
        csv.write(&options.out.join("frames.csv"))?;
        Ok(report.write(&options.out.join("run.json"))?)
    }

    /// Writes scale.csv and scale.svg; returns the plot.
    pub fn write_rows(&self, options: &RenderOptions) -> Result<String, Failure> {
        scale_csv(&self.rows).write(&options.out.join("scale.csv"))?;
        let title = format!("Speed-up of {} at {}", options.shot, options.settings.size);
        let figure = scale_svg(title, &self.rows).context("cannot draw the plot")?;
        output::write_text(&options.out, "scale.svg", &figure)?;
        Ok(figure)
    }

    pub fn write_page(&self, options: &RenderOptions, loaded: &LoadedScene, figure: String) -> Result<(), Failure> {
        let title = format!("{} at {} over device counts", options.shot, options.settings.size);
        let mut sections: Vec<Section> = self.seen.pictures(loaded)?.into_iter().collect();
        sections.extend(scale_sections(&self.rows, figure));
        if !self.simulated.is_empty() {
            sections.push(self.simulation(options)?);
        }
        sections.push(self.seen.swimlanes(&self.rows)?);
        sections.extend(self.settings_and_devices(options, loaded.exposure_ev()));
        sections.push(page::scene(options, loaded));
        page::write(&options.out, &title, &sections)
    }

    /// Returns the options in force, with the threads of the devices if all have the same number.
    fn settings(&self, options: &RenderOptions, exposure_ev: f64) -> RunSettings {
        let mut settings = settings::in_force(options, exposure_ev, &[]);
        let devices: Vec<DeviceInfo> = self.devices.iter().flatten().cloned().collect();
        if let Some(threads) = common_threads(&devices) {
            settings.options.insert("threads_per_device".to_owned(), threads.into());
        }
        settings
    }

    fn settings_and_devices(&self, options: &RenderOptions, exposure_ev: f64) -> [Section; 2] {
        let mut table = Table::of_fields(&self.settings(options, exposure_ev));
        let frames = self.rows.first().map_or(0, |r| r.frames);
        table.rows.push(vec!["timed_frames".to_owned(), frames.to_string()]);
        let devices = Table::of_devices(self.devices.iter().map(Vec::as_slice));
        let section = |heading, table| Section { heading, table: Some(table), ..Section::default() };
        [section("Settings", table), section("Devices", devices)]
    }

    fn simulation(&self, options: &RenderOptions) -> Result<Section, Failure> {
        let title = format!("Simulated speed-up of {} at {}", options.shot, options.settings.size);
        let figure = simulation_svg(title, &self.simulated).context("cannot draw the plot of the simulation")?;
        let notes = "Frames simulated on a virtual clock, with the costs measured on as many devices, or else on the \
            largest number of devices that does not exceed the cores. Off by: deviation from the measured makespan. \
            Speed-up: relative to the measured frames of one device, as in the table of measured counts; the ideal is \
            the sum of speeds. Critical path: the chain of dependent tasks that determines the frame time.";
        Ok(Section {
            heading: "Simulation",
            notes: vec![notes.to_owned()],
            table: Some(simulation_table(&self.simulated)),
            figure: Some(figure),
        })
    }
}
