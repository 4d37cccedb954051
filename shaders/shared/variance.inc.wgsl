// The alpha of accumulated light is the variance of its luminance, or a negative flag if the variance is unknown. This
// flag marks light from too few frames to estimate a variance:
const UNKNOWN: f32 = -1.0;
// Flag of a pixel without any light:
const MISSING: f32 = -2.0;
// Flag of a pixel whose light has been filtered already. Its variance counts as 0.
const FINISHED: f32 = -4.0;
// Number of pixels that are not FINISHED for each workgroup of a filter that runs on their list.
const UNFINISHED_GROUP: u32 = 64u;
