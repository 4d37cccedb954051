//! The control loop on its own thread: renders the camera's views until the window closes.

use std::time::Instant;

use crate::report::run::FrameRow;
use diptych::exec::Renderer;
use diptych::exec::ranks::Devices;
use diptych::loaded::LoadedScene;
use diptych::passes::tonemap::{DISPLAY, LINEAR};
use diptych::scene::Scene;
use diptych::scene::head::Recording;
use diptych::scene::studio::bounds_of_object;

use super::camera::Camera;
use super::shared::{FrameStatus, Shared};
use crate::failure::Failure;
use crate::interrupt;
use crate::metering::Adaptation;
use crate::play::{Pace, Prepared, Session};
use crate::progress::Progress;
use crate::setup::Tracing;
use diptych::frame::Foveation;

/// Maximum time step of the camera between two frames, seconds.
const LONGEST_STEP_S: f64 = 0.25;

/// Inputs of the renderer's thread.
pub struct Start {
    pub prepared: Prepared,
    pub loaded: LoadedScene,
    pub gpus: Devices,
    pub tracing: Tracing,
    pub progress: Progress,
}

/// Renders until the window closes, the run is interrupted or all requested frames are done. Calls `wake` after each
/// frame.
pub fn run(start: Start, shared: &Shared, wake: impl Fn()) -> Result<(), Failure> {
    let Start { mut prepared, loaded, gpus, tracing, progress } = start;
    let mut session = Session::start(&mut prepared, &loaded, gpus, tracing, progress)?;
    let mut adaptation = Adaptation::new(&loaded.shot);
    // The meter needs radiances.
    session.renderer.set_outputs(if adaptation.is_some() { &[DISPLAY, LINEAR] } else { &[DISPLAY] });
    let options = &prepared.render;
    let mut camera = Camera::new(&loaded.shot.rig, options.settings.time, speed_per_s(&loaded.scene));
    let mut motion = prepared.options.recording(loaded.space, &session.progress)?;
    let mut pace = Pace::new(options.fps);
    let mut before = Instant::now();
    for index in 0..prepared.frames.unwrap_or(u32::MAX) {
        if shared.ends() || interrupt::is_set() {
            break;
        }
        let decided = session.decide();
        let late_ms = pace.wait();
        let input = shared.take_input();
        let now = Instant::now();
        let passed_s = (now - std::mem::replace(&mut before, now)).as_secs_f64().min(LONGEST_STEP_S);
        let (rig, time_s) = camera.step(&input, passed_s);
        if let Some(gaze) = input.gaze {
            session.gaze = Some([gaze; 2]);
        }
        session.exposure_ev = adaptation.as_mut().map(|adaptation| adaptation.next_ev(passed_s));
        let (mut row, report) = session.render(decided, late_ms, &rig, time_s, index)?;
        let picture = session.read(Renderer::read_display)?;
        let deadline = pace.complete(session.tracing.recorder.origin());
        session.complete(&mut row, &report, decided, Some(deadline));
        if deadline.is_missed() {
            // A window shows a frame as soon as it is complete.
            pace.restart();
        }
        if let Some(motion) = &mut motion {
            motion.add(time_s, &rig, time_s, session.gaze(time_s))?;
        }
        session.announce(&row, &report);
        let layers = session.renderer.config().foveation().zip(session.fovea(decided));
        let circles = layers.zip(session.gaze(time_s)).map(|((foveation, radii), gaze)| {
            gaze.map(|gaze| Foveation { radii, ..foveation }.circles(gaze, options.settings.size))
        });
        shared.show(picture, frame_status(row, now), |status| {
            (status.rungs, status.follows_path, status.circles) =
                (session.ladder().rungs().len(), camera.follows_path(), circles);
            status.metered_ev = session.exposure_ev;
        });
        wake();
        if let Some(adaptation) = adaptation.as_mut().filter(|_| index % Adaptation::INTERVAL == 0) {
            adaptation.meter(&loaded.scene, session.read(Renderer::read_linear)?.left());
        }
    }
    session.progress.finish();
    motion.map_or(Ok(()), Recording::finish)?;
    session.tracing.finish()
}

/// Returns the camera's speed in scene units per second: a tenth of the scene's diagonal.
pub fn speed_per_s(scene: &Scene) -> f64 {
    let bounds = bounds_of_object(scene);
    let diagonal = f64::from((bounds.max - bounds.min).length());
    if diagonal.is_finite() && diagonal > 0.0 { diagonal / 10.0 } else { 1.0 }
}

pub fn frame_status(row: FrameRow, posed: Instant) -> FrameStatus {
    FrameStatus {
        posed,
        at: Instant::now(),
        makespan_ms: row.makespan_ms,
        in_band: row.control.is_some_and(|c| c.in_band),
        rung: row.control.map_or(0, |c| c.rung),
        quality: row.quality,
        stripes: row.stripes,
    }
}
