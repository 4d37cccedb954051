//! Measures rays per second: the shaders' traversal on one device that uses all cores, against obvhs's own traversal of
//! the same tree on all cores. Both trace the same rays, in alternating repeats.
//!
//! `cargo bench --bench rays -- [--size WxH] [--two-level] [--hardware] [SHOT]...`
//!
//! `--two-level` measures the two-level scene beside the flattened one, with the same rays.
//! `--hardware` also measures the device's hardware ray queries.

mod common;

use std::time::Instant;

use common::{Case, Cpu, Gpu, Workload};
use diptych::accel::Layout;
use diptych::device::Traversal;
use diptych::image::Extent;

const REPEATS: usize = 9;

struct Options {
    layouts: Vec<Layout>,
    extent: Extent,
    traversals: Vec<Traversal>,
    shots: Vec<String>,
}

fn options() -> Options {
    let mut options = Options {
        layouts: vec![Layout::Flat],
        extent: Extent::new(640, 360),
        traversals: vec![Traversal::Compute],
        shots: Vec::new(),
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--bench" => {}
            "--two-level" => options.layouts.push(Layout::TwoLevel),
            "--size" => {
                options.extent = args.next().and_then(|size| size.parse().ok()).expect("--size takes WIDTHxHEIGHT");
            }
            "--hardware" => options.traversals.push(Traversal::Hardware),
            _ => options.shots.push(arg),
        }
    }
    if options.shots.is_empty() {
        options.shots = ["builtin:atrium", "builtin:cornell"].map(String::from).into();
    }
    options
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn seconds(work: impl FnOnce()) -> f64 {
    let begin = Instant::now();
    work();
    begin.elapsed().as_secs_f64()
}

fn main() {
    let options = options();
    println!("Mrays/s, medians of {REPEATS} repeats in turns; all cores on both sides");
    for shot in &options.shots {
        let workload = Workload::load(shot, options.extent);
        println!("{shot}: {} triangles, {} nodes", workload.accel.triangles.len(), workload.accel.nodes.len());
        let cpu = Cpu::new(&workload.accel);
        for case in Case::ALL {
            measure(&options, &workload, &cpu, case);
        }
    }
}

fn measure(options: &Options, workload: &Workload, cpu: &Cpu, case: Case) {
    let rays = workload.rays(cpu, case);
    let count = rays.iter().filter(|r| r.t_max > 0.0).count() as f64 / 1e6;
    let layouts = |&traversal: &Traversal| options.layouts.iter().map(move |&layout| (traversal, layout));
    let measured: Vec<_> = options.traversals.iter().flat_map(layouts).collect();
    let gpus: Vec<_> = measured.iter().map(|&(t, l)| Gpu::new(workload, l, case, &rays, t)).collect();
    let expected = cpu.trace(&rays, case);
    let mut cpu_s = Vec::new();
    let mut gpu_s = vec![Vec::new(); gpus.len()];
    for gpu in &gpus {
        gpu.trace();
        gpu.trace();
    }
    for _ in 0..REPEATS {
        cpu_s.push(seconds(|| drop(cpu.trace(&rays, case))));
        for (gpu, s) in gpus.iter().zip(&mut gpu_s) {
            s.push(seconds(|| gpu.trace()));
        }
    }
    let cpu_rate = count / median(&mut cpu_s);
    println!("  {:<8} {count:.2} M rays; obvhs {cpu_rate:6.2}", case.name());
    for ((gpu, s), (traversal, layout)) in gpus.iter().zip(&mut gpu_s).zip(&measured) {
        let rate = count / median(s);
        let differing = gpu.differing(&expected, case);
        println!(
            "           device {rate:6.2}, {:.2}x of obvhs; {differing} rays end elsewhere ({}, {layout:?})",
            rate / cpu_rate,
            traversal.name()
        );
    }
}
