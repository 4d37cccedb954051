//! Whether rows around a stripe are received or filtered by the device itself, by what either costs.

use super::cost::CostModel;
use crate::graph::{HaloPlan, Resource, Seam, passes};

/// A plan must promise to save this part of what the present one costs.
const HYSTERESIS: f64 = 0.2;

/// The halo plan of the next frame.
pub fn choose_halo(model: &CostModel, now: HaloPlan) -> HaloPlan {
    let spec = model.spec();
    if !model.has_learned() || spec.devices < 2 || spec.filter_passes() < 2 {
        return now;
    }
    let plans = HaloPlan::all(spec.filter_passes()).map(|plan| (plan, halo_ms(model, plan)));
    let Some((best, best_ms)) = plans.min_by(|a, b| a.1.total_cmp(&b.1)) else { return now };
    if best_ms < (1.0 - HYSTERESIS) * halo_ms(model, now) { best } else { now }
}

/// What a plan costs a device, the mean of all: margins filtered, rows received and sent on both sides, and waits for
/// them. The first iteration's are part of every plan, and its waits are for tracing.
fn halo_ms(model: &CostModel, plan: HaloPlan) -> f64 {
    let mut spec = model.spec().clone();
    spec.seam = Seam::Halo(plan);
    let devices = spec.devices;
    let mean = |of: &dyn Fn(usize) -> f64| (0..devices).map(of).sum::<f64>() / devices as f64;
    // A device at the frame's border has one neighbour.
    let sides = 2.0 * (devices - 1) as f64 / devices as f64;
    let mut ms = 0.0;
    let mut guide_rows = [0; 2];
    for (pass, link) in passes(&spec).iter().filter_map(|p| Some((p, p.link?))) {
        ms += sides * mean(&|d| model.stage_ms(pass.stage, pass.view, d, &(0..pass.margin_rows)));
        if !plan.receives_before(link) {
            continue;
        }
        for read in &pass.reads {
            let held = match read.resource {
                Resource::Guide => &mut guide_rows[pass.view as usize],
                _ => &mut 0,
            };
            let rows = read.halo_rows.saturating_sub(*held);
            *held = read.halo_rows.max(*held);
            let bytes = u64::from(rows) * read.resource.physical().row_bytes(spec.extent.width);
            if rows > 0 {
                ms += sides * mean(&|d| model.download_ms(d, bytes) + model.upload_ms(d, bytes));
            }
        }
        if link > 0 {
            ms += mean(&|d| model.wait_ms(d));
        }
    }
    ms
}
