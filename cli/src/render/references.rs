//! References of `diptych render`.

use super::Run;
use crate::failure::Failure;
use crate::faults::FaultLog;
use crate::interrupt;
use crate::output::{self, Also, FrameImages};
use crate::reference::{self, Plan};
use diptych::passes::Aov;
use diptych::quality::Quality;

impl Run<'_> {
    pub(super) fn references(&mut self, plan: &Plan) -> Result<(), Failure> {
        let mut faults = FaultLog::default();
        self.progress.finish();
        for i in (0..plan.options.frames).take_while(|_| !interrupt::is_set()) {
            self.reference(plan, i)?;
            faults.say_new(&self.renderer, self.tracing, &self.progress);
        }
        Ok(())
    }

    /// Renders a reference. Auxiliary images are those of the first pass, even in a resumed run.
    fn reference(&mut self, plan: &Plan, index: u32) -> Result<(), Failure> {
        let Self { args, loaded, renderer, rows, .. } = self;
        let (options, shot) = (&plan.options, &loaded.shot);
        let begun = plan.begun(loaded, index)?;
        let done = plan.accumulate(renderer, loaded, index, begun, self.tracing)?;
        if done.row.spp == 0 {
            // Only a signal ends a reference before its first pass.
            return interrupt::check();
        }
        let mut images = FrameImages {
            linear: done.accumulation.mean(),
            display: reference::display(&done.accumulation, shot),
            aovs: Vec::new(),
            pixel_centre: [0.5; 2],
        };
        if !options.aovs.is_empty() {
            let params = renderer.frame(&shot.rig, options.time_s(index), index);
            // After a signal, devices may be too busy to render them.
            let rendered = interrupt::as_none(renderer.render(&params).map_err(Failure::from))?;
            if let Some(report) = rendered {
                images.pixel_centre = report.pixel_centre;
                images.aovs = FrameImages::read(renderer, &options.aovs)?.aovs;
            }
            for (_, spp) in images.aovs.iter_mut().filter(|(aov, _)| *aov == Aov::Spp) {
                spp.iter_mut().flatten().for_each(|plane| plane.fill(done.row.spp as f32));
            }
        }
        if let Some(report) = done.report {
            if args.has(Also::Overlay) {
                let rectified = shot.rig.optics.as_ref().zip(renderer.rectified());
                images.overlay(report.stripe_edges(), rectified);
            }
            let quality = Quality { spp: done.row.spp.into(), ..options.quality() };
            rows.frames.push(args.row(&report, &quality, &shot.rig, options.time_s(index)));
        }
        let tags = output::tags(&shot.rig, shot.exposure_ev, options.settings.size, options.time_s(index), index);
        rows.references.push(done.row);
        let number = (options.frames > 1).then_some(index);
        let _writing = interrupt::writing();
        self.pictures.add(images.write(&options.out, number, &args.also, args.quilt, &tags)?);
        Ok(())
    }
}
