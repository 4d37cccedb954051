//! Options with invalid values.

use super::*;

#[test]
fn rejects_invalid_sizes() {
    for size in ["0x0", "abc", "99999x99999", "64", "64x", "-4x4", "1e3x10", "0x10"] {
        let option = format!("--size={size}");
        let case = Case::new();
        let out = case.path("out");
        let output = diptych(&["render", "builtin:cornell", "--out", out.to_str().unwrap(), &option]);
        assert_refused(size, &output, 2, &["--size", size]);
        assert!(!out.exists(), "{size}");
    }
}

#[test]
fn rejects_sizes_beyond_the_memory_of_a_device() {
    // One image takes 1 GiB. Adapters that can bind as much would take minutes and refuse nothing.
    let binds = diptych::device::adapters().iter().map(|a| a.max_storage_mib).max();
    let binds = binds.expect("these tests need an adapter: on Linux, install mesa-vulkan-drivers");
    if binds >= 1024 {
        eprintln!("\nSKIPPED: an adapter here binds {binds} MiB: 8192x8192 is not too large for it\n");
        return;
    }
    Case::new().refused("builtin:cornell", &["--size", "8192x8192"], 1, &["8192x8192", "MiB"]);
}

#[test]
fn rejects_sample_counts_out_of_range() {
    for spp in ["0", "1000000000", "10000000000", "-1", "many", "0.5", "nan"] {
        assert_option_refused(&[&format!("--spp={spp}")], &["spp", spp]);
    }
    assert_option_refused(&["--reference", "--spp", "1.5"], &["--reference", "--spp 1.5"]);
    assert_option_refused(&["--bounces", "100000"], &["bounces 100000", "0 to 1024"]);
    for iterations in ["11", "2,3", "2,3,11", ",", "-1"] {
        assert_option_refused(&[&format!("--iterations={iterations}")], &["iterations"]);
    }
    assert_option_refused(&["--iterations", "2,3,5"], &["iterations", "foveation=layers"]);
    assert_option_refused(&["--denoiser", "none", "--iterations", "3"], &["iterations has no effect", "denoiser"]);
    assert_option_refused(&["--seed", "-1"], &["-1"]);
    assert_option_refused(&["--frames", "0"], &["--frames"]);
}

#[test]
fn rejects_invalid_gazes() {
    for gaze in ["0.5", "1.5,0.5", "-0.1,0.5", "0.5,0.5,0.5", "nan,0.5", "a,b"] {
        assert_option_refused(&["--foveation", "layers", &format!("--gaze={gaze}")], &["--gaze"]);
    }
    assert_option_refused(&["--gaze", "0.5,0.5"], &["gaze", "foveation=layers"]);
}

#[test]
fn rejects_invalid_log_polar_images() {
    for (map, part) in [
        ("composit", "composite-kernel, or four numbers"),
        ("1,2,3", "or four numbers"),
        ("0.1,1,0,1", "sigma 0.1 is out of range"),
        ("1,1,0.9,1", "gaze 0.9 is out of range"),
        ("1,NaN,0,1", "alpha NaN is out of range"),
    ] {
        assert_option_refused(&["--foveation", "log-polar", "--set", &format!("polar={map}")], &["polar", part]);
    }
    assert_option_refused(&["--set", "polar=fov"], &["polar has no effect without foveation=log-polar"]);
}

#[test]
fn rejects_ratios_that_do_not_fit() {
    assert_option_refused(&["--virtual", "3", "--ratios", "1,2"], &["2 ratios", "3 devices"]);
    assert_option_refused(&["--virtual", "2", "--ratios=-1,2"], &["-1"]);
    assert_option_refused(&["--virtual", "2", "--ratios=0,0"], &["ratio"]);
    assert_option_refused(&["--virtual", "2", "--ratios=nan,1"], &["ratio"]);
    assert_option_refused(&["--virtual", "2", "--ratios", "much,little"], &["much"]);
    assert_option_refused(&["--virtual", "2", "--ratios", "cooking=1,2"], &["cooking", "path_trace"]);
    assert_option_refused(&["--virtual", "2", "--ratios", "atrous.middle=1,2"], &["middle"]);
    assert_option_refused(&["--virtual", "2", "--ratios", ""], &["ratios"]);
    assert_option_refused(&["--virtual", "2", "--balance", "static"], &["balance cannot be static", "ratios"]);
    assert_option_refused(&["--virtual", "2", "--balance", "even", "--ratios", "1,2"], &["ratios", "balance=static"]);
    assert_option_refused(&["--balance", "fair"], &["fair", "measured"]);
}

#[test]
fn rejects_missing_devices() {
    assert_option_refused(&["--devices", "99"], &["99", "diptych info"]);
    assert_option_refused(&["--devices", "first"], &["first"]);
    assert_option_refused(&["--virtual", "0"], &["--virtual", "0"]);
    assert_option_refused(&["--virtual", "1000"], &["--virtual", "1000"]);
    assert_option_refused(&["--threads-per-device", "0"], &["threads_per_device 0"]);
}

#[test]
fn rejects_hardware_traversal_without_ray_queries() {
    assert_option_refused(&["--set", "traversal=magic"], &["magic", "auto", "compute", "hardware"]);
    let adapters = diptych::device::adapters();
    let Some(unable) = adapters.iter().find(|a| !a.ray_queries && a.missing.is_empty()) else {
        eprintln!("\nSKIPPED: every adapter here has ray queries\n");
        return;
    };
    let adapter = unable.index.to_string();
    for more in [&[][..], &["--reference"]] {
        let options = [&["--set", "traversal=hardware", "--devices", &adapter], more].concat();
        assert_option_refused(&options, &["no ray queries", &unable.name, "--set traversal=compute", "--devices"]);
    }
}

#[test]
fn rejects_unknown_options_and_commands() {
    assert_option_refused(&["--quality", "best"], &["--quality"]);
    assert_option_refused(&["--denoiser", "magic"], &["magic", "atrous"]);
    assert_option_refused(&["--aov", "smell"], &["smell", "normal"]);
    assert_option_refused(&["--set", "sampler=dice"], &["dice", "sobol"]);
    assert_option_refused(&["--set", "sample=pcg"], &["'sample'", "sampler"]);
    assert_option_refused(&["--set", "sampler"], &["KEY=VALUE"]);
    assert_option_refused(&["--hard-shadows", "off"], &["--set hard_shadows="]);
    assert_refused("no such command", &diptych(&["paint"]), 2, &["paint"]);
}

#[test]
fn rejects_invalid_times_and_rates() {
    for fps in ["0", "-1", "nan", "inf", "1e-308"] {
        assert_option_refused(&[&format!("--fps={fps}")], &["fps"]);
    }
    for time in ["nan", "inf", "noon"] {
        assert_option_refused(&["--time", time], &["time"]);
    }
    for clamp in ["-1", "nan"] {
        assert_option_refused(&["--set", &format!("clamp={clamp}")], &["clamp"]);
    }
    assert_option_refused(&["--reference", "--set", "clamp=3"], &["clamp", "--reference"]);
}

/// Started by `mpirun` without the feature, every process would write the same files.
#[cfg(not(feature = "mpi"))]
#[test]
fn rejects_one_of_several_processes_without_mpi() {
    for (size, number) in [("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK")] {
        let case = Case::new();
        let out = case.path("out");
        let start = |command: &str, processes: &str| {
            let mut started = program(&[command, "builtin:cornell"]);
            started.env(size, processes).env(number, "0");
            if command == "render" {
                started.args(["--size", "32x18", "--out"]).arg(&out);
            }
            started.output().unwrap()
        };
        assert_refused(size, &start("render", "2"), 1, &["several processes", "--features mpi"]);
        assert_eq!(files_in(&out), Vec::<PathBuf>::new());
        for (command, processes) in [("render", "1"), ("info", "2")] {
            let output = start(command, processes);
            assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
        }
    }
}
