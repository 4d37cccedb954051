//! Eyes with asymmetric fields of view that are turned apart: what they show is what is traced at their own projections.

use crate::common::{Stage, Subject, is_thorough, still_rig};
use diptych::exec::RenderSettings;
use diptych::image::{Extent, Image, RgbImage};
use diptych::metrics::Pair;
use diptych::scene::head::HeadMotion;
use diptych::scene::rig::Eye;
use glam::{DQuat, DVec3, EulerRot};
use serde_json::json;

/// Tangents of the left eye's field of view, left, right, up and down; the right eye's is mirrored.
const TAN: [f64; 4] = [-1.0, 0.8, 0.9, -1.1];

/// Of an eye's image, with so many pixels per tangent: a part of one with a symmetric field of view.
fn size(per_tan: u32) -> Extent {
    Extent::new(9 * per_tan / 5, 2 * per_tan)
}

fn tan(eye: Eye) -> [f64; 4] {
    let [left, right, up, down] = TAN;
    if eye == Eye::Left { TAN } else { [-right, -left, up, down] }
}

/// Turned outwards by 5 degrees, one of them also upwards and around its axis.
fn orientation(eye: Eye) -> DQuat {
    let [yaw, pitch, roll] = if eye == Eye::Left { [5.0f64, 0.0, 0.0] } else { [-5.0, 1.5, 1.0] };
    DQuat::from_euler(EulerRot::YXZ, yaw.to_radians(), pitch.to_radians(), roll.to_radians())
}

fn position(eye: Eye) -> DVec3 {
    DVec3::new(if eye == Eye::Left { -0.032 } else { 0.033 }, 0.002, -0.01)
}

fn motion(has_eyes: bool) -> HeadMotion {
    let eye = |eye| {
        let [left, right, up, down] = tan(eye).map(f64::atan);
        let fov = json!({ "left": left, "right": right, "up": up, "down": down });
        json!({ "position_m": position(eye).to_array(), "orientation": orientation(eye).to_array(), "fov": fov })
    };
    let mut header = json!({ "diptych_motion": 1 });
    if has_eyes {
        header["eyes"] = json!({ "left": eye(Eye::Left), "right": eye(Eye::Right) });
    }
    let sample = json!({ "time_s": 0, "position_m": [0.1, 0, 0], "orientation": [0, 0, 0, 1] });
    HeadMotion::parse(format!("{header}\n{sample}\n").as_bytes()).unwrap()
}

/// The subject seen by these eyes, and settings with so many samples.
fn shown(shot: &str, per_tan: u32, spp: u32) -> (Subject, RenderSettings) {
    let mut subject = Subject::load(shot).with_common_shaders();
    subject.rig = motion(true).rig(&subject.rig).unwrap();
    let size = size(per_tan);
    let mut settings = subject.settings(size.width, size.height);
    settings.stages.rectified = Some(subject.rig.optics.unwrap().grid(size, 1.25).unwrap());
    settings.stages.spp = spp;
    (subject, settings)
}

/// What an eye sees, traced at its own projection: part of an image with a symmetric field of view.
fn traced(shot: &str, eye: Eye, per_tan: u32, spp: u32) -> RgbImage {
    let mut subject = Subject::load(shot).with_common_shaders();
    let head = motion(false).rig(&subject.rig).unwrap();
    let per_metre = 1.0 / head.metres_per_unit as f32;
    let [left, right] = Eye::ALL.map(|eye| head.view(0.0, eye));
    let axes = |v: DVec3| left.right * v.x as f32 + left.up * v.y as f32 - left.forward * v.z as f32;
    let origin = (left.origin + right.origin) / 2.0 + axes(position(eye)) * per_metre;
    let turned = orientation(eye);
    let tan = tan(eye);
    let half = [tan[1].max(-tan[0]), tan[2].max(-tan[3])];
    subject.rig = still_rig(origin, axes(turned * DVec3::NEG_Z), axes(turned * DVec3::Y), half[1] as f32);
    let [width, height] = half.map(|tan| (2.0 * tan * f64::from(per_tan)).round() as u32);
    let mut settings = subject.settings(width, height);
    (settings.stages.spp, settings.seed) = (spp, 7);
    let whole = Stage::alone(&subject, &settings).frame(0).linear.left;
    let [first, above] = [tan[0] + half[0], half[1] - tan[2]].map(|tan| (tan * f64::from(per_tan)).round() as u32);
    let extent = size(per_tan);
    let pixel = |i: u32| whole.pixels[((above + i / extent.width) * width + first + i % extent.width) as usize];
    Image { extent, pixels: (0..extent.area() as u32).map(pixel).collect() }
}

#[test]
fn eyes_show_what_is_traced_at_their_own_projections() {
    let thorough = [("builtin:cornell", 80, 1024), ("builtin:checker", 160, 512)];
    let quick = [("builtin:cornell", 40, 128), ("builtin:furnace", 40, 16)];
    for (shot, per_tan, spp) in if is_thorough() { thorough } else { quick } {
        let (subject, settings) = shown(shot, per_tan, spp);
        let frame = Stage::alone(&subject, &settings).frame(0);
        for (eye, image) in [(Eye::Left, &frame.linear.left), (Eye::Right, &frame.linear.right)] {
            let errors = Pair::new(&traced(shot, eye, per_tan, spp), image, 0.0).unwrap().errors();
            let (psnr, mean_ratio) = (errors.psnr, errors.mean_ratio.unwrap());
            println!("{shot}, {eye}: {psnr} dB, {mean_ratio}");
            assert!(psnr >= 38.0, "{shot}, {eye}: {psnr} dB");
            assert!((mean_ratio - 1.0).abs() <= 0.005, "{shot}, {eye}: {mean_ratio}");
        }
    }
}

#[test]
fn what_eyes_show_is_of_one_device_on_any_number() {
    let (subject, mut settings) = shown("builtin:cornell", 40, 1);
    settings.stages.filter = Some(diptych::quality::Denoiser::Svgf);
    (settings.stages.reproject, settings.stages.iterations) = (true, 3);
    let frames = |devices| {
        let mut stage = Stage::even(&subject, &settings, devices);
        [0, 1].map(|index| stage.frame(index).linear)
    };
    let one = frames(1);
    assert_eq!(one[0].left.extent, size(40));
    for devices in [2, 3] {
        assert!(frames(devices) == one, "{devices} devices");
    }
}
