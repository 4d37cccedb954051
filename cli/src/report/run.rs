//! Writes `run.json`: the settings, the devices, and the measurements of each frame.

use std::fmt;
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use diptych::accumulation::Noise;
use diptych::device::DeviceInfo;
use diptych::exec::{Fault, PerView};
use diptych::image::ImageError;
use diptych::image::file::atomic_write;
use diptych::scene::Scene;
use diptych::scene::motion::Moves;
use diptych::scene::needs::SceneNeeds;

pub use super::frame_row::{FrameRow, FrameRows, StageSum, aov_ms};
use super::headset::HeadsetSummary;
use super::host::HostSummary;
use super::play::PlaySummary;
use super::rectified::RectifiedFrame;
use super::{median, median_of};
use crate::signals;

/// Settings of a run.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RunSettings {
    /// Command line, which reports show beside the settings.
    #[serde(skip)]
    pub command: String,
    /// Exposure at which pictures are tonemapped, stops.
    pub exposure_ev: f64,
    /// Effective value of each option of the command, by its long name in snake_case.
    #[serde(flatten)]
    pub options: serde_json::Map<String, serde_json::Value>,
}

#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SceneSummary {
    pub name: String,
    pub triangles: usize,
    pub instances: usize,
    pub lights: usize,
    pub textures: usize,
    /// Animated parts of the scene; absent if it is static.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moves: Option<Moves>,
    pub needs: SceneNeeds,
    /// Shader features compiled out because the scene lacks them.
    pub skipped: Vec<&'static str>,
    pub warnings: Vec<String>,
    /// Choices where the file says nothing, such as a viewpoint.
    pub notes: Vec<String>,
}

impl SceneSummary {
    /// Describes a scene. With `skips`, features that the scene lacks are compiled out.
    pub fn of(scene: &Scene, needs: SceneNeeds, skips: bool) -> Self {
        let skipped = needs.constants().into_iter().filter(|(_, needed)| skips && !needed).map(|(name, _)| name);
        Self {
            name: scene.name.clone(),
            triangles: scene.triangle_count(),
            instances: scene.instances.len(),
            lights: scene.lights.len(),
            textures: scene.textures.len(),
            moves: scene.motion.moves(),
            needs,
            skipped: skipped.collect(),
            warnings: scene.warnings.clone(),
            notes: scene.notes.clone(),
        }
    }
}

/// Progress of a frame's accumulation.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ReferenceRow {
    pub index: u32,
    /// Samples per pixel taken by this run and by the runs that it continues.
    pub spp: u32,
    pub spp_wanted: u32,
    /// Samples per pixel taken by earlier runs.
    pub spp_resumed: u32,
    pub pass_spp: u32,
    /// Number of passes of this run, and their total time.
    pub passes: u32,
    pub elapsed_s: f64,
    /// True if the time limit ended the accumulation.
    pub out_of_time: bool,
    /// Samples of both eyes that were not finite, including those of earlier runs.
    pub nonfinite_samples: u64,
    /// Noise of the accumulated image, estimated from the difference between even and odd passes; `null` for fewer than
    /// two passes.
    pub noise: Option<PerView<Noise>>,
}

impl fmt::Display for ReferenceRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.spp, self.spp_wanted) {
            (spp, wanted) if spp > wanted => write!(f, "{spp} samples per pixel, {wanted} were asked for")?,
            (spp, wanted) => write!(f, "{spp} of {wanted} samples per pixel")?,
        }
        if self.spp_resumed > 0 {
            write!(f, ", {} of them from earlier runs", self.spp_resumed)?;
        }
        write!(f, ", in {:.1} s", self.elapsed_s)?;
        if self.out_of_time {
            write!(f, ", ended by the time limit")?;
        }
        match self.nonfinite_samples {
            0 => Ok(()),
            n => write!(f, "; {n} samples were not finite and count as black"),
        }
    }
}

/// Report of a run: settings, devices, scene and frames.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RunReport<Rows: FrameRows = Vec<FrameRow>> {
    pub version: &'static str,
    pub command: String,
    pub settings: RunSettings,
    pub devices: Vec<DeviceInfo>,
    pub host: HostSummary,
    /// Fraction of the cores that other programs took while frames were rendered; `null` if it is not known, as in runs
    /// that are shorter than half a second.
    pub others_share: Option<f64>,
    pub scene: SceneSummary,
    /// Peak resident memory of the process so far, MiB. Absent if the system does not report it.
    pub peak_resident_mib: Option<f64>,
    /// Time from opening the devices until the first frame could begin. In this time, shaders are compiled, and `play`
    /// measures how long settings take.
    pub warm_up_s: f64,
    /// Number of frames that were rendered before the first reported one, to warm up.
    pub warm_up_frames: u32,
    #[serde(serialize_with = "FrameRows::serialize")]
    pub frames: Rows,
    /// Devices that were dropped.
    pub faults: Vec<Fault>,
    /// Names of the run's pictures, in the folder of this file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<String>,
    /// Progress of accumulated frames.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub references: Vec<ReferenceRow>,
    /// Summary of how well the run kept its time budget.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play: Option<PlaySummary>,
    /// Shared projection that eyes are resampled from; absent without display resampling.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rectified: Option<RectifiedFrame>,
    /// Summary of the frames that were shown in a headset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub headset: Option<HeadsetSummary>,
    /// True if a signal such as Ctrl-C ended the run; absent otherwise.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub interrupted: bool,
}

impl<Rows: FrameRows> RunReport<Rows> {
    pub fn new(
        mut settings: RunSettings,
        devices: &[DeviceInfo],
        scene: &Scene,
        needs: SceneNeeds,
        skips: bool,
        frames: Rows,
    ) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            command: std::mem::take(&mut settings.command),
            settings,
            devices: devices.to_vec(),
            host: HostSummary::here(),
            others_share: None,
            scene: SceneSummary::of(scene, needs, skips),
            peak_resident_mib: peak_resident_mib(),
            warm_up_s: 0.0,
            warm_up_frames: 0,
            frames,
            faults: Vec::new(),
            pictures: Vec::new(),
            references: Vec::new(),
            play: None,
            rectified: None,
            headset: None,
            interrupted: signals::is_set(),
        }
    }

    pub fn write(&self, path: &Path) -> Result<(), ImageError> {
        atomic_write(path, |file| {
            serde_json::to_writer_pretty(&mut *file, self)?;
            file.write_all(b"\n")
        })
    }

    /// Returns the number of devices that were not dropped.
    pub fn devices_left(&self) -> usize {
        self.devices.iter().filter(|d| self.faults.iter().all(|f| f.device != d.index)).count()
    }
}

impl RunReport {
    /// Returns the number of rays per second of rendering. The time of a frame is its makespan, without the part that
    /// overlaps with the previous frame. If there are several frames, the first one does not count, because its caches
    /// are cold and the scheduler has not yet learned how to distribute the rows.
    pub fn rays_per_s(&self) -> Option<f64> {
        let counted = &self.frames[usize::from(self.frames.len() > 1)..];
        let own_ms = |f: &FrameRow| f.interval_ms.map_or(f.makespan_ms, |i| i.min(f.makespan_ms));
        let (rays, ms) = counted.iter().fold((0, 0.0), |(rays, ms), f| (rays + f.rays, ms + own_ms(f)));
        (ms > 0.0).then(|| rays as f64 / ms * 1e3)
    }

    /// Returns the median time between the ends of consecutive frames, ms. The last `frames_in_flight` − 1 frames do
    /// not count, because no further frames competed with them for the devices.
    pub fn median_interval_ms(&self, frames_in_flight: u32) -> Option<f64> {
        let alone = (frames_in_flight as usize).saturating_sub(1);
        let frames = &self.frames[..self.frames.len().saturating_sub(alone)];
        let intervals: Vec<f64> = frames.iter().filter_map(|f| f.interval_ms).collect();
        median(intervals)
    }

    /// Returns the median of the frames' makespans, ms.
    pub fn median_makespan_ms(&self) -> f64 {
        median_of(self.frames.iter().map(|f| f.makespan_ms).collect())
    }
}

/// Returns the peak resident memory in MiB, from `VmHWM` in Linux's `/proc/self/status`.
fn peak_resident_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib / 1024.0)
}
