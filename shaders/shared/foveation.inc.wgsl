// Sampling mask. A frame samples each pixel with probability `sampled_fraction`, the square of the render scale, and
// leaves the others to the filter, whose guides are at full resolution. Foveation adds three layers around the gaze
// (Peres, sections 4.2 and 4.4), which multiply the probability: by 1 in the inner layer and by 1 - p in the outer one,
// where p is `unsampled_fraction`. In the middle layer, the factor falls linearly.
// Departures: a pixel's threshold is not random but its index on the Z-order curve, Owen-scrambled (Burley 2020; Ahmed
// & Wonka 2020), so that every aligned block of 2^k pixels holds as many samples as it should. The threshold does not
// depend on the gaze, so a moving gaze only changes the mask where it changes the probability. Each eye has its own
// gaze.

//!include frame rng

override FOVEATED: bool = false;
// True if pixels may be left to the denoiser, because of the render scale or of foveation.
override SPARSE: bool = false;

const INNER: u32 = 0u;
const MIDDLE: u32 = 1u;
const OUTER: u32 = 2u;

// Distance from the eye's gaze to the pixel's centre, pixels.
fn gaze_distance(pixel: vec2<u32>, view: u32) -> f32 {
    let gaze = select(frame.foveation.gaze.xy, frame.foveation.gaze.zw, view == 1u);
    return length(vec2<f32>(pixel) + 0.5 - gaze);
}

fn layer_of(pixel: vec2<u32>, view: u32) -> u32 {
    let distance = gaze_distance(pixel, view);
    return select(select(OUTER, MIDDLE, distance < frame.foveation.radii.y), INNER, distance < frame.foveation.radii.x);
}

fn sampling_probability(pixel: vec2<u32>, view: u32) -> f32 {
    if !FOVEATED {
        return frame.sampling.sampled_fraction;
    }
    let radii = frame.foveation.radii;
    let outward = clamp((gaze_distance(pixel, view) - radii.x) / (radii.y - radii.x), 0.0, 1.0);
    return frame.sampling.sampled_fraction * (1.0 - frame.foveation.unsampled_fraction * outward);
}

// True if the mask samples this pixel. `mask_turn` is 0 for spatial filters. For temporal filters it advances by the
// golden ratio with every frame, so that over several frames all pixels are sampled.
fn is_sampled(pixel: vec2<u32>, view: u32) -> bool {
    let place = spread_bits(pixel.x) | (spread_bits(pixel.y) << 1u);
    let threshold = reverseBits(laine_karras(place, 0x5f3759dfu)) + frame.sampling.mask_turn;
    return unit_float(threshold) < sampling_probability(pixel, view);
}
