//! `view` opens a window, follows the pointer and shows both eyes as rendered. Without Xvfb it is skipped with a
//! message.

#![cfg(feature = "view")]

mod common;

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ::diptych::exec::FrameParams;
use ::diptych::image::display::DisplayImage;
use ::diptych::image::{Extent, Image};
use common::stage::{Stage, Subject, still_rig};
use common::{Folder, Said};
use glam::Vec3;

/// A virtual display, which ends when this is dropped.
struct Display {
    server: Child,
    name: String,
    /// Folder with the server's framebuffer.
    memory: Folder,
}

impl Display {
    /// Opens a display; none without Xvfb.
    fn open() -> Option<Self> {
        let memory = Folder::new();
        // The server picks a free number and writes it to its standard output.
        let server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1400x900x24", "-nolisten", "tcp", "-fbdir"])
            .arg(memory.path(""))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut server) = server else {
            eprintln!(
                "\nSKIPPED: there is no Xvfb here to open a window on (Debian or Ubuntu: apt-get install xvfb)\n"
            );
            return None;
        };
        let mut number = String::new();
        let mut output = std::io::BufReader::new(server.stdout.take().unwrap());
        std::io::BufRead::read_line(&mut output, &mut number).unwrap();
        assert!(number.trim().parse::<u32>().is_ok(), "Xvfb did not start: '{number}'");
        Some(Self { server, name: format!(":{}", number.trim()), memory })
    }

    /// Returns the framebuffer's file: a header, and four bytes per pixel.
    fn shown(&self) -> Vec<u8> {
        self.memory.bytes("Xvfb_screen0")
    }

    /// Waits until the window shows more than the warm-up message.
    fn wait_for_frames(&self) {
        let begin = Instant::now();
        let is_lit = |pixel: &&[u8]| pixel[..3].iter().any(|c| *c > 60);
        while self.shown().chunks_exact(4).filter(is_lit).count() < 50_000 {
            assert!(begin.elapsed() < Duration::from_secs(120), "no frame in two minutes");
            std::thread::sleep(Duration::from_millis(200));
        }
    }

    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.env("DISPLAY", &self.name).env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
        command
    }

    fn view(&self, folder: &Folder, options: &str) -> Child {
        let mut command = self.command(env!("CARGO_BIN_EXE_diptych"));
        command.args(folder.words(&format!("view --size 48x32 --virtual 2 --quiet --fps 30 {options}")));
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Moves the pointer to a place in the window, then executes `args`. Returns false without xdotool.
    fn xdotool(&self, at: &str, args: &str) -> bool {
        let find = format!("search --sync --name diptych: windowfocus mousemove --window %1 {at}");
        for args in [&find, args] {
            let Ok(done) = self.command("xdotool").args(args.split_whitespace()).output() else {
                eprintln!("\nSKIPPED: there is no xdotool here to press keys with (apt-get install xdotool)\n");
                return false;
            };
            Said::new(done).success(args);
        }
        true
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

#[track_caller]
fn ended(child: Child) {
    Said::new(child.wait_with_output().unwrap()).success("view");
}

fn read(path: &Path) -> DisplayImage {
    let file = ::image::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())).into_rgb8();
    let extent = Extent::new(file.width(), file.height());
    Image { extent, pixels: file.pixels().map(|p| p.0).collect() }
}

/// Averages the window's pixels over each pixel of an image that is shown at (`x`, `y`), `scale` times as large.
fn reduced(window: &DisplayImage, [x, y]: [u32; 2], scale: u32, extent: Extent) -> DisplayImage {
    let pixel = |i: usize| {
        let (column, row) = (i as u32 % extent.width * scale + x, i as u32 / extent.width * scale + y);
        let all = (0..scale * scale).map(|k| window.get(column + k % scale, row + k / scale));
        let sum = all.fold([0; 3], |sum: [u32; 3], p| [0, 1, 2].map(|c| sum[c] + u32::from(p[c])));
        sum.map(|c| (c / (scale * scale)) as u8)
    };
    Image { extent, pixels: (0..extent.area()).map(pixel).collect() }
}

fn mean_difference(a: &DisplayImage, b: &DisplayImage) -> f64 {
    let all = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    all.clone().map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / all.len() as f64
}

/// A shot with a static camera; that of the built-in shot moves.
const STILL: &str = r#"
name = "cornell"
scene = "builtin:cornell"
[rig]
yfov_deg = 40.0
baseline_m = 0.3
[[rig.key]]
time_s = 0.0
position = [0.0, 1.0, 3.8]
target = [0.0, 1.0, 0.0]
[environment]
radiance = [0.0, 0.0, 0.0]
"#;

/// Returns a folder with this shot.
fn still_shot() -> Folder {
    let folder = Folder::new();
    folder.write("still.toml", STILL);
    folder
}

const EYE: Extent = Extent::new(48, 32);
/// Layout of the window: each eye is 13 times as large, with 4 columns between and 17 rows above and below.
const SCALE: u32 = 13;
const RIGHT: u32 = SCALE * EYE.width + 4;
const ABOVE: u32 = 17;

#[test]
fn the_window_shows_both_eyes_as_they_are_rendered() {
    let Some(display) = Display::open() else { return };
    let folder = still_shot();
    let options = "--frames 90 --budget-ms 1..1000 --screenshot ./window.png";
    let child = display.view(&folder, &format!("./still.toml {options}"));
    // N selects nearest-neighbour magnification. O removes the overlay, which covers a part of the left eye.
    let has_keys = display.xdotool("640 5", "key n o");
    ended(child);
    let window = read(&folder.path("window.png"));
    assert_eq!(window.extent, Extent::new(RIGHT + SCALE * EYE.width, 450));
    folder.run("render ./still.toml --size 48x32 --reference --out ./out");
    let both = read(&folder.path("out/stereo.png"));
    let eye = |right: u32| {
        let pixel = |i: usize| *both.get(i as u32 % EYE.width + right * EYE.width, i as u32 / EYE.width);
        Image { extent: EYE, pixels: (0..EYE.area()).map(pixel).collect() }
    };
    if !has_keys {
        return;
    }
    for right in 0..2 {
        let shown = reduced(&window, [right * RIGHT, ABOVE], SCALE, EYE);
        let [same, other] = [eye(right), eye(1 - right)].map(|eye| mean_difference(&shown, &eye));
        assert!(same < 3.0 && 2.0 * same < other, "eye {right}: {same} levels off, {other} from the other eye");
    }
}

#[test]
fn gaze_follows_the_pointer_and_keys_move_the_eye() {
    let Some(display) = Display::open() else { return };
    let folder = still_shot();
    let shoot = |keys: &str| {
        // Limit the frames, so that the run also ends if no one presses Escape.
        let options = "--set foveation=layers --frames 600 --budget-ms 1..100 --screenshot ./window.png";
        let child = display.view(&folder, &format!("./still.toml {options}"));
        display.wait_for_frames();
        let pressed = display.xdotool("940 320", &format!("sleep 1 {keys} sleep 1 key Escape"));
        ended(child);
        pressed.then(|| read(&folder.path("window.png")))
    };
    let Some(still) = shoot("") else { return };
    let marked = |image: &DisplayImage, [x, y]: [u32; 2]| {
        let is_cyan = |p: &[u8; 3]| p[0] < 110 && p[1] > 140 && p[2] > 160;
        (x - 2..x + 3)
            .flat_map(|x| (y - 2..y + 3).map(move |y| (x, y)))
            .filter(|(x, y)| is_cyan(image.get(*x, *y)))
            .count()
    };
    // The cross is at the pointer, and at the same place in the other eye.
    assert!(marked(&still, [940, 320]) >= 5 && marked(&still, [940 - RIGHT, 320]) >= 5);
    assert!(marked(&still, [900, 200]) == 0);
    let moved = shoot("keydown w sleep 1 keyup w").unwrap();
    let eye = |window: &DisplayImage| reduced(window, [RIGHT, ABOVE], SCALE, EYE);
    let difference = mean_difference(&eye(&still), &eye(&moved));
    assert!(difference > 6.0, "the camera did not move: {difference} levels");
}

/// With a free camera at rest, animations continue.
#[test]
fn what_moves_goes_on_while_the_camera_is_free() {
    let Some(display) = Display::open() else { return };
    let folder = Folder::new();
    let eyes = "position = [0.0, 1.45, 5.2]\ntarget = [0.0, 1.15, 0.0]";
    let text = format!("name = 'studio'\nscene = 'builtin:studio'\n[rig]\nyfov_deg = 45\n[[rig.key]]\n{eyes}\n");
    folder.write("studio.toml", text);
    // Returns the number of framebuffer bytes that change considerably within a second.
    let changed = |animation: &str| {
        let child = display.view(&folder, &format!("./studio.toml --frames 600 --budget-ms 1..100 {animation}"));
        display.wait_for_frames();
        let has_keys = display.xdotool("640 5", "key o p sleep 1");
        let before = display.shown();
        std::thread::sleep(Duration::from_secs(1));
        let after = display.shown();
        let ends = has_keys && display.xdotool("640 5", "key Escape");
        ended(child);
        ends.then(|| before.iter().zip(&after).filter(|(a, b)| a.abs_diff(**b) > 20).count())
    };
    let Some(moving) = changed("") else { return };
    let still = changed("--set animation=none").unwrap();
    let found = format!("{moving} bytes change where things move, {still} where none does");
    assert!(moving > 100_000 && moving > 10 * still, "{found}");
}

/// A lamp moves away from the room, to where it gives a twelfth of its light: exposures may rise by 4 stops above that of
/// the first frame, so a lamp that gave less than a sixteenth would leave the room dark.
#[test]
fn the_metered_exposure_follows_the_light() {
    let Some(display) = Display::open() else { return };
    let folder = Folder::new();
    let lamp = "[[light]]\nkind = 'point'\nposition = [0, 1, 4]\nintensity = 3000\n[[move]]\nlight = 0\n";
    let keys = [(0.0, 4.0), (0.5, 4.0), (1.0, 14.0)];
    let keys =
        keys.map(|(time_s, z)| format!("[[move.key]]\ntime_s = {time_s:?}\nposition = [0, 1, {z:?}]\n")).concat();
    folder.write("lamp.toml", format!("loop = false\n{STILL}{lamp}{keys}"));
    let mean_level = |exposure: &str| {
        let options = "--frames 240 --budget-ms 1..100 --screenshot ./window.png";
        ended(display.view(&folder, &format!("./lamp.toml --set exposure={exposure} {options}")));
        let right = reduced(&read(&folder.path("window.png")), [RIGHT, ABOVE], SCALE, EYE);
        right.pixels.as_flattened().iter().map(|c| f64::from(*c)).sum::<f64>() / (3 * EYE.area()) as f64
    };
    // The second exposure is the one metered for the first frame, whose level is 77.
    let (followed, kept) = (mean_level("auto"), mean_level("-6.35"));
    // They are 72 and 21; the tone curve compresses the twelve-fold difference.
    assert!((65.0..170.0).contains(&followed) && kept < 0.35 * followed, "mean levels {followed} and {kept}");
}

/// Compares a new rig for every frame, as for the window's camera, with one rig that follows a path.
#[test]
fn free_camera_finds_the_history_of_one_on_a_path() {
    let mut on_path = Subject::load("builtin:cornell");
    let (first, last) = (still_rig(Vec3::new(0.0, 1.0, 3.8), Vec3::NEG_Z, Vec3::Y, 0.4), Vec3::new(0.3, 1.1, 3.2));
    let mut end = still_rig(last, Vec3::new(-0.2, 0.0, -1.0), Vec3::Y, 0.4);
    end.keys[0].time_s = 1.0;
    on_path.rig = first.clone();
    on_path.rig.keys.extend(end.keys);
    let poses: Vec<_> = [0.0, 0.25, 0.5, 1.0]
        .map(|time_s| {
            let view = on_path.rig.view(time_s, ::diptych::scene::rig::Eye::LEFT);
            still_rig(view.origin, view.forward, Vec3::Y, view.tan_half_yfov)
        })
        .into();
    let settings = on_path.accumulated(64, 48);
    let path_frames: Vec<_> = {
        let mut stage = Stage::even(&on_path, &settings, 2);
        (0..4).map(|i| stage.frame_at([0.0, 0.25, 0.5, 1.0][i as usize], i).linear).collect()
    };
    let mut stage = Stage::even(&on_path, &settings, 2);
    for (i, (pose, path_frame)) in poses.iter().zip(&path_frames).enumerate() {
        let params = FrameParams { rig: pose.clone(), ..stage.params(0.0, i as u32) };
        let report = stage.renderer().render(&params).unwrap();
        assert_eq!(report.spec.history_rows.is_some(), i > 0, "frame {i}");
        let free = stage.renderer().read_linear().unwrap();
        let pairs = free.left().pixels.as_flattened().iter().zip(path_frame.left().pixels.as_flattened());
        let (error, sum) = pairs.fold((0.0, 0.0), |(e, s), (a, b)| (e + f64::from((a - b).abs()), s + f64::from(*b)));
        // Poses are rounded to single precision.
        assert!(error < 1e-2 * sum, "frame {i}: {error} of {sum}");
    }
}

#[test]
fn rejects_several_controllers_in_a_view() {
    let table = "
    view --set controller=pid,vlachos => controller | diptych play
    view --xr --set controller=pid,vlachos => controller | diptych play
    ";
    Folder::new().refuses(2, "", table);
}

#[cfg(target_os = "linux")]
#[test]
fn rejects_view_without_a_display() {
    let folder = Folder::new();
    let mut command = folder.program("view");
    for name in ["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"] {
        command.env_remove(name);
    }
    let Said { status, errors, .. } = Said::new(command.output().unwrap());
    assert_eq!((status, errors.lines().count()), (Some(1), 1), "{errors}");
    assert!(errors.contains("there is no display here"), "{errors}");
}
