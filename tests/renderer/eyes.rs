//! Canted eyes with asymmetric fields of view. Resampling to each eye's projection matches tracing that projection
//! directly.

use crate::common::{Stage, Subject, foveate, is_thorough, project, sampled, still_rig};
use crate::pictures::distances;
use diptych::RunConfig;
use diptych::frame::Foveation;
use diptych::image::display::display_value;
use diptych::image::{Extent, Image, RgbImage};
use diptych::passes::{Aov, Display};
use diptych::projection::{LogPolar, PolarSpace};
use diptych::scene::head::HeadMotion;
use diptych::scene::optics::Fov;
use diptych::scene::rig::Eye;
use diptych::scene::shot::Gaze;
use glam::{DMat3, DQuat, DVec2, DVec3, EulerRot};
use serde_json::json;

/// Tangents of the left eye's field of view: left, right, up and down. The right eye's is mirrored.
const TAN: [f64; 4] = [-1.0, 0.8, 0.9, -1.1];

/// Returns the size of an eye's image with this many pixels per tangent. It is a part of an image with a symmetric
/// field of view.
pub fn size(per_tan: u32) -> Extent {
    Extent::new(9 * per_tan / 5, 2 * per_tan)
}

fn tan(eye: Eye) -> [f64; 4] {
    let [left, right, up, down] = TAN;
    if eye == Eye::LEFT { TAN } else { [-right, -left, up, down] }
}

/// Returns the orientation: rotated outwards by 5 degrees, for one eye also upwards and around its axis.
fn orientation(eye: Eye) -> DQuat {
    let [yaw, pitch, roll] = if eye == Eye::LEFT { [5.0f64, 0.0, 0.0] } else { [-5.0, 1.5, 1.0] };
    DQuat::from_euler(EulerRot::YXZ, yaw.to_radians(), pitch.to_radians(), roll.to_radians())
}

fn position(eye: Eye) -> DVec3 {
    DVec3::new(if eye == Eye::LEFT { -0.032 } else { 0.033 }, 0.002, -0.01)
}

fn motion(has_eyes: bool) -> HeadMotion {
    let eye = |eye| {
        let [left, right, up, down] = tan(eye).map(f64::atan);
        let fov = json!({ "left": left, "right": right, "up": up, "down": down });
        json!({ "position_m": position(eye).to_array(), "orientation": orientation(eye).to_array(), "fov": fov })
    };
    let mut header = json!({ "diptych_motion": 1 });
    if has_eyes {
        header["eyes"] = json!({ "left": eye(Eye::LEFT), "right": eye(Eye::RIGHT) });
    }
    let first = json!({ "time_s": 0, "position_m": [0.1, 0, 0], "orientation": [0, 0, 0, 1] });
    let then = json!({ "time_s": 1, "position_m": [0.15, 0.02, -0.1], "orientation": [0, 0.03, 0, 0.99955] });
    HeadMotion::parse(format!("{header}\n{first}\n{then}\n").as_bytes()).unwrap()
}

/// Returns the subject seen by these eyes, and settings with this many samples.
pub fn shown(shot: &str, per_tan: u32, spp: u32) -> (Subject, RunConfig) {
    let mut subject = Subject::load(shot);
    subject.rig = motion(true).rig(&subject.rig).unwrap();
    let size = size(per_tan);
    let mut settings = subject.settings(size.width, size.height);
    let projection = subject.rig.optics.unwrap().rectified(size).unwrap();
    settings.buffers.display = Display::Resampled { projection, is_late: false };
    settings.envelope.most.spp = spp.into();
    (subject, settings)
}

/// Traces an eye's image directly at its own projection, as part of an image with a symmetric field of view. Returns
/// two images with different random numbers.
fn traced(shot: &str, eye: Eye, per_tan: u32, spp: u32) -> [RgbImage; 2] {
    let mut subject = Subject::load(shot);
    let head = motion(false).rig(&subject.rig).unwrap();
    let per_metre = 1.0 / head.metres_per_unit as f32;
    let [left, right] = Eye::BOTH.map(|eye| head.view(0.0, eye));
    let axes = |v: DVec3| left.right * v.x as f32 + left.up * v.y as f32 - left.forward * v.z as f32;
    let origin = (left.origin + right.origin) / 2.0 + axes(position(eye)) * per_metre;
    let turned = orientation(eye);
    let tan = tan(eye);
    let half = [tan[1].max(-tan[0]), tan[2].max(-tan[3])];
    // Both views have the pose of this eye.
    subject.rig = still_rig(origin, axes(turned * DVec3::NEG_Z), axes(turned * DVec3::Y), half[1] as f32);
    let [width, height] = half.map(|tan| (2.0 * tan * f64::from(per_tan)).round() as u32);
    let mut settings = subject.settings(width, height);
    (settings.envelope.most.spp, settings.seed) = (spp.into(), 7);
    let whole = Stage::alone(&subject, &settings).frame(0).linear;
    let [first, above] = [tan[0] + half[0], half[1] - tan[2]].map(|tan| (tan * f64::from(per_tan)).round() as u32);
    let extent = size(per_tan);
    let at = |i: u32| ((above + i / extent.width) * width + first + i % extent.width) as usize;
    whole.into_outer().map(|whole| {
        let pixels = (0..extent.area() as u32).map(|i| whole.pixels[at(i)]).collect();
        Image { extent, pixels }
    })
}

/// Returns the PSNR in dB between the limits of two pairs of images. The images of a pair have different random
/// numbers, so the noise of the first difference to a reference is independent of that of the second. The mean of their
/// products is the mean squared error without noise; it may be slightly below 0 if there is no error.
fn psnr_without_noise(references: &[RgbImage; 2], images: &[RgbImage; 2]) -> f64 {
    let value = |image: &RgbImage, i: usize, c: usize| display_value(f64::from(image.pixels[i][c]));
    let values = (0..images[0].pixels.len()).flat_map(|i| [0, 1, 2].map(|c| (i, c)));
    let product = |(i, c)| (0..2).map(|k| value(&images[k], i, c) - value(&references[k], i, c)).product::<f64>();
    let (n, sum) = values.map(product).fold((0.0, 0.0), |(n, sum), product| (n + 1.0, sum + product));
    -10.0 * f64::abs(sum / n).log10()
}

fn light(images: &[RgbImage; 2]) -> f64 {
    images.iter().flat_map(|image| image.pixels.as_flattened()).copied().map(f64::from).sum()
}

#[test]
fn resampled_eyes_match_eyes_traced_directly() {
    // The second scene has hard edges beside a lamp, which need as many pixels as headsets have.
    let thorough = [("builtin:cornell", 80, 128), ("builtin:checker", 160, 64)];
    let quick = [("builtin:cornell", 40, 64)];
    for &(shot, per_tan, spp) in if is_thorough() { &thorough[..] } else { &quick } {
        let (subject, settings) = shown(shot, per_tan, spp);
        let [first, second] = [0, 1].map(|seed| {
            let settings = RunConfig { seed, ..settings.clone() };
            Stage::alone(&subject, &settings).frame(0).linear
        });
        for eye in Eye::BOTH {
            let images = [first.of(eye).clone(), second.of(eye).clone()];
            let references = traced(shot, eye, per_tan, 2 * spp);
            let psnr = psnr_without_noise(&references, &images);
            let mean_ratio = light(&images) / light(&references);
            println!("{shot}, {eye}: {psnr} dB, {mean_ratio}");
            assert!(psnr >= 38.0, "{shot}, {eye}: {psnr} dB");
            assert!((mean_ratio - 1.0).abs() <= 0.005, "{shot}, {eye}: {mean_ratio}");
        }
    }
}

/// Gaze of each eye, fractions of its own image.
const GAZE: [[f64; 2]; 2] = [[0.3, 0.6], [0.55, 0.35]];

pub fn gaze() -> [Gaze; 2] {
    GAZE.map(|[x, y]| Gaze { path: vec![[0.0, x, y]] })
}

const LOG_POLAR: PolarSpace = PolarSpace::Log(LogPolar::COMPOSITE);

/// Each eye is sampled fully around its own gaze and less in the periphery, although the layers are defined in the
/// shared projection.
#[test]
fn foveation_layers_follow_the_gaze_of_each_eye() {
    let (subject, mut settings) = shown("builtin:cornell", 40, 1);
    let foveation = Foveation::default();
    settings.buffers.aovs = vec![Aov::Spp];
    foveate(&mut settings, gaze(), foveation, [0; 3]);
    let mut stage = Stage::alone(&subject, &settings);
    stage.frame(0);
    let sampled = stage.aov(0);
    let extent = size(40);
    for (eye, sampled) in Eye::BOTH.into_iter().zip([&sampled.left()[0], &sampled.right()[0]]) {
        let ([inner, outer], _) = foveation.circles(GAZE[eye.index()], extent);
        let share = |is_counted: &dyn Fn(f64) -> bool| {
            let counted =
                distances(GAZE[eye.index()], extent).into_iter().zip(sampled).filter(|(off, _)| is_counted(*off));
            let (pixels, sum) = counted.fold((0.0, 0.0), |(n, sum), (_, spp)| (n + 1.0, sum + f64::from(*spp)));
            sum / pixels
        };
        let (within, beyond) = (share(&|off| off < 0.85 * inner), share(&|off| off > 1.6 * outer));
        println!("{eye}: {within} and {beyond}");
        assert_eq!(within, 1.0, "{eye}");
        assert!((beyond - 0.5).abs() < 0.05, "{eye}: {beyond}");
        let rim = share(&|off| (0.9..1.1).contains(&(off / (0.5 * (inner + outer)))));
        assert!((rim - 0.75).abs() < 0.12, "{eye}: {rim}");
    }
}

/// Returns the root mean square difference of these pixels, roughly in display encoding.
fn difference(images: [&RgbImage; 2], is_counted: impl Fn(usize) -> bool) -> f64 {
    let encoded = |image: &RgbImage, i: usize, c: usize| f64::from(image.pixels[i][c]).powf(1.0 / 2.2);
    let values = (0..images[0].pixels.len()).filter(|i| is_counted(*i)).flat_map(|i| [0, 1, 2].map(|c| (i, c)));
    let squares = values.map(|(i, c)| (encoded(images[0], i, c) - encoded(images[1], i, c)).powi(2));
    let (n, sum) = squares.fold((0.0, 0.0), |(n, sum), square| (n + 1.0, sum + square));
    f64::sqrt(sum / n)
}

/// Polar images lose detail in the periphery. Near the gaze they lose no more than with symmetric eyes.
#[test]
fn polar_images_are_sharp_at_the_gaze_of_each_eye() {
    let size = size(50);
    let rectified = shown("builtin:checker", 50, 16);
    let alike = {
        let mut subject = Subject::load("builtin:checker");
        subject.rig = motion(false).rig(&subject.rig).unwrap();
        // The field of view is similar to that of the other eyes.
        subject.rig.yfov_rad = 2.0;
        let mut settings = subject.settings(size.width, size.height);
        settings.envelope.most.spp = 16.into();
        (subject, settings)
    };
    // Differences by eye: near the gaze and far from it.
    let errors = |(subject, settings): &(Subject, RunConfig), space: PolarSpace| {
        let render = |polar: Option<PolarSpace>| {
            let mut settings = settings.clone();
            if let Some(polar) = polar {
                project(&mut settings, gaze(), polar);
            }
            Stage::alone(subject, &settings).frame(0).linear
        };
        let [whole, found] = [None, Some(space)].map(render);
        [(Eye::LEFT, [whole.left(), found.left()]), (Eye::RIGHT, [whole.right(), found.right()])].map(
            |(eye, images)| {
                let off = distances(GAZE[eye.index()], size);
                [difference(images, |i| off[i] < 10.0), difference(images, |i| off[i] > 40.0)]
            },
        )
    };
    for space in sampled([PolarSpace::Visual, LOG_POLAR], 2) {
        let [found, beside] = [&rectified, &alike].map(|seen| errors(seen, space));
        for (eye, ([near, far], [near_alike, _])) in Eye::BOTH.into_iter().zip(found.into_iter().zip(beside)) {
            println!("{space}, {eye}: {near} and {far}, with eyes that are alike {near_alike}");
            assert!(near < 0.5 * far, "{space}, {eye}: {near} and {far}");
            assert!(near < 1.3 * near_alike, "{space}, {eye}: {near}, with eyes that are alike {near_alike}");
        }
    }
}

/// Motion vectors are those of each eye's display image, although the shared projection is rendered.
#[test]
fn motion_vectors_belong_to_the_display_image() {
    let (subject, mut settings) = shown("builtin:cornell", 40, 1);
    settings.buffers.aovs = vec![Aov::Motion, Aov::Position];
    let mut stage = Stage::alone(&subject, &settings);
    let times_s = [0.0, 1.0];
    (0..).zip(times_s).for_each(|(index, time_s)| drop(stage.frame_at(time_s, index)));
    let [motion, places] = [0, 1].map(|i| stage.aov(i));
    let extent = size(40);
    let optics = subject.rig.optics.unwrap();
    for (eye, motion, places) in
        [(Eye::LEFT, motion.left(), places.left()), (Eye::RIGHT, motion.right(), places.right())]
    {
        let point = |place: DVec3, time_s: f64| {
            let (view, lens) = (subject.rig.view(time_s, eye), &optics.lenses[eye.index()]);
            let axes = DMat3::from_cols(view.right.as_dvec3(), view.up.as_dvec3(), view.forward.as_dvec3());
            let seen = lens.axes.transpose() * (axes.transpose() * (place - view.origin.as_dvec3()));
            let (x, y) = (seen.x / seen.z, seen.y / seen.z);
            let Fov { left, right, up, down } = lens.tan;
            let (width, height) = (f64::from(extent.width), f64::from(extent.height));
            DVec2::new((x - left) / (right - left) * width, (up - y) / (up - down) * height)
        };
        let seen = (0..extent.area()).filter(|&i| places.iter().any(|plane| plane[i] != 0.0));
        let mut most: f64 = 0.0;
        for i in seen {
            let place = DVec3::from([0, 1, 2].map(|c| f64::from(places[c][i])));
            let expected = point(place, times_s[0]) - point(place, times_s[1]);
            let found = DVec2::new(motion[0][i].into(), motion[1][i].into());
            most = most.max(expected.length());
            assert!(found.distance(expected) < 0.05 + 0.03 * expected.length(), "{eye}, {i}: {found} {expected}");
        }
        assert!(most > 1.0, "{eye}: nothing moves");
    }
}
