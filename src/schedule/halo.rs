//! Decides by cost whether rows around a stripe are received or filtered by the device itself.

use super::cost::CostModel;
use crate::graph::{Chain, HaloPlan, Pass, Program};
use crate::scene::rig::Eye;

/// A plan must be predicted to save this part of what the present one costs.
const HYSTERESIS: f64 = 0.2;

/// The halo plan of the next frame.
pub fn choose_halo(model: &CostModel, now: HaloPlan) -> HaloPlan {
    let spec = model.spec();
    let links = model.program().links();
    if !model.has_learned() || spec.devices < 2 || links < 2 {
        return now;
    }
    let costs = HaloCosts::of(model);
    let mut rows = Vec::with_capacity(links);
    let plans = HaloPlan::all(links).map(|plan| (plan, costs.ms(plan, &mut rows)));
    let Some((best, best_ms)) = plans.min_by(|a, b| a.1.total_cmp(&b.1)) else { return now };
    if best_ms < (1.0 - HYSTERESIS) * costs.ms(now, &mut Vec::new()) { best } else { now }
}

/// The mean cost of halos to a device. There are many plans to choose from, so it is looked up once.
struct HaloCosts {
    /// The filter's passes in order, for each view.
    views: [Vec<FilterPass>; 2],
    /// The mean number of neighbours of a device. A device at the border of the frame has one.
    sides: f64,
    /// The cost of both ends of a transfer: latency, and time per byte.
    transfer_ms: [f64; 2],
    wait_ms: f64,
}

/// A pass of the filter when rows are received right before it.
struct FilterPass {
    reach_rows: u32,
    /// The number of rows around its own that it computes for what comes after the filter.
    after_rows: u32,
    ms_per_row: f64,
    /// Bytes of a row of what it reads: of images that no pass of the filter writes, and of those that are new with
    /// each pass.
    kept_bytes: u64,
    new_bytes: Vec<u64>,
}

/// The rows around a stripe for one pass in a plan.
#[derive(Debug, PartialEq)]
struct Rows {
    /// The rows that are filtered for passes to come.
    margin: u32,
    /// The rows that are received from neighbours; none where nothing is received.
    halo: Option<u32>,
}

impl HaloCosts {
    fn of(model: &CostModel) -> Self {
        let spec = model.spec();
        let devices = spec.devices;
        let mean = |of: &dyn Fn(usize) -> f64| (0..devices).map(of).sum::<f64>() / devices as f64;
        let transfer_ms = |bytes| mean(&|d| model.download_ms(d, bytes) + model.upload_ms(d, bytes));
        const MANY_BYTES: u64 = 1 << 20;
        let latency_ms = transfer_ms(0);
        let ms_per_row = |pass: &Pass| mean(&|d| model.pass_ms(pass, d, &(0..1)));
        Self {
            views: filter_passes(model.program(), ms_per_row),
            sides: 2.0 * (devices - 1) as f64 / devices as f64,
            transfer_ms: [latency_ms, (transfer_ms(MANY_BYTES) - latency_ms) / MANY_BYTES as f64],
            wait_ms: mean(&|d| model.wait_ms(d)),
        }
    }

    /// The cost of margins that are filtered, of rows received and sent on both sides, and of waits for them. The rows
    /// of the first pass are part of every plan, and its waits are for tracing.
    fn ms(&self, plan: HaloPlan, rows: &mut Vec<Rows>) -> f64 {
        let view_ms = |passes: &Vec<FilterPass>| {
            rows_of(passes, plan, rows);
            self.view_ms(passes, rows)
        };
        self.views.iter().map(view_ms).sum()
    }

    fn view_ms(&self, passes: &[FilterPass], rows: &[Rows]) -> f64 {
        let transfer_ms = |rows: u32, row_bytes: u64| match u64::from(rows) * row_bytes {
            0 => 0.0,
            bytes => self.transfer_ms[0] + self.transfer_ms[1] * bytes as f64,
        };
        let (mut ms, mut kept_rows) = (0.0, 0);
        for (index, (pass, rows)) in passes.iter().zip(rows).enumerate() {
            ms += self.sides * pass.ms_per_row * f64::from(rows.margin);
            let Some(halo) = rows.halo else { continue };
            let new_ms: f64 = pass.new_bytes.iter().map(|bytes| transfer_ms(halo, *bytes)).sum();
            ms += self.sides * (new_ms + transfer_ms(halo.saturating_sub(kept_rows), pass.kept_bytes));
            kept_rows = halo.max(kept_rows);
            if index > 0 {
                ms += self.wait_ms;
            }
        }
        ms
    }
}

/// The filter's passes on each view. `ms_per_row` says what a row costs.
fn filter_passes(program: &Program, ms_per_row: impl Fn(&Pass) -> f64) -> [Vec<FilterPass>; 2] {
    let links = || program.passes().iter().filter(|p| p.link.is_some());
    let mut views = [Vec::new(), Vec::new()];
    for linked in links() {
        let pass = &linked.pass;
        // An image that several passes read and none of them writes is received once.
        let keeps = |image: usize| {
            let of = || links().filter(|l| l.pass.view == pass.view).flat_map(|l| l.pass.uses.iter().zip(&l.images));
            let uses = || of().filter(|(_, i)| **i == image);
            uses().count() > 1 && uses().all(|(u, _)| !u.access.writes())
        };
        let (mut kept_bytes, mut new_bytes) = (0, Vec::new());
        for (used, image) in pass.uses.iter().zip(&linked.images).filter(|(u, _)| u.is_read()) {
            let row_bytes = used.image.resource.row_bytes(program.extent);
            if keeps(*image) { kept_bytes += row_bytes } else { new_bytes.push(row_bytes) }
        }
        let ms_per_row = ms_per_row(pass);
        let reach_rows = pass.halo_rows();
        views[pass.view as usize].push(FilterPass { reach_rows, after_rows: 0, ms_per_row, kept_bytes, new_bytes });
    }
    for (view, passes) in Eye::ALL.into_iter().zip(&mut views) {
        let after = program.passes().iter().map(|p| &p.pass).filter(|p| p.view == view && p.chain == Chain::Margin);
        if let Some(last) = passes.last_mut() {
            last.after_rows = after.map(Pass::halo_rows).sum();
        }
    }
    views
}

/// The rows that each pass needs for all passes up to the next exchange.
fn rows_of(passes: &[FilterPass], plan: HaloPlan, rows: &mut Vec<Rows>) {
    rows.clear();
    let mut margin = 0;
    for (index, pass) in passes.iter().enumerate().rev() {
        margin += pass.after_rows;
        let wanted = margin + pass.reach_rows;
        let receives = index == 0 || plan.receives_before(index);
        rows.push(Rows { margin, halo: receives.then_some(wanted) });
        margin = if receives { 0 } else { wanted };
    }
    rows.reverse();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Linked, Seam};
    use crate::passes::tests::spec;
    use crate::passes::{Declarations, FrameSpec};
    use crate::quality::Denoiser;

    #[test]
    fn rows_are_those_of_the_frames_passes() {
        for plan in HaloPlan::all(6) {
            for (filter, iterations) in [(Denoiser::Atrous, 6), (Denoiser::Svgf, 5)] {
                let spec = FrameSpec { filter: Some(filter), iterations, ..spec(2, Seam::Halo(plan)) };
                let program = Declarations::default().program(&spec);
                let found = filter_passes(&program, |_| 0.0).map(|passes| {
                    let mut rows = Vec::new();
                    rows_of(&passes, plan, &mut rows);
                    rows
                });
                for eye in Eye::ALL {
                    let links = program.passes().iter().filter(|p| p.link.is_some() && p.pass.view == eye);
                    let of = |p: &Linked| Rows {
                        margin: p.margin_rows,
                        halo: p.link.filter(|l| plan.receives_before(*l)).map(|_| p.margin_rows + p.pass.halo_rows()),
                    };
                    let expected: Vec<Rows> = links.map(of).collect();
                    assert_eq!(expected.len(), 6);
                    assert_eq!(found[eye as usize], expected, "{plan:?} {eye}");
                }
            }
        }
    }
}
