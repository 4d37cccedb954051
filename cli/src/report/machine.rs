//! The report of `diptych info --check`: how fast a machine renders, and whether its images are right.

use std::collections::BTreeMap;

use serde::Serialize;

use super::host::HostSummary;
use super::html::Section;
use super::plot::{Chart, Series, line_chart_svg};
use super::{ReportError, Table, median, median_of, once, percent};
use diptych::device::{AdapterReport, Traversal};
use diptych::exec::FrameReport;
use diptych::image::Extent;
use diptych::quality::Quality;

/// The results of `diptych info --check`, written as `machine.json`.
#[derive(Debug, Default, Serialize)]
pub struct Machine {
    pub diptych: &'static str,
    /// Logical processors.
    pub cores: usize,
    pub host: HostSummary,
    pub adapters: Vec<AdapterReport>,
    /// Quality of the timed frames.
    pub quality: Quality,
    pub frames: Vec<FrameTimes>,
    pub largest: Vec<LargestSize>,
    pub scaling: Vec<Scaled>,
    pub images: Vec<ImageCheck>,
    /// Measurements that were left out because they would have taken too long.
    pub left_out: Vec<String>,
    pub seconds: f64,
}

/// Times of frames of one device.
#[derive(Clone, Debug, Serialize)]
pub struct FrameTimes {
    pub adapter: usize,
    pub traversal: Traversal,
    pub scene: String,
    /// Size of each eye's image.
    pub size: String,
    pub pixels: u64,
    /// Number of timed frames.
    pub frames: usize,
    pub median_ms: f64,
    pub least_ms: f64,
    pub most_ms: f64,
    /// Busy time by stage in the median frame.
    pub stage_ms: BTreeMap<String, f64>,
    /// Median error of the predicted frame time, relative to the measured one.
    pub predicted_off: Option<f64>,
}

/// The largest size, of those tried, at which frames take at most a given time.
#[derive(Clone, Debug, Serialize)]
pub struct LargestSize {
    pub adapter: usize,
    pub scene: String,
    pub within_ms: f64,
    /// `None` if frames of all sizes that were tried take longer.
    pub size: Option<String>,
    pub median_ms: Option<f64>,
}

/// Frame times of several devices.
#[derive(Clone, Debug, Serialize)]
pub struct Scaled {
    pub scene: String,
    pub size: String,
    pub devices: usize,
    /// True if the devices are on the same adapter.
    pub share_adapter: bool,
    pub median_ms: f64,
    /// Time of one device over this time.
    pub speedup: f64,
}

/// Mean luminance of the blocks of an image, against stored means.
#[derive(Clone, Debug, Serialize)]
pub struct ImageCheck {
    pub adapter: usize,
    pub traversal: Traversal,
    pub scene: String,
    /// Rows of blocks, one after another.
    pub means: Vec<f64>,
    /// Largest difference from the stored means, relative to the image's mean.
    pub off: f64,
    pub is_right: bool,
}

impl FrameTimes {
    /// Summarises frames of one device, of which there is at least one.
    pub fn of(frames: &[FrameReport], (adapter, traversal): (usize, Traversal), scene: &str, size: Extent) -> Self {
        let mut sorted: Vec<&FrameReport> = frames.iter().collect();
        sorted.sort_by(|a, b| a.makespan_ms.total_cmp(&b.makespan_ms));
        let off = |f: &FrameReport| Some((f.predicted_ms? / f.makespan_ms - 1.0).abs());
        let time = |f: Option<&&FrameReport>| f.map_or(0.0, |f| f.makespan_ms);
        Self {
            adapter,
            traversal,
            scene: scene.to_owned(),
            size: size.to_string(),
            pixels: size.area() as u64,
            frames: frames.len(),
            median_ms: median_of(frames.iter().map(|f| f.makespan_ms).collect()),
            least_ms: time(sorted.first()),
            most_ms: time(sorted.last()),
            stage_ms: sorted.get(sorted.len() / 2).map(|f| f.stage_ms()).unwrap_or_default(),
            predicted_off: median(frames.iter().filter_map(off).collect()),
        }
    }
}

fn ms(value: f64) -> String {
    let digits = if value < 10.0 { 2 } else { usize::from(value < 100.0) };
    format!("{value:.digits$}")
}

impl Machine {
    fn adapters_table(&self) -> Table {
        let row = |a: &AdapterReport| {
            let state =
                if a.missing.is_empty() { "ready".to_owned() } else { format!("lacks {}", a.missing.join(", ")) };
            let queries = if a.ray_queries { "yes" } else { "no" }.to_owned();
            vec![a.index.to_string(), a.name.clone(), a.kind.clone(), a.driver.clone(), queries, state]
        };
        let headers = vec!["#", "adapter", "kind", "driver", "ray queries", "state"];
        Table { headers, rows: self.adapters.iter().map(row).collect() }
    }

    pub fn frames_table(&self) -> Table {
        let row = |f: &FrameTimes| {
            let [median, least, most] = [f.median_ms, f.least_ms, f.most_ms].map(ms);
            let off = f.predicted_off.map_or("-".to_owned(), percent);
            let traversal = f.traversal.name().to_owned();
            vec![f.adapter.to_string(), traversal, f.scene.clone(), f.size.clone(), median, least, most, off]
        };
        let headers = vec!["adapter", "traversal", "scene", "size", "frame, ms", "least", "most", "predicted off by"];
        Table { headers, rows: self.frames.iter().map(row).collect() }
    }

    fn stages_table(&self) -> Table {
        let largest = |f: &&FrameTimes| {
            let is_same = |g: &&FrameTimes| (g.adapter, g.traversal, &g.scene) == (f.adapter, f.traversal, &f.scene);
            self.frames.iter().filter(is_same).all(|g| g.pixels <= f.pixels)
        };
        let rows = self.frames.iter().filter(largest).flat_map(|f| {
            let sum: f64 = f.stage_ms.values().sum();
            let mut stages: Vec<_> = f.stage_ms.iter().collect();
            stages.sort_by(|a, b| b.1.total_cmp(a.1));
            let row = move |(stage, time): (&String, &f64)| {
                let part = percent(time / sum.max(1e-9));
                let traversal = f.traversal.name().to_owned();
                vec![f.adapter.to_string(), traversal, f.scene.clone(), f.size.clone(), stage.clone(), ms(*time), part]
            };
            stages.into_iter().map(row).collect::<Vec<_>>()
        });
        let headers = vec!["adapter", "traversal", "scene", "size", "stage", "ms", "of all stages"];
        Table { headers, rows: rows.collect() }
    }

    pub fn largest_table(&self) -> Table {
        let row = |l: &LargestSize| {
            let size = l.size.clone().unwrap_or_else(|| "none tried".to_owned());
            let time = l.median_ms.map_or("-".to_owned(), ms);
            vec![l.adapter.to_string(), l.scene.clone(), l.within_ms.to_string(), size, time]
        };
        let headers = vec!["adapter", "scene", "within, ms", "largest size", "frame, ms"];
        Table { headers, rows: self.largest.iter().map(row).collect() }
    }

    pub fn scaling_table(&self) -> Table {
        let row = |s: &Scaled| {
            let on = match (s.devices, s.share_adapter) {
                (1, _) => "one adapter",
                (_, true) => "the same adapter",
                (_, false) => "an adapter each",
            };
            let of = [s.scene.clone(), s.size.clone(), s.devices.to_string()];
            of.into_iter().chain([on.to_owned(), ms(s.median_ms), format!("{:.2}", s.speedup)]).collect()
        };
        let headers = vec!["scene", "size", "devices", "on", "frame, ms", "speed-up"];
        Table { headers, rows: self.scaling.iter().map(row).collect() }
    }

    pub fn images_table(&self) -> Table {
        let row = |c: &ImageCheck| {
            let right = if c.is_right { "yes" } else { "NO" }.to_owned();
            vec![c.adapter.to_string(), c.traversal.name().to_owned(), c.scene.clone(), percent(c.off), right]
        };
        let headers = vec!["adapter", "traversal", "scene", "off by at most", "right"];
        Table { headers, rows: self.images.iter().map(row).collect() }
    }

    fn chart(&self) -> Result<String, ReportError> {
        let keys = once(self.frames.iter().map(|f| (f.adapter, f.traversal, f.scene.as_str())));
        let series = keys.into_iter().map(|(adapter, traversal, scene)| {
            let own = self
                .frames
                .iter()
                .filter(|f| (f.adapter, f.traversal, f.scene.as_str()) == (adapter, traversal, scene));
            Series {
                name: format!("{scene}, adapter {adapter}, {}", traversal.name()),
                points: own.clone().map(|f| (f.pixels as f64, f.median_ms)).collect(),
                band: Some(own.map(|f| (f.least_ms, f.most_ms)).collect()),
                ..Series::default()
            }
        });
        let chart = Chart::new("Frame times".to_owned(), ["pixels of each eye", "ms"], true);
        line_chart_svg(&chart, &series.collect::<Vec<_>>())
    }

    /// Returns the sections of the page.
    ///
    /// # Errors
    /// [`ReportError`] if no frame was timed, or the chart cannot be drawn.
    pub fn sections(&self) -> Result<Vec<Section>, ReportError> {
        let section = |heading, note: String, table: Table| Section {
            heading,
            notes: vec![note],
            table: Some(table),
            figure: None,
        };
        let Quality { spp, bounces, .. } = self.quality;
        let times = format!(
            "Makespan of frames of both eyes on one device, at {spp} sample per pixel, {bounces} bounces and the default \
             denoiser, from the plan until both images are complete; the camera moves. Predicted off by: median error of \
             the cost model's prediction."
        );
        let right = "Mean luminance of eight blocks of the left eye's image without a denoiser, against means that are \
                     stored in diptych.";
        let scaling = "Frame times of the first GPU or software driver alone, and of several devices. Devices on the \
                       same adapter share it, so their speed-up tells how well stripes and transfers work, not how fast \
                       several adapters would be. On a software driver, each device has its own part of the cores.";
        let mut sections = vec![
            section("Adapters", format!("{} logical processors.", self.cores), self.adapters_table()),
            Section { figure: Some(self.chart()?), ..section("Frame times", times, self.frames_table()) },
            section("Largest sizes within a budget", "Sizes of each eye's image, 16:9.".into(), self.largest_table()),
            section("Stages", "The median frame of the largest size that was timed.".into(), self.stages_table()),
            section("Scaling", scaling.into(), self.scaling_table()),
            section("Images", right.into(), self.images_table()),
        ];
        if !self.left_out.is_empty() {
            let notes = self.left_out.clone();
            sections.push(Section { heading: "Left out", notes, ..Section::default() });
        }
        Ok(sections)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn machine_page_lists_stages_and_omissions() {
        let frame = |size: &str, pixels, median_ms| FrameTimes {
            adapter: 0,
            traversal: Traversal::Compute,
            scene: "cornell".into(),
            size: size.into(),
            pixels,
            frames: 3,
            median_ms,
            least_ms: median_ms,
            most_ms: 2.0 * median_ms,
            stage_ms: [("path_trace".to_owned(), 0.75 * median_ms), ("gbuffer".to_owned(), 0.25 * median_ms)].into(),
            predicted_off: None,
        };
        let machine = Machine {
            host: HostSummary::here(),
            diptych: "0",
            cores: 2,
            adapters: Vec::new(),
            quality: Quality::default(),
            frames: vec![frame("32x18", 576, 4.0), frame("64x36", 2304, 120.0)],
            largest: vec![LargestSize {
                adapter: 0,
                scene: "cornell".into(),
                within_ms: 11.0,
                size: None,
                median_ms: None,
            }],
            scaling: Vec::new(),
            images: Vec::new(),
            left_out: vec!["cornell at 128x72".into()],
            seconds: 1.0,
        };
        let stages = machine.stages_table();
        assert_eq!(stages.rows.len(), 2);
        assert_eq!(stages.rows[0][3..], ["64x36", "path_trace", "90.0", "75.0 %"]);
        assert_eq!(machine.largest_table().rows[0][2..], ["11", "none tried", "-"]);
        let sections = machine.sections().unwrap();
        assert_eq!(sections.last().map(|s| (s.heading, s.notes.len())), Some(("Left out", 1)));
    }
}
