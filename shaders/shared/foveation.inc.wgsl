// Which pixels are sampled. A frame may leave a share of all of them to the filter (`sampled_share`, the render scale
// squared), whose guides are at full size. With foveation there are three layers around the gaze (Peres, sections 4.2 and
// 4.4): the inner one is sampled in full, outside the outer radius each pixel with probability 1 - p, in between it falls
// linearly. Departures: a pixel's threshold is not a random toss but its place on the Z curve, Owen-scrambled (Burley
// 2020; Ahmed & Wonka 2020), so that every aligned block of 2^k pixels holds as many samples as it should; it depends on
// the pixel alone, so that a gaze that moves leaves the mask as it is where the probability is. And each eye has a gaze of
// its own.

override FOVEATED: bool = false;
// Whether pixels may be left to the filter; foveation does.
override SPARSE: bool = false;

const INNER: u32 = 0u;
const MIDDLE: u32 = 1u;
const OUTER: u32 = 2u;

// From the eye's gaze to the pixel's centre, pixels.
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
        return frame.sampling.sampled_share;
    }
    let radii = frame.foveation.radii;
    let outward = clamp((gaze_distance(pixel, view) - radii.x) / (radii.y - radii.x), 0.0, 1.0);
    return frame.sampling.sampled_share * (1.0 - frame.foveation.unsampled_share * outward);
}

// Whether the mask asks for this pixel. `mask_turn` is 0 for spatial filters; one that adds the golden ratio to it every
// frame gives all pixels their turns.
fn is_sampled(pixel: vec2<u32>, view: u32) -> bool {
    let place = spread_bits(pixel.x) | (spread_bits(pixel.y) << 1u);
    let threshold = reverseBits(laine_karras(place, 0x5f3759dfu)) + frame.sampling.mask_turn;
    return unit_float(threshold) < sampling_probability(pixel, view);
}
