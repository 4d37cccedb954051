//! Seams between stripes that do not exchange halos: unfiltered, or smoothed.

use crate::common::{Stage, Subject, sampled, with};
use diptych::exec::PerView;
use diptych::graph::Seam;
use diptych::image::RgbImage;
use diptych::quality::{Denoiser, Filter};

const WIDTH: u32 = 32;
const HEIGHT: u32 = 480;
/// Taps reach 2 × (16 + 8 + 4 + 2 + 1) rows in five iterations.
const HALO_ROWS: u32 = 62;
const EDGES: [u32; 2] = [160, 320];

struct Images {
    one: PerView<RgbImage>,
    three: PerView<RgbImage>,
}

fn render(subject: &Subject, seam: Seam) -> Images {
    let settings = with(subject.denoised(WIDTH, HEIGHT), |config| config.execution.seam = seam);
    let one = Stage::even(subject, &settings, 1).frame(0).linear;
    let frame = Stage::even(subject, &settings, 3).frame(0);
    assert_eq!(frame.report.stripe_edges(), EDGES);
    Images { one, three: frame.linear }
}

/// Returns the rows in which the images differ by any bit.
fn rows_that_differ(a: &RgbImage, b: &RgbImage) -> Vec<u32> {
    let bits = |image: &RgbImage, row: u32| -> Vec<[u32; 3]> {
        image.rows(row..row + 1).iter().map(|p| p.map(f32::to_bits)).collect()
    };
    a.extent.rows().filter(|&row| bits(a, row) != bits(b, row)).collect()
}

/// Returns the mean step of display luminance from the row above each edge to the one below.
fn jump(image: &RgbImage) -> f64 {
    let shown = |x: u32, y: u32| {
        let [r, g, b] = image.get(x, y).map(f64::from);
        let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        luminance / (1.0 + luminance)
    };
    let steps = EDGES.iter().flat_map(|&e| (0..WIDTH).map(move |x| (shown(x, e - 1) - shown(x, e)).abs()));
    steps.sum::<f64>() / f64::from(WIDTH * 2)
}

#[test]
fn stripes_filtered_apart_differ_only_within_the_halo() {
    for shot in ["builtin:checker", "builtin:atrium"] {
        let images = render(&Subject::load(shot), Seam::None);
        for (one, three) in images.one.outer().into_iter().zip(images.three.outer()) {
            let rows = rows_that_differ(one, three);
            for edge in EDGES {
                assert!(rows.contains(&(edge - 1)) && rows.contains(&edge), "{shot}: no seam at {edge}: {rows:?}");
            }
            let is_near = |row: &u32| EDGES.iter().any(|&e| (e - HALO_ROWS..e + HALO_ROWS).contains(row));
            assert!(rows.iter().all(is_near), "{shot}: {rows:?}");
        }
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn fewer_iterations_make_a_narrower_halo() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.denoised(WIDTH, 120);
    settings.execution.seam = Seam::None;
    settings.envelope.most.filter = Some(Filter::new(Denoiser::ATROUS, 2));
    let one = Stage::even(&subject, &settings, 1).frame(0).linear;
    let two = Stage::even(&subject, &settings, 2).frame(0).linear;
    for (one, two) in [(one.left(), two.left()), (one.right(), two.right())] {
        let rows = rows_that_differ(one, two);
        assert!(!rows.is_empty() && rows.iter().all(|r| (54..66).contains(r)), "{rows:?}");
    }
}

#[test]
fn seam_filter_reduces_the_jump() {
    for shot in sampled(["builtin:checker", "builtin:atrium"], 2) {
        let subject = Subject::load(shot);
        let [apart, smoothed] = [Seam::None, Seam::Filter].map(|seam| render(&subject, seam));
        for eye in [0, 1] {
            let [before, after] = [&apart, &smoothed].map(|images| jump(images.three.outer()[eye]));
            println!("{shot}, eye {eye}: {before:.4} to {after:.4}");
            assert!(after < 0.9 * before, "{shot}, eye {eye}: the jump went from {before} to {after}");
        }
        // One device has no seams, so nothing is smoothed.
        assert!(smoothed.one.left() == apart.one.left() && smoothed.one.right() == apart.one.right());
    }
}

#[test]
fn seam_filter_changes_only_rows_at_the_seam() {
    let subject = Subject::load("builtin:checker");
    let [apart, smoothed] = [Seam::None, Seam::Filter].map(|seam| render(&subject, seam).three);
    for (a, b) in [(apart.left(), smoothed.left()), (apart.right(), smoothed.right())] {
        let rows = rows_that_differ(a, b);
        let is_near = |row: &u32| EDGES.iter().any(|&e| (e - 4..e + 4).contains(row));
        assert!(!rows.is_empty() && rows.iter().all(is_near), "{rows:?}");
    }
}
