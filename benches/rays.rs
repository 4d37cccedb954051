//! Measures rays per second: the shaders' traversal on one device that uses all cores, against obvhs's own traversal of
//! the same tree on all cores. Both trace the same rays, in alternating repeats.
//!
//! `cargo bench --bench rays -- [--reps N] [--size WxH] [--case NAME] [--processor-time] [--two-level]
//! [--hardware] [--traverse FILE.wgsl]... [SHOT]...`
//!
//! `--hardware` also measures the device's hardware ray queries.
//! `--traverse` names a replacement for `trace.inc.wgsl` and `traverse_compute.inc.wgsl` of `shaders/shared`, one after
//! the other in one file, to measure beside the current version.
//! `--two-level` measures the two-level scene beside the flattened one, with the same rays.
//! `--processor-time` counts processor time instead of elapsed time, for a busy machine. It works only on a software
//! adapter.

mod common;

use std::time::Instant;

use common::{Case, Cpu, Gpu, Version, Workload};
use diptych::accel::Layout;
use diptych::device::Traversal;
use diptych::image::Extent;

struct Options {
    reps: usize,
    processor_time: bool,
    two_level: bool,
    case: Option<Case>,
    extent: Extent,
    versions: Vec<Version>,
    shots: Vec<String>,
}

fn options() -> Options {
    let mut options = Options {
        reps: 9,
        processor_time: false,
        two_level: false,
        case: None,
        extent: Extent::new(640, 360),
        versions: vec![Version::Present(Traversal::Compute)],
        shots: Vec::new(),
    };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut value = || args.next().unwrap_or_else(|| panic!("{arg} takes a value"));
        match arg.as_str() {
            "--bench" => {}
            "--reps" => options.reps = value().parse().expect("--reps takes a number"),
            "--processor-time" => options.processor_time = true,
            "--two-level" => options.two_level = true,
            "--case" => options.case = Some(Case::named(&value()).expect("--case takes primary, paths or shadow")),
            "--size" => options.extent = value().parse().expect("--size takes WIDTHxHEIGHT"),
            "--hardware" => options.versions.push(Version::Present(Traversal::Hardware)),
            "--traverse" => options.versions.push(Version::Of(value().into())),
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

/// Returns the processor time of all threads of this process so far, over the number of cores. It does not depend on
/// other processes.
#[cfg(unix)]
fn processor_s() -> f64 {
    let mut t = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the call writes one timespec to a valid address.
    unsafe { libc::clock_gettime(libc::CLOCK_PROCESS_CPUTIME_ID, &mut t) };
    (t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9) / std::thread::available_parallelism().map_or(1.0, |n| n.get() as f64)
}

#[cfg(not(unix))]
fn processor_s() -> f64 {
    panic!("--processor-time is for Unix");
}

impl Options {
    fn seconds(&self, work: impl FnOnce()) -> f64 {
        let origin = Instant::now();
        let now = || if self.processor_time { processor_s() } else { origin.elapsed().as_secs_f64() };
        let start = now();
        work();
        now() - start
    }
}

fn main() {
    let options = options();
    println!("Mrays/s, medians of {} repeats in turns; all cores on both sides", options.reps);
    for shot in &options.shots {
        let workload = Workload::load(shot, options.extent);
        println!("{shot}: {} triangles, {} nodes", workload.accel.triangles.len(), workload.accel.nodes.len());
        let cpu = Cpu::new(&workload.accel);
        for case in Case::ALL.into_iter().filter(|c| options.case.is_none_or(|only| only == *c)) {
            measure(&options, &workload, &cpu, case);
        }
    }
}

fn measure(options: &Options, workload: &Workload, cpu: &Cpu, case: Case) {
    let rays = workload.rays(cpu, case);
    let count = rays.iter().filter(|r| r.t_max > 0.0).count() as f64 / 1e6;
    let layouts = [Layout::Flat, Layout::TwoLevel];
    let layouts = if options.two_level { &layouts[..] } else { &layouts[..1] };
    let measured: Vec<_> = options.versions.iter().flat_map(|v| layouts.iter().map(move |&l| (v, l))).collect();
    let gpus: Vec<_> = measured.iter().map(|&(v, l)| Gpu::new(workload, l, case, &rays, v)).collect();
    let expected = cpu.trace(&rays, case);
    let mut cpu_s = Vec::new();
    let mut gpu_s = vec![Vec::new(); gpus.len()];
    for gpu in &gpus {
        gpu.trace();
        gpu.trace();
    }
    for _ in 0..options.reps {
        cpu_s.push(options.seconds(|| drop(cpu.trace(&rays, case))));
        for (gpu, s) in gpus.iter().zip(&mut gpu_s) {
            s.push(options.seconds(|| gpu.trace()));
        }
    }
    let cpu_rate = count / median(&mut cpu_s);
    println!("  {:<8} {count:.2} M rays; obvhs {cpu_rate:6.2}", case.name());
    for ((gpu, s), (version, layout)) in gpus.iter().zip(&mut gpu_s).zip(&measured) {
        let rate = count / median(s);
        let differing = gpu.differing(&expected, case);
        println!(
            "           device {rate:6.2}, {:.2}x of obvhs; {differing} rays end elsewhere ({}, {layout:?})",
            rate / cpu_rate,
            version.name()
        );
    }
}
