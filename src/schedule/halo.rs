//! Decides by cost whether a device receives the rows around its stripe or computes them itself.

use std::ops::Range;

use super::cost::CostModel;
use crate::graph::{Chain, HaloPlan, Pass, Program};
use crate::scene::rig::Eye;

/// Fraction of the current plan's cost that a new plan must be predicted to save.
const HYSTERESIS: f64 = 0.2;

/// Returns the halo plan of the next frame: the cheapest plan if it saves enough, else the current plan `now`.
pub fn choose_halo(model: &CostModel, now: HaloPlan) -> HaloPlan {
    let links = model.program().links();
    if !model.has_learned() || model.devices() < 2 || links < 2 {
        return now;
    }
    let costs = HaloCosts::of(model);
    let (best, best_ms) = costs.cheapest();
    if best_ms < (1.0 - HYSTERESIS) * costs.ms(now) { best } else { now }
}

/// Mean cost per device of every run, that is, every sequence of consecutive filter passes. A halo plan divides the
/// filter's passes into runs.
struct HaloCosts {
    /// Number of views.
    views: usize,
    /// Runs by the index of their first pass, then by length, shortest first.
    runs: Vec<Vec<Run>>,
    link: Link,
}

/// Consecutive filter passes from one exchange of halo rows to the next.
struct Run {
    /// Time to compute the margins, to transfer the halo rows of the images in [`FilterPass::new_bytes`], and to wait
    /// for them. It excludes the transfer of the images in `kept_bytes`.
    ms: f64,
    /// Number of rows received on each side of a stripe, for each view.
    halo_rows: Vec<u32>,
    /// Bytes per row of the images whose halo rows stay valid for later runs, since several passes of the filter read
    /// them and none writes them; for each view.
    kept_bytes: Vec<u64>,
}

/// Transfer costs between a device and its neighbours.
struct Link {
    /// Mean number of neighbours of a device. A device at the border of the frame has one.
    sides: f64,
    /// Cost of a transfer, download and upload together: latency, and time per byte.
    transfer_ms: [f64; 2],
    wait_ms: f64,
}

/// Properties of a filter pass that determine the costs of runs.
struct FilterPass {
    reach_rows: u32,
    /// Number of rows above and below its own that the pass computes for passes after the filter.
    after_rows: u32,
    ms_per_row: f64,
    /// Bytes per row of the pass's inputs. `kept_bytes` is the sum over images that several filter passes read and none
    /// writes; `new_bytes` has one entry for each other image.
    kept_bytes: u64,
    new_bytes: Vec<u64>,
}

impl Link {
    fn of(model: &CostModel) -> Self {
        let devices = model.devices();
        let transfer_ms = |bytes| mean(devices, |d| model.download_ms(d, bytes) + model.upload_ms(d, bytes));
        const MANY_BYTES: u64 = 1 << 20;
        let latency_ms = transfer_ms(0);
        Self {
            sides: 2.0 * (devices - 1) as f64 / devices as f64,
            transfer_ms: [latency_ms, (transfer_ms(MANY_BYTES) - latency_ms) / MANY_BYTES as f64],
            wait_ms: mean(devices, |d| model.wait_ms(d)),
        }
    }

    /// Returns the cost to receive and send this many rows on each side.
    fn transfer_ms(&self, rows: u32, row_bytes: u64) -> f64 {
        match u64::from(rows) * row_bytes {
            0 => 0.0,
            bytes => self.sides * (self.transfer_ms[0] + self.transfer_ms[1] * bytes as f64),
        }
    }

    fn run(&self, views: &[Vec<FilterPass>], range: Range<usize>) -> Run {
        let mut run = Run { ms: 0.0, halo_rows: vec![0; views.len()], kept_bytes: vec![0; views.len()] };
        for (view, passes) in views.iter().enumerate() {
            let passes = &passes[range.start.min(passes.len())..range.end.min(passes.len())];
            let Some(first) = passes.first() else { continue };
            let mut rows = 0;
            for pass in passes.iter().rev() {
                rows += pass.after_rows;
                run.ms += self.sides * pass.ms_per_row * f64::from(rows);
                rows += pass.reach_rows;
            }
            run.ms += first.new_bytes.iter().map(|bytes| self.transfer_ms(rows, *bytes)).sum::<f64>();
            // The wait before the first pass does not count: in every plan, devices wait there for each other to finish
            // tracing.
            run.ms += if range.start > 0 { self.wait_ms } else { 0.0 };
            run.halo_rows[view] = rows;
            run.kept_bytes[view] = first.kept_bytes;
        }
        run
    }
}

impl HaloCosts {
    fn of(model: &CostModel) -> Self {
        let ms_per_row = |pass: &Pass| mean(model.devices(), |d| model.pass_ms(pass, d, &(0..1)));
        Self::new(Link::of(model), &filter_passes(model.program(), ms_per_row))
    }

    fn new(link: Link, views: &[Vec<FilterPass>]) -> Self {
        let passes = views.iter().map(Vec::len).max().unwrap_or(0);
        let runs_at = |begin| (begin..passes).map(|last| link.run(views, begin..last + 1)).collect();
        Self { views: views.len(), runs: (0..passes).map(runs_at).collect(), link }
    }

    /// Returns the cost of a run, and, for each view, the number of halo rows of unchanged images that a device holds
    /// after the run. `kept_rows` is this number before the run; these rows are not transferred again.
    fn after(&self, kept_rows: &[u32], run: &Run) -> (f64, Vec<u32>) {
        let (mut ms, mut rows) = (run.ms, kept_rows.to_vec());
        for ((rows, halo), bytes) in rows.iter_mut().zip(&run.halo_rows).zip(&run.kept_bytes) {
            ms += self.link.transfer_ms(halo.saturating_sub(*rows), *bytes);
            *rows = *halo.max(rows);
        }
        (ms, rows)
    }

    fn ms(&self, plan: HaloPlan) -> f64 {
        let (mut sum_ms, mut rows) = (0.0, vec![0; self.views]);
        for range in plan.runs(self.runs.len()) {
            let (ms, after) = self.after(&rows, &self.runs[range.start][range.len() - 1]);
            (sum_ms, rows) = (sum_ms + ms, after);
        }
        sum_ms
    }

    /// Returns the cheapest plan and its cost. The search is branch and bound: plans with a common prefix are weighed
    /// together, until they cost more than the best plan so far.
    fn cheapest(&self) -> (HaloPlan, f64) {
        let mut best = (HaloPlan::RECOMPUTE, f64::INFINITY);
        self.extend(HaloPlan::RECOMPUTE, 0, 0.0, &vec![0; self.views], &mut best);
        best
    }

    /// Tries all completions of a plan that is fixed up to pass `begin` and costs `ms` so far. Updates `best` with each
    /// cheaper plan.
    fn extend(&self, plan: HaloPlan, begin: usize, ms: f64, kept_rows: &[u32], best: &mut (HaloPlan, f64)) {
        if ms >= best.1 {
            return;
        }
        let Some(runs) = self.runs.get(begin) else {
            *best = (plan, ms);
            return;
        };
        let plan = plan.receiving_before(begin);
        for (end, run) in (begin + 1..).zip(runs) {
            let (run_ms, rows) = self.after(kept_rows, run);
            self.extend(plan, end, ms + run_ms, &rows, best);
        }
    }
}

fn mean(devices: usize, of: impl Fn(usize) -> f64) -> f64 {
    (0..devices).map(of).sum::<f64>() / devices as f64
}

/// Returns the filter's passes on each view. `ms_per_row` returns the cost of a row.
fn filter_passes(program: &Program, ms_per_row: impl Fn(&Pass) -> f64) -> Vec<Vec<FilterPass>> {
    let links = || program.passes().iter().filter(|p| p.link.is_some());
    let mut views: Vec<Vec<FilterPass>> = Eye::of_rig(program.views()).map(|_| Vec::new()).collect();
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
        views[pass.view.index()].push(FilterPass { reach_rows, after_rows: 0, ms_per_row, kept_bytes, new_bytes });
    }
    for (view, passes) in Eye::of_rig(program.views()).zip(&mut views) {
        let after = program.passes().iter().map(|p| &p.pass).filter(|p| p.view == view && p.chain == Chain::Margin);
        if let Some(last) = passes.last_mut() {
            last.after_rows = after.map(Pass::halo_rows).sum();
        }
    }
    views
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Linked, Seam};
    use crate::passes::tests::spec;
    use crate::passes::{Declarations, FrameSpec};
    use crate::quality::Denoiser;

    fn filters() -> [(Denoiser, u32); 2] {
        [(Denoiser::ATROUS, 6), (Denoiser::SVGF, 5)]
    }

    fn program(plan: HaloPlan, (filter, iterations): (Denoiser, u32)) -> std::sync::Arc<Program> {
        let spec = FrameSpec { filter: Some(filter), iterations, ..spec(2, Seam::Halo(plan)) };
        Declarations::default().program(&spec)
    }

    #[test]
    fn halo_costs_count_rows_of_the_frame_passes() {
        for plan in HaloPlan::all(6) {
            for filter in filters() {
                let program = program(plan, filter);
                let link = Link { sides: 1.0, transfer_ms: [0.0; 2], wait_ms: 0.0 };
                let costs = HaloCosts::new(link, &filter_passes(&program, |_| 1.0));
                assert_eq!(costs.runs.len(), 6);
                let passes = || program.passes().iter().filter(|p| p.link.is_some());
                let margin_rows: u32 = passes().map(|p| p.margin_rows).sum();
                assert_eq!(costs.ms(plan), f64::from(margin_rows), "{plan:?}");
                for range in plan.runs(6) {
                    let run = &costs.runs[range.start][range.len() - 1];
                    let first = |eye| passes().find(|p| p.link == Some(range.start) && p.pass.view == eye);
                    let halo_rows = |p: &Linked| p.margin_rows + p.pass.halo_rows();
                    assert_eq!(run.halo_rows, Eye::BOTH.map(|eye| first(eye).map_or(0, halo_rows)), "{plan:?}");
                }
            }
        }
    }

    #[test]
    fn cheapest_of_all_halo_plans_is_found() {
        let mut found = Vec::new();
        for filter in filters() {
            let program = program(HaloPlan::RECOMPUTE, filter);
            for exponent in -12..4 {
                let ms = 2f64.powi(exponent);
                let link = Link { sides: 1.5, transfer_ms: [ms, 1e-6 * ms], wait_ms: 0.5 * ms };
                let costs =
                    HaloCosts::new(link, &filter_passes(&program, |p| 1e-3 * f64::from(1 + p.view.index() as u32)));
                let (best, best_ms) = costs.cheapest();
                let least_ms = HaloPlan::all(6).map(|p| costs.ms(p)).fold(f64::INFINITY, f64::min);
                assert!((costs.ms(best) - least_ms).abs() <= 1e-9 * least_ms, "{best:?} at {ms}");
                assert!((best_ms - least_ms).abs() <= 1e-9 * least_ms, "{best:?} at {ms}");
                found.push(best.runs(6).len());
            }
        }
        assert!(found.contains(&1) && found.contains(&6) && found.iter().any(|n| (2..6).contains(n)), "{found:?}");
    }
}
