//! Auxiliary images of pixels that show a surface in mirrors or behind glass.

use diptych::metrics::surfaces::{Sighting, Surfaces};

use super::*;

/// Filtered frames change if mirrors are followed; auxiliary images do not.
#[test]
fn auxiliary_images_show_the_mirrors_themselves() {
    let subject = hall_of_mirrors();
    let aovs = [Aov::Albedo, Aov::Normal, Aov::Position, Aov::Depth, Aov::Roughness, Aov::Motion, Aov::SpecularAlbedo];
    let render = |follow_mirrors: bool| {
        let mut settings = settings(&subject, Denoiser::SVGF);
        (settings.follow_mirrors, settings.buffers.aovs) = (follow_mirrors, aovs.to_vec());
        let mut stage = Stage::alone(&subject, &settings);
        let frame = stage.frame(0).linear;
        (frame, aovs.iter().enumerate().map(|(i, _)| stage.aov(i)).collect::<Vec<PerView<_>>>())
    };
    let [(followed, of_followed), (blurred, of_blurred)] = [true, false].map(render);
    assert!(followed.left().pixels != blurred.left().pixels, "no mirror is followed");
    for ((aov, a), b) in aovs.iter().zip(of_followed).zip(of_blurred) {
        assert!(a.left() == b.left() && a.right() == b.right(), "{}", aov.name());
    }
}

const EXTENT: Extent = Extent::new(160, 120);

/// Returns auxiliary images of a room, per eye, as vectors.
fn vectors<const N: usize>(subject: &Subject, filter: Option<Filter>, aovs: [Aov; N]) -> [[RgbImage; N]; 2] {
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    (settings.envelope.most.filter, settings.envelope.most.bounces) = (filter, BOUNCES);
    settings.buffers.aovs = aovs.to_vec();
    let mut stage = Stage::alone(subject, &settings);
    stage.frame(0);
    let images: [PerView<Vec<Vec<f32>>>; N] = std::array::from_fn(|i| stage.aov(i));
    let image = |channels: &[Vec<f32>]| {
        let pixel = |at: usize| [0, 1, 2].map(|c: usize| channels[c][at]);
        Image { extent: EXTENT, pixels: (0..EXTENT.area()).map(pixel).collect() }
    };
    [images.each_ref().map(|eyes| image(eyes.left())), images.each_ref().map(|eyes| image(eyes.right()))]
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    Vec3::from(a).distance(b.into())
}

/// The eye sees the room in the mirror where the opening has its mirrored copy. With and without a denoiser that follows
/// mirrors, the images have the same bytes.
#[test]
fn mirror_aovs_match_copies_behind_an_opening() {
    let shown = [Aov::ShownPosition, Aov::ShownNormal, Aov::VirtualPosition];
    let expected = vectors(&room(Wall::Opening), None, [Aov::Position, Aov::Normal]);
    let of_mirror = vectors(&room(Wall::Mirror), None, shown);
    assert!(of_mirror == vectors(&room(Wall::Mirror), Some(Filter::new(Denoiser::SVGF, 1)), shown));
    let over = |[x, y, z]: [f32; 3]| if z < MIRROR_Z { [x, y, 2.0 * MIRROR_Z - z] } else { [x, y, z] };
    for (found, expected) in of_mirror.iter().zip(&expected) {
        let [positions, normals, images] = found.each_ref().map(|image| &image.pixels);
        let [copies, copied_normals] = expected.each_ref().map(|image| &image.pixels);
        let is_same = |at: &usize| {
            let [x, y, z] = copied_normals[*at];
            let normal = if copies[*at][2] < MIRROR_Z { [x, y, -z] } else { [x, y, z] };
            distance(images[*at], copies[*at]) < 1e-3
                && distance(positions[*at], over(copies[*at])) < 1e-3
                && distance(normals[*at], normal) < 1e-3
        };
        let mirrored = (0..EXTENT.area()).filter(|at| copies[*at][2] < MIRROR_Z).count();
        let differing = EXTENT.area() - (0..EXTENT.area()).filter(is_same).count();
        println!("{mirrored} pixels of the mirror, {differing} pixels differ");
        // Rays of rounded directions may pass an edge on the other side.
        assert!(mirrored > 5000 && differing < EXTENT.area() / 500, "{mirrored}, {differing}");
    }
}

/// The right eye is searched for what the mirror shows as it is searched for the copies behind an opening.
#[test]
fn right_eye_finds_surfaces_shown_in_a_mirror() {
    let rig = room(Wall::Mirror).rig;
    let world_to_ndc = rig.matrices(0.0, Eye::RIGHT, EXTENT).world_to_ndc;
    let find = |surfaces: [Surfaces; 2]| surfaces[0].in_other_eye(&surfaces[1], &world_to_ndc, [0.5; 2]).unwrap();
    let opening = vectors(&room(Wall::Opening), None, [Aov::Position, Aov::Normal]);
    let behind: Vec<_> = opening[0][0].pixels.iter().map(|p| p[2] < MIRROR_Z).collect();
    let expected = find(opening.map(|[position, normal]| Surfaces::new(position, normal).unwrap()));
    let shown = vectors(&room(Wall::Mirror), None, [Aov::ShownPosition, Aov::ShownNormal, Aov::VirtualPosition]);
    let found = find(shown.map(|[position, normal, at]| Surfaces::new(position, normal).unwrap().seen_at(at).unwrap()));
    let own = vectors(&room(Wall::Mirror), None, [Aov::Position, Aov::Normal]);
    let of_mirror = find(own.map(|[position, normal]| Surfaces::new(position, normal).unwrap()));
    let mirrored: Vec<_> = (0..EXTENT.area()).filter(|at| behind[*at]).collect();
    let elsewhere = |found: &[Sighting]| mirrored.iter().filter(|at| found[**at] != expected[**at]).count();
    let [differing, by_mirror] = [&found, &of_mirror].map(|found| elsewhere(found));
    println!("of {} pixels, {differing} are found elsewhere, {by_mirror} if the mirror is searched", mirrored.len());
    assert!(differing < mirrored.len() / 100 && by_mirror > mirrored.len() / 2, "{differing}, {by_mirror}");
}
