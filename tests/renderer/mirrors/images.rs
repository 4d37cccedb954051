//! Images of surfaces in mirrors and glass: where they lie, and where the previous frame saw them.

use super::*;
use crate::pictures::seen_at;

/// What an eye sees in a frame.
struct Surfaces {
    hit: Vec<[u32; 4]>,
    guide: Vec<[u32; 4]>,
    last: Vec<[u32; 4]>,
    /// Where rays meet a pixel.
    centre: DVec2,
}

impl Surfaces {
    /// Returns where the ray of a pixel meets the image.
    fn centre(&self, at: usize, extent: Extent) -> DVec2 {
        let width = extent.width as usize;
        self.centre + dvec2((at % width) as f64, (at / width) as f64)
    }

    /// Returns true if a pixel shows a surface in mirrors.
    fn is_mirrored(&self, at: usize) -> bool {
        self.hit[at][3] & 0x0080_0000 != 0 && self.guide[at][3] != NO_NORMAL
    }

    /// Returns the image point of a pixel that shows a surface in mirrors.
    fn image(&self, at: usize, view: &View, extent: Extent) -> DVec3 {
        let place = self.centre(at, extent);
        let distance = f64::from(f32::from_bits(self.hit[at][1]));
        view.origin.as_dvec3() + distance * view.ray_direction(place.x, place.y, extent)
    }
}

/// Returns what both eyes see in the last of some frames.
fn surfaces(subject: &Subject, extent: Extent, times_s: &[f64]) -> [Surfaces; 2] {
    let mut settings = subject.accumulated(extent.width, extent.height);
    settings.envelope.most.bounces = BOUNCES;
    settings.buffers.declarations = with_outputs(&["hit", "guide", "last_surface"]);
    let mut stage = Stage::alone(subject, &settings);
    let reports = (0..).zip(times_s).map(|(index, time_s)| stage.frame_at(*time_s, index).report);
    let centre: DVec2 = reports.last().expect("there are frames").pixel_centre.map(f64::from).into();
    let images = ["hit", "guide", "last_surface"].map(|name| {
        let eyes = stage.renderer().read_output(Resource::image::<[u32; 4]>(name)).unwrap();
        eyes.into_outer().map(|bytes| bytemuck::pod_collect_to_vec::<u8, [u32; 4]>(&bytes))
    });
    [0, 1].map(|eye| {
        let [hit, guide, last] = images.each_ref().map(|eyes| eyes[eye].clone());
        Surfaces { hit, guide, last, centre }
    })
}

/// Returns the pixel that shows the mirrored surface nearest to a point and satisfies a condition.
fn nearest(seen: &Surfaces, point: DVec3, is_asked: impl Fn(usize) -> bool) -> Option<usize> {
    let away = |at: &usize| position(seen.guide[*at]).distance(point);
    let others = (0..seen.hit.len()).filter(|at| seen.is_mirrored(*at) && is_asked(*at));
    others.min_by(|a, b| away(a).total_cmp(&away(b))).filter(|found| away(found) < 0.02)
}

fn medians(pairs: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|i| {
        let mut sorted: Vec<f64> = pairs.iter().map(|both| both[i]).collect();
        sorted.sort_by(f64::total_cmp);
        sorted[sorted.len() / 2]
    })
}

fn position(bits: [u32; 4]) -> DVec3 {
    let [x, y, z, _] = bits.map(f32::from_bits);
    vec3(x, y, z).as_dvec3()
}

/// Word of a normal without a surface.
const NO_NORMAL: u32 = 0x8000_8000;

/// Returns the image point that `last_surface` holds for a pixel that shows a surface in mirrors, from the eye.
fn last_image(bits: [u32; 4]) -> DVec3 {
    let steps = [bits[1] & 0x1f_ffff, (bits[1] >> 21) | ((bits[2] & 0x3ff) << 11)];
    let [x, y] = steps.map(|v| 2.0 * f64::from(v) / 2_097_151.0 - 1.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = |v: f64| v - z.min(0.0).abs().copysign(v);
    DVec3::new(fold(x), fold(y), z).normalize() * f64::from(f32::from_bits(bits[2] & 0xffff_fc00))
}

/// The image that a mirror shows was where the surface behind an opening was, also if the mirror or the surface moves.
#[test]
fn previous_mirror_images_match_an_opening() {
    for room in [moving_room, turning_room] as [fn(Wall) -> Subject; 2] {
        let times = [0.05, 0.05 + 1.0 / FPS];
        let [mirror, opening] = [Wall::Mirror, Wall::Opening].map(room);
        let name = &mirror.name;
        let extent = Extent::new(160, 120);
        let [[seen, _], [expected, _]] = [&mirror, &opening].map(|subject| surfaces(subject, extent, &times));
        let view = mirror.rig.view(times[1], Eye::LEFT);
        let is_same = |at: &usize| {
            let image = seen.image(*at, &view, extent);
            let is_surface = seen.is_mirrored(*at) && expected.guide[*at][3] != NO_NORMAL;
            is_surface && image.distance(position(expected.guide[*at])) < 0.002
        };
        let pixels: Vec<_> = (0..seen.hit.len()).filter(is_same).collect();
        let image = |at: usize| view.origin.as_dvec3() + last_image(seen.last[at]);
        let far = pixels.iter().filter(|at| image(**at).distance(position(expected.last[**at])) > 0.002).count();
        println!("{name}: {far} of {} images are elsewhere", pixels.len());
        assert!(pixels.len() > 2000 && far < pixels.len() / 200, "{name}: {far} of {}", pixels.len());
    }
}

/// Returns the room with a ball in its middle.
fn room_with_ball(name: &str, material: Material) -> Subject {
    let mut scene = room(Wall::Opening).scene;
    let material = add_material(&mut scene, material);
    place_at(&mut scene, icosphere(4, true, material), scaled_at(0.6, vec3(0.0, 1.2, -0.8)));
    subject(name, scene)
}

/// The images of surfaces in a mirror ball and in a glass ball lie where the other eye sees the surfaces. A search over
/// all of its pixels tells where that is.
#[test]
fn images_in_balls_match_a_search_in_the_other_eye() {
    const EXTENT: Extent = Extent::new(160, 120);
    let balls = [("mirror ball", studio::metal(Vec3::ONE, 0.0), 0.2, 0.2), ("glass ball", solid_glass(), 0.064, 1.0)];
    for (name, material, baseline_m, most) in balls {
        let mut subject = room_with_ball(name, material);
        subject.rig.baseline_m = baseline_m;
        let [seen, other] = surfaces(&subject, EXTENT, &[0.0]);
        let [left, right] = Eye::BOTH.map(|eye| subject.rig.view(0.0, eye));
        let material = |seen: &Surfaces, at: usize| seen.hit[at][3] & 0x00ff_ffff;
        let mut off = Vec::new();
        for at in (0..seen.hit.len()).filter(|at| seen.is_mirrored(*at)) {
            let point = position(seen.guide[at]);
            let is_same = |there| material(&other, there) == material(&seen, at);
            let Some(found) = nearest(&other, point, is_same) else { continue };
            let apart = |place: DVec3| seen_at(&right, place, EXTENT).distance(other.centre(found, EXTENT));
            let image = seen.image(at, &left, EXTENT) - left.origin.as_dvec3();
            let surface = image.normalize() * left.origin.as_dvec3().distance(point);
            off.push([image, surface].map(|way| apart(left.origin.as_dvec3() + way)));
        }
        let [by_image, by_surface] = medians(&off);
        println!("{name}: {} pixels, {by_image:.2} px off, {by_surface:.2} at the surface's own distance", off.len());
        assert!(off.len() > 200 && by_image < most && by_surface > 3.0 * by_image, "{name}: {by_image} {by_surface}");
    }
}

/// The images of surfaces in balls that roll past were where the previous frame saw the surfaces. A search over all of its
/// pixels tells where that is.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn previous_images_in_rolling_balls_match_a_search() {
    const EXTENT: Extent = Extent::new(320, 240);
    let mirror = studio::metal(Vec3::ONE, 0.0);
    for (name, material, most) in [("mirror ball", mirror, 0.6), ("glass ball", solid_glass(), 1.4)] {
        let mut draft = Draft::new(name);
        draft.scene = room(Wall::Opening).scene;
        let material = add_material(&mut draft.scene, material);
        let ball = add_mesh(&mut draft.scene, icosphere(4, true, material));
        let at = vec3(-0.2, 1.2, -0.8);
        let node = draft.node(None, at.as_dvec3(), DVec3::splat(0.6));
        draft.shift(node, at, at + 2.0 * Vec3::X);
        draft.swing(node, DVec3::Z, -1.5);
        draft.body(ball, node, None, Vec::new());
        let mut subject = subject(name, draft.done());
        let view = subject.rig.view(0.0, Eye::LEFT);
        subject.rig = still_rig(view.origin, view.forward, view.up, view.tan_half_yfov);
        let view = subject.rig.view(0.0, Eye::LEFT);
        let times = [0.1, 0.1 + 1.0 / FPS];
        let [[was, _], [is, _]] = [1, 2].map(|frames| surfaces(&subject, EXTENT, &times[..frames]));
        let mut off = Vec::new();
        for at in (0..is.hit.len()).filter(|at| is.is_mirrored(*at)).step_by(4) {
            let Some(found) = nearest(&was, position(is.guide[at]), |_| true) else { continue };
            let apart = |place: DVec3| seen_at(&view, place, EXTENT).distance(was.centre(found, EXTENT));
            let rolled = view.origin.as_dvec3() + last_image(is.last[at]);
            off.push([apart(rolled), apart(is.image(at, &view, EXTENT))]);
        }
        let [rolled, still] = medians(&off);
        println!("{name}: {} pixels, median {rolled:.2} px off, {still:.2} at the place in this frame", off.len());
        assert!(off.len() > 200 && rolled < most && still > 2.0 * rolled, "{name}: {rolled} {still}");
    }
}
