//! Compares error metrics with independent implementations, and checks the output of `compare`.

use crate::common::{Folder, Said};
use diptych::image::display::{tonemap, write_png};
use diptych::image::exr::{Tags, read_rgb, write_rgb, write_tagged_channels};
use diptych::image::tone::ToneCurve;
use diptych::image::{Extent, Image, RgbImage};
use diptych::metrics::heatmap::heatmap;
use diptych::metrics::{MEASURES, Pair, compare};

/// Returns a generator of deterministic numbers in 0 … 1.
fn noise(mut state: u32) -> impl FnMut() -> f64 {
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24)
    }
}

fn scene(width: u32, height: u32) -> RgbImage {
    let radiance = |x: u32, y: u32| {
        let checker = if (x / 8 + y / 8) % 2 == 1 { 1.6 } else { 0.1 };
        [2.0 * f64::from(x) / f64::from(width), f64::from(y) / f64::from(height), checker].map(|c| c as f32)
    };
    Image::from_fn(Extent::new(width, height), radiance)
}

fn noisy(image: &RgbImage, seed: u32) -> RgbImage {
    let mut random = noise(seed);
    let pixels = image.pixels.iter().map(|p| p.map(|c| (f64::from(c) * (0.5 + random())) as f32)).collect();
    Image { extent: image.extent, pixels }
}

/// Makes an image whose pixel (x, y) depends on the pixels around it. Beyond the border, the outermost pixels repeat.
fn resampled(image: &RgbImage, pixel: impl Fn(&dyn Fn(i64, i64) -> [f32; 3]) -> [f32; 3]) -> RgbImage {
    let Extent { width, height } = image.extent;
    let at = |x: i64, y: i64| *image.get(x.clamp(0, width as i64 - 1) as u32, y.clamp(0, height as i64 - 1) as u32);
    Image::from_fn(image.extent, |x, y| pixel(&|dx, dy| at(i64::from(x) + dx, i64::from(y) + dy)))
}

fn blurred(image: &RgbImage) -> RgbImage {
    resampled(image, |around| {
        let mut sum = [0.0f64; 3];
        for (dy, dx) in (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dy, dx))) {
            for (s, c) in sum.iter_mut().zip(around(dx, dy)) {
                *s += f64::from(c);
            }
        }
        sum.map(|s| (s / 25.0) as f32)
    })
}

fn shifted(image: &RgbImage) -> RgbImage {
    resampled(image, |around| around(-2, 0))
}

fn flat(width: u32, height: u32, colour: [f32; 3]) -> RgbImage {
    RgbImage::filled(Extent::new(width, height), colour)
}

/// Compares with values of `flip_evaluator` 1.7 (by the paper's authors; LDR, its default 67.02 pixels per degree, f32)
/// for the same images, tonemapped in f64 by NumPy. In flat images its f32 rounding is amplified by the square root of
/// the feature difference: hence the tolerance of 1e-4 there.
#[test]
fn flip_equals_its_authors_implementation() {
    let base = scene(48, 40);
    let noisy_scene = |width, height| (scene(width, height), noisy(&scene(width, height), 9));
    for (name, (reference, image), independent) in [
        ("noise", (base.clone(), noisy(&base, 3)), 0.119_637_9),
        ("blur", (base.clone(), blurred(&base)), 0.192_730_35),
        ("shift", (base.clone(), shifted(&base)), 0.203_533_72),
        ("flat", (flat(17, 13, [0.5; 3]), flat(17, 13, [0.6, 0.5, 0.2])), 0.392_691_88),
        ("black and white", (flat(12, 12, [0.0; 3]), flat(12, 12, [1e6; 3])), 0.967_386_54),
        ("green and blue", (flat(12, 12, [0.0, 1e6, 0.0]), flat(12, 12, [0.0, 0.0, 1e6])), 1.0),
        ("1x1", noisy_scene(1, 1), 0.168_721_35),
        ("3x5", noisy_scene(3, 5), 0.194_424_69),
        ("1x30", noisy_scene(1, 30), 0.196_970_91),
        ("11x64", noisy_scene(11, 64), 0.126_090_47),
        ("97x23", noisy_scene(97, 23), 0.116_105_51),
        ("shift and noise", (scene(320, 200), noisy(&shifted(&scene(320, 200)), 5)), 0.210_273_36),
    ] {
        let flip = compare(&reference, &image).unwrap().flip;
        let bound = if name == "flat" { 1e-4 } else { 1e-5 };
        assert!((flip - independent).abs() < bound, "{name}: {flip}, independently {independent}");
        assert_eq!(compare(&image, &image).unwrap().flip, 0.0, "{name}");
    }
}

/// Compares with values of NumPy 1.26.4 and scikit-image 0.26.0 (SSIM) in f64.
#[test]
fn metrics_equal_an_independent_implementation() {
    let base = scene(48, 40);
    for (name, image, independent) in [
        ("noise", noisy(&base, 3), [0.27950811, 0.067717953, 26.199494, 0.57405287, 0.99284886, 0.019218881]),
        ("blur", blurred(&base), [0.24241248, 1.4808656, 19.569979, 0.81639745, 1.0, 0.0023173925]),
        ("shift", shifted(&base), [0.398096, 3.793718, 17.693615, 0.79455309, 0.95975719, 0.06041976]),
    ] {
        let e = compare(&base, &image).unwrap();
        let found = [e.rmse, e.relmse, e.psnr, e.ssim.unwrap(), e.mean_ratio.unwrap(), e.block16.unwrap()];
        for (found, independent) in found.iter().zip(independent) {
            assert!((found / independent - 1.0).abs() < 1e-7, "{name}: {found}, independently {independent}");
        }
    }
}

/// Display values depend on radiance times two to the exposure. Pictures whose radiance and exposure differ by the same
/// power of two have the same errors of display values, to the last bit.
#[test]
fn compare_uses_the_exposure_of_the_images() {
    let base = scene(48, 40);
    let image = noisy(&base, 3);
    let brighter = |image: &RgbImage| RgbImage {
        pixels: image.pixels.iter().map(|p| p.map(|c| c * 1024.0)).collect(),
        extent: image.extent,
    };
    let errors = |reference: &RgbImage, image: &RgbImage, exposure_ev: f32| {
        let pair = Pair::new(reference, image, exposure_ev).unwrap();
        let found = pair.errors();
        (pair.flip().to_vec(), found.flip, found.psnr, found.ssim)
    };
    let (bright_base, bright_image) = (brighter(&base), brighter(&image));
    assert_eq!(errors(&base, &image, 0.0), errors(&bright_base, &bright_image, -10.0));
    assert_ne!(errors(&base, &image, 0.0), errors(&bright_base, &bright_image, 0.0));
    let maps = [(&base, &image, 0.0), (&bright_base, &bright_image, -10.0), (&base, &image, -10.0)]
        .map(|(reference, image, ev)| heatmap(&Pair::new(reference, image, ev).unwrap()));
    assert!(maps[0] == maps[1] && maps[0] != maps[2]);
}

/// Infinities and NaN count as 0, here black: the errors equal those of black pixels.
#[test]
fn compare_counts_and_skips_non_finite_pixels() {
    let reference = scene(33, 21);
    let [mut odd, mut black] = [noisy(&reference, 4), noisy(&reference, 4)];
    for (i, value) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].into_iter().enumerate() {
        odd.pixels[100 * i] = [value; 3];
        black.pixels[100 * i] = [0.0; 3];
    }
    let (odd, black) = (compare(&reference, &odd).unwrap(), compare(&reference, &black).unwrap());
    assert_eq!((odd.nonfinite_px, black.nonfinite_px), (3, 0));
    assert_eq!((odd.flip, odd.rmse, odd.ssim, odd.psnr), (black.flip, black.rmse, black.ssim, black.psnr));

    // On a screen, the largest floats look like other very large values.
    let filled = |pixel| RgbImage::filled(reference.extent, pixel);
    let errors = compare(&filled([f32::MAX, -f32::MAX, f32::MIN_POSITIVE]), &reference).unwrap();
    let expected = f64::from(f32::MAX) * (2.0f64 / 3.0).sqrt();
    assert!((errors.rmse / expected - 1.0).abs() < 1e-9, "{errors:?} instead of {expected}");
    let saturated = compare(&filled([1e20, -1.0, 0.0]), &reference).unwrap();
    assert!((errors.flip - saturated.flip).abs() < 1e-9, "{errors:?} instead of {saturated:?}");
}

/// Returns a folder with a reference and an image of the same size.
fn files() -> Folder {
    let files = Folder::new();
    write_rgb(&files.path("reference.exr"), &scene(48, 40)).unwrap();
    write_rgb(&files.path("image.exr"), &noisy(&scene(48, 40), 3)).unwrap();
    files
}

const COMPARE: &str = "compare ./reference.exr ./image.exr";

fn json(files: &Folder, options: &str) -> serde_json::Value {
    files.run(&format!("{COMPARE} --json {options}")).json()
}

#[test]
fn compare_prints_all_errors_as_text_and_json() {
    let files = files();
    let json = json(&files, "");
    let text = files.run(COMPARE).out;
    let help = files.run("compare --help").out;
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    for name in ["rmse", "relmse", "psnr", "ssim", "flip", "mean_ratio", "block16"] {
        let value = json[name].as_f64().unwrap();
        let said = text.lines().any(|l| l.split_whitespace().take(2).eq([name, format!("{value:.6}").as_str()]));
        assert!(said, "{name} {value}: {text}");
        // Each line explains its metric, and so does the help.
        let meaning = MEASURES.iter().find(|(measure, _)| *measure == name).unwrap().1;
        assert!(text.contains(meaning) && help.contains(meaning), "{name}: {meaning}");
    }
    assert_eq!(json["nonfinite_px"], 0);
    assert!(json.get("rings").is_none() && json.get("seams").is_none());
    assert_eq!(json["image_source"]["channels"], serde_json::json!(["R", "G", "B"]));
}

/// At 0 EV both images are white; at the exposure of the shot, one is twice as bright.
#[test]
fn compare_finds_errors_at_the_exposure_of_the_shot() {
    let files = files();
    write_rgb(&files.path("reference.exr"), &flat(48, 40, [1e6; 3])).unwrap();
    write_rgb(&files.path("image.exr"), &flat(48, 40, [5e5; 3])).unwrap();
    let at = |ev: &str| {
        let found = json(&files, &format!("--exposure {ev} --maps ./maps --by rings=1"));
        let red = image::open(files.path("maps/flip.png")).unwrap().into_rgb8().get_pixel(20, 20).0[0];
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        (number(&found["exposure_ev"]), number(&found["flip"]), number(&found["rings"]["rings"][0]["flip"]), red)
    };
    let (white, shown) = (at("0"), at("-19.5"));
    assert_eq!((white.0, shown.0), (0.0, -19.5));
    assert!(white.1 < 1e-3 && white.2 < 1e-3 && white.3 == 0, "{white:?}");
    assert!(shown.1 > 0.1 && shown.2 > 0.1 && shown.3 > 20, "{shown:?}");
    let text = files.run(&format!("{COMPARE} --exposure -0.9")).out;
    assert!(text.lines().any(|l| l.split_whitespace().eq(["exposure_ev", "-0.9"])), "{text}");
}

#[test]
fn compare_splits_errors_by_ring_and_by_seam() {
    let files = files();
    let json = json(&files, "--by rings=20,seams=10,25 --gaze 0.25,0.5 --yfov 90");
    let rings = json["rings"]["rings"].as_array().unwrap();
    assert_eq!(rings.len(), 20);
    assert_eq!(rings.iter().map(|r| r["pixels"].as_u64().unwrap()).sum::<u64>(), 48 * 40);
    let squares = rings.iter().filter_map(|r| Some(r["rmse"].as_f64()?.powi(2) * r["pixels"].as_f64()?));
    let mse = squares.sum::<f64>() / (48.0 * 40.0);
    assert!((mse.sqrt() - json["rmse"].as_f64().unwrap()).abs() < 1e-12);
    let flips = rings.iter().filter_map(|r| Some(r["flip"].as_f64()? * r["pixels"].as_f64()?));
    assert!((flips.sum::<f64>() / (48.0 * 40.0) - json["flip"].as_f64().unwrap()).abs() < 1e-12);
    let seams = &json["seams"];
    let ratio = seams["near_rmse"].as_f64().unwrap() / seams["elsewhere_rmse"].as_f64().unwrap();
    assert!((seams["ratio"].as_f64().unwrap() - ratio).abs() < 1e-12);

    let Said { out: text, errors: warned, .. } = files.run(&format!("{COMPARE} --by rings=3,seams=10"));
    assert!(text.contains("seam_ratio") && text.contains("from_deg"), "{text}");
    // These files lack an exposure.
    assert!(warned.contains("--by rings assumes 70 degrees") && text.contains("70 degrees, assumed"), "{warned}{text}");
    assert_eq!((&json["rings"]["yfov_source"], &json["exposure_source"]), (&"option".into(), &"default".into()));
}

#[test]
fn compare_writes_maps_into_a_folder() {
    let files = files();
    assert_eq!(json(&files, "--maps ./new/maps")["maps"], serde_json::json!(["error.png", "flip.png"]));
    assert_eq!(files.names("new/maps"), ["error.png", "flip.png"]);
    for name in files.names("new/maps") {
        let map = image::open(files.path("new/maps").join(name)).unwrap().into_rgb8();
        assert_eq!(map.dimensions(), (48, 40));
    }
}

#[test]
fn compare_of_several_images_has_a_row_for_each() {
    let files = files();
    let lines = files.run(&format!("{COMPARE} ./reference.exr --json --maps ./maps")).events();
    assert_eq!(lines[0]["flip"], json(&files, "")["flip"]);
    let reference = files.word("./reference.exr");
    assert_eq!((lines.len(), &lines[1]["image"], &lines[1]["flip"]), (2, &reference.clone().into(), &0.0.into()));
    assert!(["maps/1/error.png", "maps/2/flip.png"].iter().all(|map| files.path(map).is_file()));
    let text = files.run(&format!("{COMPARE} ./reference.exr --csv ./all.csv")).out;
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!((lines.len(), lines[0]), (5, "means over views and frames:"), "{text}");
    assert!(lines[1].starts_with("image") && lines[3].contains("image.exr") && lines[4].contains("reference.exr"));
    let csv = files.text("all.csv");
    let mut reader = csv::Reader::from_reader(csv.as_bytes());
    let headers = reader.headers().unwrap().clone();
    assert_eq!(headers.iter().skip(1).collect::<Vec<_>>(), MEASURES.map(|(name, _)| name));
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let value = |row: usize, name: &str| &rows[row][headers.iter().position(|header| header == name).unwrap()];
    assert_eq!((rows.len(), value(1, "image"), value(1, "flip")), (2, &*reference, "0.000000000"));
    assert_eq!(value(1, "psnr"), "inf");
    let flip: f64 = value(0, "flip").parse().unwrap();
    assert!((flip - json(&files, "")["flip"].as_f64().unwrap()).abs() < 1e-9);
    // Parts of each image come before the table.
    let text = files.run(&format!("{COMPARE} ./reference.exr --by seams=10")).out;
    assert!(text.contains("image.exr:\n") && text.contains("seam_ratio") && text.contains("means over"), "{text}");
    files.refuses(2, "", &format!("{COMPARE} --csv ./image.exr => image.exr | give another"));
}

/// Pictures of the same images have the same FLIP, up to the rounding of their levels.
#[test]
fn compare_reads_levels_of_png_files() {
    let files = files();
    for name in ["reference", "image"] {
        let image = read_rgb(&files.path(&format!("{name}.exr"))).unwrap();
        let picture = tonemap(&image, 0.0, ToneCurve::Reinhard);
        write_png(&files.path(&format!("{name}.png")), &picture).unwrap();
    }
    let found = files.run("compare ./reference.png ./image.png --json --by seams=10 --maps ./maps").json();
    let exact = json(&files, "--by seams=10");
    for (name, most) in [("flip", 2e-3), ("ssim", 2e-3), ("psnr", 0.05)] {
        let [found, exact] = [&found, &exact].map(|json| json[name].as_f64().unwrap());
        assert!((found - exact).abs() < most, "{name}: {found}, of the images {exact}");
    }
    assert!(found["seams"]["ratio"].is_number() && image::open(files.path("maps/error.png")).is_ok());
    assert!(files.run("compare ./reference.png ./image.png").out.contains("flip "));
}

#[test]
fn compare_names_the_channels_it_selects() {
    let files = files();
    let grey = vec![0.5; 48 * 40];
    let channels = ["left.B", "left.G", "left.R", "Z"].map(|name| (name, &grey[..]));
    write_tagged_channels(&files.path("layer.exr"), Extent::new(48, 40), &channels, &Tags::default()).unwrap();
    let text = files.run("compare ./reference.exr ./layer.exr").out;
    assert!(text.contains("image: channels left.R, left.G, left.B") && !text.contains("reference:"), "{text}");
}

#[test]
fn rejects_images_that_cannot_be_compared() {
    let files = files();
    write_rgb(&files.path("small.exr"), &scene(48, 39)).unwrap();
    files.write("text.exr", "not an image");
    let whole = files.bytes("image.exr");
    files.write("half.exr", &whole[..whole.len() / 2]);
    std::fs::create_dir(files.path("empty")).unwrap();
    files.write("left/left.exr", &whole);
    for name in ["reference.png", "image.png", "flip.png", "maps/flip.png"] {
        files.write(name, ""); // Makes its folder.
        write_png(&files.path(name), &tonemap(&scene(48, 40), 0.0, ToneCurve::Reinhard)).unwrap();
    }
    files.write("text.png", "no picture");
    let table = "
    --by {rings=0 seams seams=0 kind,seams=20,40 first} => --by
    --gaze {0.5 0.5,1.5 nan,0.5} => --gaze
    --gaze 0.5,0.5 => --by rings
    --exposure nan => --exposure
    --yfov {180 nan} => --yfov
    compare ./reference.exr ./small.exr => reference.exr | small.exr | 48x40 | 48x39
    compare ./reference.exr ./{none.exr text.exr half.exr} => {}
    compare ./{none.exr text.exr half.exr} ./image.exr => {}
    compare ./reference.exr ./ => reference.exr | name two images or two folders
    compare ./ ./none => none | is not there
    compare ./empty ./empty => 0 frame(s) | left.exr and right.exr
    compare ./left ./left => right.exr
    compare ./reference.png ./image.exr => image.exr | two pictures
    compare ./reference.png ./image.png --exposure 1 => --exposure | OpenEXR
    compare ./reference.png ./image.png --by kind => --by kind | OpenEXR
    compare ./reference.png ./text.png => text.png
    compare ./reference.png ./maps/flip.png --maps ./maps => flip.png | another folder
    ";
    files.refuses(2, COMPARE, table);
    files.refuses(1, COMPARE, "--maps ./image.exr => choose another --maps");
}
