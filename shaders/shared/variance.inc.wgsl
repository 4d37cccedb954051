// Accumulated light carries the variance of its luminance as alpha. Below 0 there is none yet:
// light of too few frames,
const UNKNOWN: f32 = -1.0;
// or no light at all.
const MISSING: f32 = -2.0;
