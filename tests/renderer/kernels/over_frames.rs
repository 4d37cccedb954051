//! Compares accumulation with static eyes with statistics over all frames.

use glam::{DVec2, DVec3};

use super::camera::Constants;
use super::harness::{Buffer, Kernel, Stripe};
use super::inputs::{HEIGHT, Random, WIDTH, Wall};
use super::pack::{Format, HALF, Light, floats, is_near, luminance, rgb};

const FRAMES: u32 = 8;

fn still() -> (Constants, Stripe) {
    let constants = Constants { history_rows: Some(2), ..Constants::new(WIDTH, HEIGHT) };
    (constants, Stripe { rows: 0..HEIGHT, valid: 0..HEIGHT })
}

/// Returns the light of every frame, alternately bright and dark, so that the mean over the last frames stays near that
/// over all.
fn lights(random: &mut Random, constants: &Constants) -> Vec<Vec<Light>> {
    let mut light = |frame: u32| {
        let around = [0.5, 1.0][frame as usize % 2];
        let mut color = || DVec3::from_array(std::array::from_fn(|_| around * random.within(0.8..1.2)));
        Light { matte: color(), gloss: 0.3 * color(), variance: DVec2::ZERO }
    };
    (0..FRAMES).map(|frame| (0..constants.area()).map(|_| light(frame)).collect()).collect()
}

/// Asserts that the accumulated mean is that of all samples, and its variance the unbiased one of that mean, which is
/// increased for few frames.
fn accumulate(gloss: bool, seed: u64) {
    let mut random = Random::new(seed);
    let (constants, stripe) = still();
    let format = Format { gloss };
    let area = constants.area();
    let guide = Wall { stray: 0.0, ..Wall::new(0.0, 0.0, 0.0) }.guides(&mut random, &constants, 0);
    let hit = vec![[1, 2, 3, 7]; area];
    let frames = lights(&mut random, &constants);
    let (mut accumulated, mut moments) = (vec![[0; 4]; area], vec![[0u32; 4]; area]);
    for frame in &frames {
        let radiance: Vec<_> = frame.iter().map(|light| format.pack_sampled(light)).collect();
        let buffers = [
            ("hit_image", Buffer::image(&hit)),
            ("guide_image", Buffer::image(&guide)),
            ("radiance", Buffer::image(&radiance)),
            ("last_guide", Buffer::image(&guide)),
            ("last_moments", Buffer::image(&moments)),
            ("last_history", Buffer::image(&accumulated)),
            ("left_guide", Buffer::image(&guide)),
            ("left_moments", Buffer::image(&moments)),
            ("left_history", Buffer::image(&accumulated)),
            ("accumulated", Buffer::image(&accumulated)),
            ("moments", Buffer::image(&moments)),
            ("previous", Buffer::whole(&constants.as_previous())),
            ("tally_image", Buffer::image(&vec![0u32; area])),
            ("light_change", Buffer::whole(&[0.0f32])),
        ];
        let kernel = Kernel::new("accumulate", &[("HAS_GLOSS", gloss), ("MARKS_ABSENT", true), ("SOBOL", true)]);
        let outputs = kernel.run(&constants, stripe.pass(0, [0; 3]), WIDTH, &buffers);
        (accumulated, moments) = (outputs.get("accumulated"), outputs.get("moments"));
    }
    let n = f64::from(FRAMES);
    for at in 0..area {
        let got = format.unpack(accumulated[at]);
        assert_eq!(moments[at][3], 7 | FRAMES << 24, "pixel {at}: frames");
        for (channel, of) in
            [|l: &Light| l.matte, |l: &Light| l.gloss].into_iter().enumerate().take(1 + usize::from(gloss))
        {
            let mean = frames.iter().map(|frame| of(&frame[at])).sum::<DVec3>() / n;
            let deviations = frames.iter().map(|frame| luminance(of(&frame[at])) - luminance(mean));
            let variance = deviations.map(|d| d * d).sum::<f64>() / (n - 1.0) / n * (1.0 + 24.0 / n);
            // Each frame adds a rounding, and neighbours have weights of about 1e-5.
            let relative = 1e-4 + if gloss { 4.0 * HALF } else { 0.0 };
            let color = [got.matte, got.gloss][channel];
            assert!((0..3).all(|c| is_near(color[c], mean[c], relative, 0.0)), "pixel {at}: {color} instead of {mean}");
            let told = got.variance[channel];
            assert!(is_near(told, variance, 4.0 * relative, 0.0), "pixel {at}: variance {told} instead of {variance}");
        }
    }
}

#[test]
fn accumulated_light_is_the_mean_of_all_frames() {
    accumulate(false, 131);
    accumulate(true, 132);
}

#[test]
fn taa_averages_frames_of_still_eyes() {
    let mut random = Random::new(133);
    let (constants, stripe) = still();
    let area = constants.area();
    let frames = lights(&mut random, &constants);
    let mut resolved = vec![[0.0f32; 4]; area];
    for (number, frame) in frames.iter().enumerate() {
        let constants = Constants { history_rows: (number > 0).then_some(0), ..constants.clone() };
        let composed: Vec<_> = frame.iter().map(|light| floats(light.matte, 3.0)).collect();
        let buffers = [
            ("composed", Buffer::image(&composed)),
            ("last_resolved", Buffer::image(&resolved)),
            ("resolved", Buffer::image(&resolved)),
            ("linear", Buffer::image(&resolved)),
            ("display", Buffer::image(&vec![0u32; area])),
            ("previous", Buffer::whole(&constants.as_previous())),
            ("tally_image", Buffer::image(&vec![0u32; area])),
            ("light_change", Buffer::whole(&[0.0f32])),
            ("last_surface", Buffer::whole(&[[0u32; 4]])),
            ("last_guide", Buffer::whole(&[[0u32; 4]])),
        ];
        let outputs = Kernel::new("taa", &[]).run(&constants, stripe.pass(1, [0; 3]), WIDTH, &buffers);
        resolved = outputs.get("resolved");
    }
    for (at, texel) in resolved.iter().enumerate() {
        let mean = frames.iter().map(|frame| frame[at].matte).sum::<DVec3>() / f64::from(FRAMES);
        assert!((0..3).all(|c| is_near(rgb(*texel)[c], mean[c], 1e-6, 0.0)), "pixel {at}: {texel:?} instead of {mean}");
        assert_eq!(texel[3], FRAMES as f32, "pixel {at}");
    }
}
