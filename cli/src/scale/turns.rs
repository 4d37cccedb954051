//! Measures device counts in turns: each renders a timed frame before any renders the next one, so that other load on
//! the machine affects all of them alike. The counts share devices, which compile their pipelines once.

use crate::bench::axes::order;
use crate::core_time::CoreTime;
use crate::failure::Failure;
use crate::faults::refuse_faults;
use crate::options::RenderOptions;
use crate::progress::Progress;
use crate::report::run::aov_ms;
use crate::setup::{self, Tracing};
use crate::{console, interrupt};
use diptych::device::DeviceInfo;
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, Renderer};
use diptych::loaded::LoadedScene;
use diptych::schedule::CostModel;
use diptych::trace::frames::record_devices;

use super::args::Args;

/// Inputs that all counts share.
pub struct Measuring<'a> {
    pub args: &'a Args,
    /// Options with all requested policies.
    pub options: &'a RenderOptions,
    pub loaded: &'a LoadedScene,
    pub progress: &'a Progress,
    pub tracing: &'a Tracing,
}

/// A number of devices with a policy, and its frames.
pub struct Subject {
    pub options: RenderOptions,
    pub renderer: Renderer,
    /// Frames begun so far.
    begun: u32,
    /// The timed frame of each turn, and the costs that were learned until its end.
    pub frames: Vec<FrameReport>,
    pub costs: Vec<CostModel>,
    /// True if there are more worker threads than cores.
    pub oversubscribed: bool,
}

/// Returns the number of frames of a turn. The first is not timed, because other counts have used the caches and no
/// frame was in flight before it. The second is. The others keep the devices loaded until its end.
fn of_turn(options: &RenderOptions) -> u32 {
    1 + options.settings.frames_in_flight.max(1)
}

/// Returns the number of frames that each count renders.
pub fn all_frames(args: &Args, options: &RenderOptions) -> u32 {
    args.warm_up + options.frames * of_turn(options)
}

impl Measuring<'_> {
    /// Starts the renderer of a number of devices with a policy.
    pub fn subject(&self, options: RenderOptions, gpus: Devices) -> Result<Subject, Failure> {
        let infos = gpus.infos();
        // Count the threads of the devices on this machine.
        let host = |info: &DeviceInfo| info.rank.as_ref().map(|rank| rank.host.clone());
        let here = infos.iter().filter(|info| host(info) == host(&infos[0]));
        let threads: usize = here.filter_map(|info| info.threads).sum();
        let oversubscribed = threads > std::thread::available_parallelism().map_or(1, usize::from);
        let renderer = setup::renderer(&options, self.loaded, gpus, self.tracing.recorder.origin())?;
        record_devices(&self.tracing.recorder, renderer.devices());
        Ok(Subject { options, renderer, begun: 0, frames: Vec::new(), costs: Vec::new(), oversubscribed })
    }

    /// Renders the frames before the turns.
    pub fn warm_up(&self, subjects: &mut [Subject]) -> Result<(), Failure> {
        subjects.iter_mut().try_for_each(|subject| self.render(subject, self.args.warm_up).map(drop))
    }

    /// Measures a frame of every count in each turn. Another count goes first each time. Returns the time of other
    /// programs before each turn and after the last. After a whole turn, a signal ends the measurement without an
    /// error.
    pub fn measure(&self, subjects: &mut [Subject]) -> Result<Vec<Option<CoreTime>>, Failure> {
        let (count, mut times) = (subjects.len(), vec![console::core_time()]);
        for number in 0..self.options.frames as usize {
            let turn = order(count, number).map(|which| {
                let frames = self.render(&mut subjects[which], of_turn(self.options))?;
                Ok((which, frames.into_iter().nth(1)))
            });
            let frames = match turn.collect::<Result<Vec<_>, _>>() {
                Err(Failure::Interrupted) if number > 0 => break,
                frames => frames?,
            };
            for (which, frame) in frames.into_iter().filter_map(|(which, frame)| Some((which, frame?))) {
                let subject = &mut subjects[which];
                self.record(subject, &frame);
                subject.frames.push(frame);
                subject.costs.push(subject.renderer.costs().clone());
            }
            times.push(console::core_time());
            self.progress.event(|| serde_json::json!({ "event": "turn", "number": number }));
        }
        Ok(times)
    }

    /// Renders the next frames of a number of devices.
    fn render(&self, subject: &mut Subject, count: u32) -> Result<Vec<FrameReport>, Failure> {
        let Subject { options, renderer, begun, .. } = subject;
        let devices = renderer.devices().len();
        let (end, mut frames) = (*begun + count, Vec::new());
        loop {
            while *begun < end && renderer.in_flight() < options.settings.frames_in_flight as usize {
                renderer.begin(&renderer.frame(&self.loaded.shot.rig, self.args.time_s(*begun), *begun), &[])?;
                *begun += 1;
            }
            let Some(frame) = renderer.finish()? else { return Ok(frames) };
            refuse_faults(renderer)?;
            interrupt::check()?;
            let makespan_ms = frame.makespan_ms - aov_ms(&frame.tasks);
            let event = serde_json::json!({ "event": "frame", "devices": devices, "makespan_ms": makespan_ms });
            self.progress.step(format!("{devices} device(s) {makespan_ms:.1} ms"), &event);
            frames.push(frame);
        }
    }

    /// Records a frame in the trace, under a number that is unique across counts and policies.
    fn record(&self, Subject { options, renderer, .. }: &Subject, frame: &FrameReport) {
        let policies = self.options.settings.balances();
        let place = policies.iter().position(|policy| *policy == options.settings.policy()).unwrap_or_default();
        let series = renderer.devices().len() as u32 + 100 * place as u32;
        let shown = FrameReport { index: frame.index + series * 1_000_000, ..frame.clone() };
        self.tracing.record(&self.options.quality(), None, &shown);
    }
}

/// Returns the fraction of the cores that other programs took in each turn. `times` were read before each turn and
/// after the last. Around short turns, the fraction is that of a longer time, which systems count exactly enough.
pub fn shares(times: &[Option<CoreTime>]) -> Vec<Option<f64>> {
    let last = times.len().saturating_sub(1);
    let around = |turn: usize| {
        let wider = (0..=last).map(|by| (turn.saturating_sub(by), (turn + 1 + by).min(last)));
        wider.into_iter().find_map(|(from, to)| times[to]?.share_since(times[from]?))
    };
    (0..last).map(around).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_of_a_short_turn_is_that_around_it() {
        let at = |others_s, all_s| Some(CoreTime { others_s, all_s });
        let long = [at(0.0, 0.0), at(0.0, 1.0), at(0.5, 2.0)];
        assert_eq!(shares(&long), [Some(0.0), Some(0.5)]);
        let short = [at(0.0, 0.0), at(0.0, 0.25), at(0.0, 0.5), at(0.125, 0.75), at(0.25, 1.0)];
        assert_eq!(shares(&short), [Some(0.0), Some(0.125 / 0.75), Some(0.25 / 0.75), Some(0.5)]);
        assert_eq!(shares(&[at(0.0, 0.0), None, at(0.0, 1.0)]), [Some(0.0), Some(0.0)]);
        assert_eq!(shares(&[None, None]), [None]);
        assert_eq!(shares(&[None]), []);
    }
}
