//! Predictions of frame times in a world that follows the model.

use super::*;
use crate::passes::path_trace::{HOLE_FILL, STAGE as PATH_TRACE};

/// Frames with few and with four times as many rays in turns, on a device where a pixel costs as much as two rays.
#[test]
fn predictions_at_another_quality_use_fixed_cost() {
    const HEIGHT: u32 = 180;
    let sky = || World { idle_rays: 2.0, ..World::sky_over_city(spec(HEIGHT, 1, 5, Seam::None), &[1.0]) };
    let few = sky();
    let more = |rows: &Vec<u32>| rows.iter().map(|rays| WIDTH + 4 * (rays - WIDTH)).collect();
    let many = World { rays: few.rays.each_ref().map(more), ..sky() };
    let relative_cost = |rays: f64| RelativeCost::new([(PATH_TRACE, rays), (HOLE_FILL, rays)]);
    let graph = graph(&few.spec, &Assignment::uniform(Stripes::even(HEIGHT, 1)), None);
    let mut model = model(&few.spec);
    for (world, rays) in [(&few, 1.0), (&many, 4.0)].repeat(6) {
        for _ in 0..5 {
            model.learn(&FrameCosts { relative_cost: relative_cost(rays), ..world.costs(&graph) });
        }
    }
    let passes = graph.program.passes().iter().map(|linked| &linked.pass);
    for pass in passes.filter(|pass| [PATH_TRACE, HOLE_FILL].contains(&pass.stage)) {
        let predicted_ms = model.pass_ms_at(&relative_cost(1.0), pass, 0, &(0..HEIGHT));
        let ratio = predicted_ms / few.pass_ms(pass, 0, &(0..HEIGHT));
        assert!((ratio - 1.0).abs() < 0.1, "{}: {ratio}", pass.stage.name());
    }
}

#[test]
fn one_device_takes_the_sum_of_its_work() {
    let world = World::sky_over_city(spec(180, 1, 5, Seam::None), &[2.0]);
    let (assignments, model) = world.play(&mut Even::new(180, 1), 3);
    let graph = graph(&world.spec, &assignments[2], None);
    let work_ms: f64 = world.costs(&graph).stages.iter().map(|c| c.busy_ms + GAP_MS).sum();
    let played = simulate(&graph, &model);
    assert!((played.makespan_ms - work_ms - LEAD_MS - TAIL_MS).abs() < 1e-9 * work_ms, "{played:?}");
    assert_eq!((played.limit, played.critical_path.len()), (Limit::Work, graph.parts_of(0).0.len()));
}
