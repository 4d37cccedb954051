//! Frames that take long: their progress, their end with the samples that they have, and waits that end early.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use diptych::exec::{BuildError, ExecError, FrameReport, PerView};
use diptych::image::RgbImage;
use diptych::quality::Quality;
use diptych::{LoadedScene, Renderer};

/// Returns a renderer of small frames on `devices` devices that `flag` stops.
fn renderer(scene: &LoadedScene, spp: u32, devices: usize, flag: &Arc<AtomicBool>) -> Result<Renderer, BuildError> {
    let quality = Quality { spp: spp.into(), ..Quality::default() };
    Renderer::builder(scene).size(48, 32).quality(quality).devices(devices).stop(Arc::clone(flag)).build()
}

fn mean(images: &PerView<RgbImage>) -> f64 {
    let pixels = images.left().pixels.iter().chain(&images.right().pixels);
    let all: Vec<f64> = pixels.flatten().map(|c| f64::from(*c)).collect();
    assert!(all.iter().all(|c| c.is_finite()));
    all.iter().sum::<f64>() / all.len() as f64
}

/// Renders a watched frame, and sets the flag once the progress exceeds `stop_at`.
fn watched(
    renderer: &mut Renderer,
    scene: &LoadedScene,
    flag: &Arc<AtomicBool>,
    (ends_early, stop_at): (bool, f64),
) -> Result<FrameReport, ExecError> {
    let params = renderer.frame(&scene.shot.rig, 0.0, 0);
    let mut last = 0.0;
    renderer.render_watched(&params, ends_early.then_some(flag), |fraction| {
        assert!((last..=1.0).contains(&fraction), "{fraction} after {last}");
        last = fraction;
        flag.fetch_or(fraction > stop_at, Ordering::Relaxed);
    })
}

#[test]
fn watched_frame_has_the_bytes_of_others() {
    let scene = LoadedScene::load("builtin:cornell").unwrap();
    let flag = Arc::default();
    let image = |devices: usize, is_watched: bool| {
        let mut renderer = renderer(&scene, 21, devices, &flag).unwrap();
        let report = match is_watched {
            true => watched(&mut renderer, &scene, &flag, (true, 2.0)).unwrap(),
            false => renderer.render(&renderer.frame(&scene.shot.rig, 0.0, 0)).unwrap(),
        };
        assert_eq!(report.spp_done, None);
        renderer.read_linear().unwrap()
    };
    let plain = image(1, false);
    for devices in [1, 3] {
        assert!(image(devices, true) == plain, "{devices} device(s)");
    }
}

/// Its mean differs from that of a complete frame by noise, and by a few clamped paths.
#[test]
fn frame_ends_with_the_samples_that_it_has() {
    let scene = LoadedScene::load("builtin:cornell").unwrap();
    let whole = {
        let flag = Arc::default();
        let mut renderer = renderer(&scene, 64, 1, &flag).unwrap();
        watched(&mut renderer, &scene, &flag, (true, 2.0)).unwrap();
        mean(&renderer.read_linear().unwrap())
    };
    for devices in [1, 2] {
        let flag = Arc::default();
        let mut renderer = renderer(&scene, 1 << 16, devices, &flag).unwrap();
        let report = watched(&mut renderer, &scene, &flag, (true, 1e-4)).unwrap();
        let spp = report.spp_done.unwrap();
        assert!((4..1 << 15).contains(&spp), "{spp} samples");
        let ratio = mean(&renderer.read_linear().unwrap()) / whole;
        // At least four samples of each pixel scatter; lost or doubled samples would change the mean by a quarter.
        assert!((0.96..1.04).contains(&ratio), "{devices} device(s), {spp} samples: {ratio}");
    }
}

#[test]
fn flag_ends_waits_and_the_renderer() {
    let scene = LoadedScene::load("builtin:cornell").unwrap();
    let flag = Arc::default();
    let mut renderer = renderer(&scene, 1 << 16, 1, &flag).unwrap();
    let stopped = watched(&mut renderer, &scene, &flag, (false, 1e-5));
    assert!(matches!(stopped, Err(ExecError::Stopped)), "{stopped:?}");
    assert!(matches!(renderer.read_linear(), Err(ExecError::Stopped)));
    let frame = renderer.frame(&scene.shot.rig, 0.0, 1);
    assert!(matches!(renderer.render(&frame), Err(ExecError::Stopped)));
    let built = self::renderer(&scene, 1, 1, &flag).map(drop);
    assert!(matches!(built, Err(BuildError::Exec(ExecError::Stopped))), "{built:?}");
}
