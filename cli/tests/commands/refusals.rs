//! Command lines with an invalid option end in one error that names the cause, with exit status 2 and without a file.
//! [`Folder::refuses`] explains the tables.

mod files;

use crate::common::Folder;

/// A small frame of the box.
const RENDER: &str = "render builtin:cornell --size 32x18 --out ./out";

#[test]
fn rejects_invalid_options_of_render() {
    let table = "
    render builtin:cornell --out ./out --size={0x0 abc 99999x99999 64 64x -4x4 1e3x10 0x10} => --size | {}
    --spp={0 1000000000 10000000000 -1 many 0.5 nan} => spp | {}
    --reference --spp 1.5 => --reference | --spp 1.5
    --spp 2000000 => spp 2000000 | --reference
    --bounces 100000 => bounces 100000 | 0 to 1024
    --iterations={11 2,3 2,3,11 , -1} => iterations
    --iterations 2,3,5 => iterations | foveation=layers
    --denoiser none --iterations 3 => iterations has no effect | denoiser
    --seed -1 => -1
    --frames 0 => --frames
    --set max_scene_memory={0 much 4G -1GiB} => max_scene_memory | {}

    --foveation layers --gaze={0.5 1.5,0.5 -0.1,0.5 0.5,0.5,0.5 nan,0.5 a,b} => --gaze
    --gaze 0.5,0.5 => gaze | foveation=layers
    --foveation log-polar --set polar=composit => polar | composite-kernel, or four numbers
    --foveation log-polar --set polar=1,2,3 => polar | or four numbers
    --foveation log-polar --set polar=0.1,1,0,1 => polar | sigma 0.1 is out of range
    --foveation log-polar --set polar=1,1,0.9,1 => polar | gaze 0.9 is out of range
    --foveation log-polar --set polar=1,NaN,0,1 => polar | alpha NaN is out of range
    --set polar=fov => polar has no effect without foveation=log-polar

    --fps={0 -1 nan inf 1e-308} => fps
    --time {nan inf noon} => time
    --set clamp={-1 nan} => clamp
    --warm-up 0 --also preview => --also preview has no effect | --reference
    --reference --set clamp=3 => clamp | --reference

    --quality best => --quality
    --denoiser magic => magic | atrous
    --aov smell => smell | normal
    --set sampler=dice => dice | sobol
    --set sample=pcg => 'sample' | sampler
    --set sampler => KEY=VALUE
    --hard-shadows off => --set hard_shadows=
    paint => paint
    ";
    Folder::new().refuses(2, RENDER, table);
}

#[test]
fn rejects_invalid_options_of_devices() {
    let table = "
    --virtual 3 --ratios 1,2 => 2 ratios | 3 devices
    --virtual 2 --ratios=-1,2 => -1
    --virtual 2 --ratios={0,0 nan,1} => ratio
    --virtual 2 --ratios much,little => much
    --virtual 2 --ratios cooking=1,2 => cooking | path_trace
    --virtual 2 --ratios atrous.middle=1,2 => middle
    --virtual 2 --ratios '' => ratios
    --virtual 2 --balance static => balance cannot be static | ratios
    --virtual 2 --balance even --ratios 1,2 => ratios | balance=static
    --balance fair => fair | measured

    --devices 99 => 99 | diptych info
    --devices first => first
    --virtual {0 1000} => --virtual | {}
    --threads-per-device 0 => threads_per_device 0
    --threads-per-device 1,2 => 2 thread counts
    --set traversal=magic => magic | auto | compute | hardware
    --set slowdown=1,2 => 2 numbers
    --set slowdown=0 => slowdown 0 is out of range
    --set {watchdog_ms max_dispatch_ms}=0 => {} 0 is out of range

    --disturb loss => write KIND:devI@FRAME
    --disturb melt:dev0@frame0 => choose loss, hang, oom or slow
    --disturb loss:dev0@frame7 => disturb loss:dev0@7: there is no frame 7: the last is frame 0
    --disturb slow:dev3@0..2 => disturb slow:dev3@0..2: there is no device 3: there are 1
    --disturb scene-cut@0 => only `diptych play` makes scene cuts
    ";
    Folder::new().refuses(2, RENDER, table);
}

#[test]
fn rejects_invalid_options_of_references() {
    let folder = Folder::new();
    let table = "
    --frames 2 --spp 8 --time-limit 5 => --time-limit is for a single picture
    --spp {1 2.5} --time-limit 5 => --time-limit needs a whole number of at least 2 samples
    --set passes_out=./x => --reference
    --reference --set time_limit={0 -1 nan soon} => time_limit
    --set noise={0 -1 nan soon} => noise
    --noise 0.1 --spp 2.5 => --noise needs a whole number
    --reference --set pass_spp={0 1 12 8192} => pass_spp
    --reference --denoiser svgf => a reference
    --reference --iterations 3 => a reference
    --reference --foveation {layers visual-polar} => a reference
    --reference --set {polar=kernel render_scale=0.5 frames_in_flight=2} => a reference
    --reference --reproject on => a reference
    ";
    folder.refuses(2, RENDER, table);
    let agreed = "--denoiser none --foveation none --set render_scale=1 --reproject off --set frames_in_flight=1";
    folder.run(&format!("{RENDER} --reference --spp 2 {agreed}"));
}

#[test]
fn rejects_invalid_options_of_play() {
    let folder = Folder::new();
    folder.write("none.toml", "[origin]\nshot = 1\n");
    folder.write("two.toml", crate::play::LADDER);
    folder.write("falling.toml", crate::play::LADDER.replace("time_ms = 10.0", "time_ms = 0.5"));
    let table = "
    --budget-ms 20..11 => give two times, 0 < LO < HI
    --budget-ms 20 => write LO..HI
    --budget-ms a..b => 'a' is not a time
    --ladder /nowhere/ladder.toml => cannot read the ladder
    --ladder ./none.toml => is not a quality ladder
    --ladder ./falling.toml => rung 2
    --ladder ./two.toml --denoiser svgf => none of its 2 rungs uses --denoiser svgf
    --disturb earthquake => slow:devI@FROM..TO, or scene-cut@FRAME
    --disturb slow:dev1@7..3 => the frame range 7..3 is empty
    --disturb slow:dev5@1..3 --frames 9 => there is no device 5
    --disturb scene-cut@9 --frames 9 => there is no frame 9
    --iterations 0 => choose --denoiser none
    --denoiser none --iterations 3 => iterations has no effect
    --fps 0 => fps cannot be 0
    --frames 30 --set controller=pid,pinned:0 => --frames greater than 30
    --report --set controller=pid,pinned:0 => --report and several controllers exclude each other
    --replay ./ => cannot use --replay
    --set report_spp=8 => --report, or several controllers
    play --set report_spp=8 --out ./out => --report
    ";
    folder.refuses(2, "play builtin:cornell --size 32x18 --out ./out", table);
}

#[test]
fn rejects_invalid_options_of_measurements() {
    let folder = Folder::new();
    folder.write("bad.toml", "[[peer]]\nname = 'a'\ntime_ms = -1.0\nflip = 0.1");
    folder.write("dark.toml", "exposure_ev = -2\n[[peer]]\nname = 'a'\ntime_ms = 1.0\nflip = 0.1");
    let table = "
    --report --set peers=./dark.toml => measured at -2 EV, the shot's at 0 EV
    bench --report --set peers=./bad.toml --out ./out => time_ms -1
    bench --report --set peers=/nowhere/peers.toml --out ./out => cannot read the peers
    bench --set peers=./bad.toml --out ./out => --report
    --foveation none --set polar=fov => polar has no effect
    --foveation none,log-polar --set unsampled_fraction=0.3 => unsampled_fraction has no effect
    --denoiser none,atrous --set filter_once=on => filter_once has no effect
    --denoiser none --iterations 3 => --iterations | --denoiser
    --set spp=2 => spp has no effect in bench
    scale builtin:checker --size 48x32 --set frames_in_flight=2 --simulate 1,2 --out ./out => frames_in_flight
    ";
    folder.refuses(2, "bench builtin:cornell --out ./out", table);
}

/// The settings of all arrangements are read before the scene.
#[test]
fn rejects_invalid_options_of_studies() {
    let table = "
    study {leria bmfr koskela andersson peres seams} missing.toml --out ./out => missing.toml
    study leria builtin:cornell --set devices=0 --out ./out => two devices | --virtual 2
    study leria builtin:cornell --virtual 2 --views 3 --out ./out => takes two views | 3
    study leria --set sources=3 --out ./out => study leria | sources
    study leria --repeats 3 --out ./out => study leria | --repeats
    study leria --virtual 2 --set ratios=1,2 --out ./out => --simulate | ratios
    study {leria seams} --set balance=even --set ratios=1,2 --out ./out => ratios | balance=static
    study leria --set denoiser=svgf --out ./out => study leria | denoiser
    study leria --set reproject=off --out ./out => study leria | reproject
    study bmfr builtin:cornell --shots builtin:checker --out ./out => SHOT | --shots
    study bmfr --shots builtin:cornell,builtin:checker --out ./out => --shots | Falcor
    study koskela --simulate 3 --out ./out => study koskela | --simulate
    study peres --fraction 0 --out ./out => --fraction
    study andersson --conditions tomorrow --out ./out => tomorrow | published
    study seams --conditions today --out ./out => study seams | --conditions
    study seams builtin:checker --set denoiser=none --out ./out => study seams | denoiser
    study seams builtin:checker --counts 1 --out ./out => --counts
    study seams builtin:checker --set seam=none --out ./out => study seams | seam
    study nobody --out ./out => nobody | leria | bmfr | koskela | andersson | peres | seams
    ";
    Folder::new().refuses(2, "", table);
}

#[test]
fn rejects_invalid_options_of_other_commands() {
    let table = "
    info --check --minutes 0 --out ./unused => from 0.05 to 600 minutes
    info builtin:cornell --set clamp=nan => clamp has no effect in info
    info builtin:cornell --set time=nan => time cannot be NaN
    info --set environment=sky => environment has no effect in info without a shot
    export builtin:cornell -o ./a.png --set spp=64 => spp has no effect in a contact sheet
    export builtin:cornell -o ./a.toml --set spp=64 => spp has no effect in export
    export builtin:cornell --out ./sheet.jpg => .png
    export builtin:sponza --out ./out => sponza
    trace no/such.json => no/such.json
    ";
    Folder::new().refuses(2, "", table);
}

#[cfg(not(feature = "view"))]
#[test]
fn rejects_view_without_its_feature() {
    let folder = Folder::new();
    let table = "
        view => --features view
        view builtin:cornell --size 96x64 --nonsense => --features view
    ";
    folder.refuses(2, "", table);
    assert!(folder.run("--help").out.contains("view"));
}

/// Its camera has a path, which options replace as a whole.
#[test]
fn rejects_options_without_a_view() {
    let folder = Folder::new();
    folder.run("export builtin:cornell --out ./box");
    let table = "
    --position 1,2 => three numbers
    --yfov 180 => below 180
    --exposure 25 => -24 to 24
    --set baseline=-1 => 0 or a number above
    --environment sky.png => .hdr
    --environment no-such-sky.hdr => no-such-sky.hdr
    --set camera=0 => no camera (--set camera=N)
    --position 1,1,1 --target 1,1,1 => same point | (--set position=X,Y,Z, --set target=X,Y,Z)
    export ./box/cornell.glb --out ./box/cornell.toml => the file exists
    ";
    folder.refuses(2, "render ./box/cornell.toml --out ./out", table);
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
    Folder::new().refuses(1, "", "render builtin:cornell --size 8192x8192 --out ./out => 8192x8192 | MiB");
}

#[test]
fn rejects_hardware_traversal_without_ray_queries() {
    let adapters = diptych::device::adapters();
    let Some(unable) = adapters.iter().find(|a| !a.ray_queries && a.missing.is_empty()) else {
        eprintln!("\nSKIPPED: every adapter here has ray queries\n");
        return;
    };
    let command = format!("{RENDER} --set traversal=hardware --devices {}", unable.index);
    let parts = format!("no ray queries | {} | --set traversal=compute | --set devices=N", unable.name);
    Folder::new().refuses(2, "", &format!("{command} => {parts}\n{command} --reference => {parts}"));
}

/// Started by `mpirun` without the feature, every process would write the same files.
#[cfg(not(feature = "mpi"))]
#[test]
fn rejects_one_of_several_processes_without_mpi() {
    for (size, number) in [("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"), ("PMI_SIZE", "PMI_RANK")] {
        let folder = Folder::new();
        let start = |line: &str, processes: &str| {
            let output = folder.program(line).env(size, processes).env(number, "0").output().unwrap();
            crate::common::Said::new(output)
        };
        let said = start(RENDER, "2");
        assert_eq!((said.status, said.errors.lines().count()), (Some(1), 1), "{}", said.errors);
        assert!(said.errors.contains("several processes") && said.errors.contains("--features mpi"), "{}", said.errors);
        assert!(folder.files().is_empty());
        start(RENDER, "1").success("render in one process");
        start("info builtin:cornell", "2").success("info in two processes");
    }
}

/// An existing picture is replaced completely or not at all.
#[test]
fn rejects_output_folders_that_cannot_be_made() {
    let folder = Folder::new();
    folder.write("file", "in the way");
    folder.write("out/left.exr", "earlier");
    let table = "
        render builtin:cornell --size 32x18 --out {./file ./file/below} => ./file | --out
        export builtin:cornell --out ./file => choose another --out
    ";
    folder.refuses(1, "", table);
    #[cfg(target_os = "linux")] // Not even root can create folders there.
    folder.refuses(1, "", "render builtin:cornell --size 32x18 --out /proc/diptych-test => /proc/diptych-test");
    folder.refuses(2, RENDER, "--virtual 3 --ratios 1,2 => ratios");
}
