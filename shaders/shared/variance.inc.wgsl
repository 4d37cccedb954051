// The alpha of accumulated light is the variance of its luminance, or negative if that is unknown. Light of too few
// frames:
const UNKNOWN: f32 = -1.0;
// No light at all:
const MISSING: f32 = -2.0;
