//! Writes `run.json`: the settings, the devices, and the measurements of each frame.

use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::path::Path;

use serde::Serialize;
use serde::ser::{Error, SerializeSeq, Serializer};

use crate::accumulation::Noise;
use crate::device::DeviceInfo;
use crate::exec::{Fault, FrameReport, RightEye, Stereo, TaskTiming, TimedTask};
use crate::graph::{Seam, Stage};
use crate::image::ImageError;
use crate::image::file::atomic_write;
use crate::passes::AOVS;
use crate::passes::path_trace::CUT;
use crate::quality::{FrameQuality, Quality};
use crate::scene::Scene;
use crate::scene::motion::Moves;
use crate::scene::needs::SceneNeeds;
use crate::scene::projection::Matrices;
use crate::scene::rig::{Eye, Rig};
use crate::trace::intervals;

use super::headset::{HeadsetRow, HeadsetSummary};
use super::lanes::round;
use super::play::{ControlRow, PlaySummary};
use super::rectified::RectifiedFrame;
use super::{median, median_of, once};

/// Settings of a run.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RunSettings {
    /// Exposure for showing pictures, stops.
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
    /// Number of passes of this run, and their time.
    pub passes: u32,
    pub elapsed_s: f64,
    /// True if the time limit ended it.
    pub out_of_time: bool,
    /// Samples of both eyes that were not finite, including those of earlier runs.
    pub nonfinite_samples: u64,
    /// Standard error of the mean; `null` for fewer than two passes.
    pub noise: Option<Stereo<Noise>>,
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

/// Work of a device on one stage and view of a frame. Transfers of rows are the stages `download` and `upload`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StageSum {
    pub stage: &'static str,
    pub view: Eye,
    pub device: usize,
    /// Rounded to microseconds.
    pub busy_ms: f64,
    /// Bytes of transfers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
}

impl StageSum {
    /// Returns the sums in the order of their first tasks.
    fn of(tasks: &[TaskTiming]) -> Vec<Self> {
        let mut sums: Vec<Self> = Vec::new();
        for &TaskTiming { kind, view, device, begin_ms, end_ms, bytes, .. } in tasks {
            let stage = match kind {
                TimedTask::Gpu(stage) => stage.name(),
                TimedTask::Download => "download",
                TimedTask::Upload => "upload",
            };
            let busy_ms = end_ms - begin_ms;
            match sums.iter_mut().find(|s| (s.stage, s.view, s.device) == (stage, view, device)) {
                Some(sum) => {
                    sum.busy_ms += busy_ms;
                    sum.bytes = sum.bytes.zip(bytes).map(|(sum, more)| sum + more);
                }
                None => sums.push(Self { stage, view, device, busy_ms, bytes }),
            }
        }
        sums.iter_mut().for_each(|sum| sum.busy_ms = round(sum.busy_ms));
        sums
    }
}

/// Returns the time of auxiliary images, milliseconds: of their passes and transfers, on the device on which they took
/// longest.
pub fn aov_ms(tasks: &[TaskTiming]) -> f64 {
    let of = |device: usize| {
        let own = tasks.iter().filter(|t| t.device == device && AOVS.iter().any(|stage| t.stage == stage.name()));
        intervals::length(&intervals::union(own.map(|t| (t.begin_ms, t.end_ms)).collect()))
    };
    once(tasks.iter().map(|t| t.device)).into_iter().map(of).fold(0.0, f64::max)
}

/// Measurements of a frame. For a reference, the numbers are sums over this run's passes, except that stages, tasks and
/// `aov_ms` describe the last pass.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct FrameRow {
    pub index: u32,
    /// Scene time of the frame.
    pub time_s: f64,
    /// Camera of each eye.
    pub cameras: Stereo<Matrices>,
    /// Number of devices that rendered it.
    pub devices: usize,
    /// Time from the begin of the frame to the complete images on the primary, without `aov_ms`.
    pub makespan_ms: f64,
    /// Time from the end of the previous frame to the end of this one; `null` for the first frame and for a reference.
    pub interval_ms: Option<f64>,
    /// Makespan predicted by the cost model, without `aov_ms`. It is `null` before the model has learned from a frame,
    /// and for frames in flight together.
    pub predicted_ms: Option<f64>,
    /// Time of passes and transfers of auxiliary images, on the device on which they took longest.
    pub aov_ms: f64,
    /// Host time for distributing rows and building the graph.
    pub plan_ms: f64,
    #[serde(flatten)]
    pub quality: FrameQuality,
    pub rays: u64,
    /// Origin of the right eye's pixels, if it is reprojected.
    #[serde(flatten)]
    pub right_eye: Option<RightEye>,
    pub nonfinite_samples: u64,
    /// Traced pixels of both eyes whose demodulated illumination was clipped to the range of half floats, 65504 times
    /// white. Only `svgf` with specular surfaces stores half floats.
    pub clipped_pixels: u64,
    /// Rows of the left eye's path tracing per device.
    pub stripes: Vec<u32>,
    /// Rows per device of every stage and view that ran.
    pub stage_stripes: BTreeMap<String, Vec<u32>>,
    pub transferred_bytes: u64,
    /// Transferred bytes between processes, in a run of several.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_between_ranks: Option<u64>,
    /// Rows up and down within which history was searched; `null` without history.
    pub history_rows: Option<u32>,
    /// Filter passes that are preceded by a halo exchange.
    pub halo_exchanges: Vec<usize>,
    pub stages: Vec<StageSum>,
    /// Tasks, with times since the begin of the frame. Only with `--details`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tasks: Vec<TaskTiming>,
    /// Decision of the control loop, for frames with a time budget.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlRow>,
    /// Timing in a headset, if the frame was shown in one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub headset: Option<HeadsetRow>,
    /// Number of dynamic bodies that the frame omits, because they were too small, too stretched or too far away.
    pub bodies_left_out: u32,
}

impl FrameRow {
    /// Creates the row of a frame that `rig` sees at `time_s`.
    pub fn new(frame: &FrameReport, quality: &Quality, rig: &Rig, time_s: f64) -> Self {
        let matrices =
            |eye| rig.matrices(time_s, eye, frame.spec.shown.or(frame.spec.screen).unwrap_or(frame.spec.extent));
        let rows_of = |group, view| {
            let stripes = frame.assignment.stripes(group, view);
            (0..stripes.devices()).map(|d| stripes.rows(d).len() as u32).collect::<Vec<u32>>()
        };
        let ran = frame.tasks.iter().filter_map(|t| match t.kind {
            TimedTask::Gpu(stage) => Some((stage, t.view)),
            TimedTask::Download | TimedTask::Upload => None,
        });
        let passes = || frame.program.passes().iter().map(|p| &p.pass);
        let group_of = |stage, view| passes().find(|p| (p.stage, p.view) == (stage, view)).map(|p| p.cut_group);
        let rows = |(s, v): (Stage, Eye)| Some((format!("{}.{v}", s.name()), rows_of(group_of(s, v)?, v)));
        let stage_stripes = once(ran).into_iter().filter_map(rows).collect();
        let aov_ms = aov_ms(&frame.tasks);
        Self {
            index: frame.index,
            time_s,
            cameras: Stereo { left: matrices(Eye::Left), right: matrices(Eye::Right) },
            devices: frame.devices.len(),
            makespan_ms: frame.makespan_ms - aov_ms,
            interval_ms: frame.interval_ms,
            predicted_ms: frame.predicted_ms.map(|ms| ms - aov_ms),
            aov_ms: round(aov_ms),
            plan_ms: frame.plan_ms,
            quality: quality.into(),
            rays: frame.tallies.iter().map(|t| t.rays).sum(),
            right_eye: frame.right_eye(),
            nonfinite_samples: frame.tallies.iter().map(|t| t.nonfinite).sum(),
            clipped_pixels: frame.tallies.iter().map(|t| t.clipped).sum(),
            stripes: rows_of(CUT, Eye::Left),
            stage_stripes,
            transferred_bytes: frame.uploaded_bytes(),
            bytes_between_ranks: frame.bytes_between_ranks(),
            history_rows: frame.spec.history_rows,
            halo_exchanges: match frame.spec.seam {
                Seam::Halo(plan) => (0..frame.program.links()).filter(|i| plan.receives_before(*i)).collect(),
                Seam::None | Seam::Filter => Vec::new(),
            },
            stages: StageSum::of(&frame.tasks),
            tasks: Vec::new(),
            control: None,
            headset: None,
            bodies_left_out: frame.bodies_left_out,
        }
    }

    /// Adds the frame's tasks.
    pub fn with_tasks(self, frame: &FrameReport) -> Self {
        Self { tasks: frame.tasks_since_begin(), ..self }
    }
}

/// Rows of frames, in memory or in a file.
pub trait FrameRows {
    /// Serializes the rows as a list, each on one line: a frame has hundreds of numbers.
    ///
    /// # Errors
    /// Errors of the serializer and of reading the file.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error>;
}

impl FrameRows for Vec<FrameRow> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let line = |row| serde_json::value::to_raw_value(row).map_err(S::Error::custom);
        let mut list = serializer.serialize_seq(Some(self.len()))?;
        self.iter().try_for_each(|row: &FrameRow| list.serialize_element(&line(row)?))?;
        list.end()
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
    pub scene: SceneSummary,
    /// Peak resident memory of the process so far, MiB. Absent if the system does not report it.
    pub peak_resident_mib: Option<f64>,
    /// Time from opening the devices until the first frame could begin. Shaders are compiled in this time, and `play`
    /// times settings.
    pub warm_up_s: f64,
    /// Number of frames before the first one that is kept.
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
    /// Summary of the time budget.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play: Option<PlaySummary>,
    /// Shared projection that eyes are resampled from; absent without display resampling.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rectified: Option<RectifiedFrame>,
    /// Summary of the frames that were shown in a headset.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub headset: Option<HeadsetSummary>,
}

impl<Rows: FrameRows> RunReport<Rows> {
    pub fn new(
        settings: RunSettings,
        devices: &[DeviceInfo],
        scene: &Scene,
        needs: SceneNeeds,
        skips: bool,
        frames: Rows,
    ) -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            command: std::env::args().collect::<Vec<_>>().join(" "),
            settings,
            devices: devices.to_vec(),
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
    /// Returns the number of rays over the devices' working time: the makespans, without the parts that overlap with
    /// the previous frame. Of several frames, the first does not count, because caches are cold and the distribution of
    /// rows is not learned yet.
    pub fn rays_per_s(&self) -> Option<f64> {
        let counted = &self.frames[usize::from(self.frames.len() > 1)..];
        let own_ms = |f: &FrameRow| f.interval_ms.map_or(f.makespan_ms, |i| i.min(f.makespan_ms));
        let (rays, ms) = counted.iter().fold((0, 0.0), |(rays, ms), f| (rays + f.rays, ms + own_ms(f)));
        (ms > 0.0).then(|| rays as f64 / ms * 1e3)
    }

    /// Returns the median time between the ends of consecutive frames, ms. The last frames in flight do not count,
    /// because they had the devices to themselves in the end.
    pub fn median_interval_ms(&self, frames_in_flight: u8) -> Option<f64> {
        let alone = usize::from(frames_in_flight).saturating_sub(1);
        let frames = &self.frames[..self.frames.len().saturating_sub(alone)];
        let intervals: Vec<f64> = frames.iter().filter_map(|f| f.interval_ms).collect();
        median(intervals)
    }

    /// Returns the median of the frames' makespans, ms.
    pub fn median_makespan_ms(&self) -> f64 {
        median_of(self.frames.iter().map(|f| f.makespan_ms).collect())
    }
}

/// Reads `VmHWM` of Linux.
fn peak_resident_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib / 1024.0)
}
