// Samples per pixel. A frame may take a number between n and n + 1 on average: a fraction of its tiles then takes
// n + 1 samples per pixel, the others n. Samples vary by tiles, not by pixels, so that the lanes of a device that run
// together do the same work.

//!include frame rng

override VARIES_SAMPLES: bool = false;

const SAMPLES_TILE = vec2<u32>(8u, 4u);

// Samples of a pixel in this frame. The threshold of a tile is its index on the Z-order curve, Owen-scrambled, so that
// every aligned block of 2^k tiles has as many extra samples as it should. It advances from frame to frame like that of
// the sampling mask.
fn samples_of(pixel: vec2<u32>) -> u32 {
    let samples = frame.sampling.samples;
    if !VARIES_SAMPLES {
        return samples.least;
    }
    let tile = pixel / SAMPLES_TILE;
    let place = spread_bits(tile.x) | (spread_bits(tile.y) << 1u);
    let threshold = reverseBits(laine_karras(place, 0x7f4a7c15u)) + frame.sampling.mask_turn;
    return samples.least + select(0u, 1u, unit_float(threshold) < samples.extra);
}
