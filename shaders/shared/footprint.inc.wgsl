// Samples over a pixel's footprint, and the surface at its centre from the G-buffer. The pass binds the images.

//!include frame rng trace path pack samples bindings

override JITTER: bool = true;

// Offset of a sample in its pixel. All stages that trace primary rays of an eye get the same offset from the same key.
fn sample_offset(rng: ptr<function, Rng>) -> vec2<f32> {
    if JITTER {
        return random2(rng);
    }
    return frame.camera.centre;
}

// Returns the first sample of `pixel` that this launch takes, and the one after the last; no samples if both are equal.
fn launched_samples(pixel: vec2<u32>) -> vec2<u32> {
    let begin = pass_.args.first_sample;
    if !VARIES_SAMPLES {
        return vec2<u32>(begin, pass_.args.end_sample);
    }
    let count = samples_of(pixel);
    // Pixels of one sample, at the centre, and of several have launches of their own.
    let is_of_launch = frame.sampling.samples.is_jittered != 0u || JITTER == (count > 1u);
    return vec2<u32>(begin, select(begin, max(begin, min(pass_.args.end_sample, count)), is_of_launch));
}

// First hit through the pixel's centre, from the G-buffer.
fn stored_hit(pixel: u32) -> Hit {
    let h = hit_image[pixel];
    return Hit(0.0, h.x, bitcast<vec2<f32>>(h.yz));
}

// Material of a first surface that is seen over `links` mirrors and glass surfaces, as the `hit` image holds it.
fn seen_material(f: FirstHit, links: u32) -> u32 {
    return f.surface.material | select(0u, FLAG_MIRRORED, links > 0u);
}

// Whether a sample of a pixel hit another surface than the ray through the pixel's centre. The pixel's radiance and
// albedo then mix several surfaces, so reprojection rejects the pixel.
fn is_elsewhere(at: u32, f: FirstHit, links: u32) -> bool {
    let centre = hit_image[at];
    if f.hit.prim == NO_PRIM || (f.hit.prim & SPHERE) != 0u {
        return f.hit.prim != centre.x;
    }
    let guide = guide_image[at];
    if guide.w == NO_NORMAL || (centre.w & MATERIAL_MASK) != seen_material(f, links) {
        return true;
    }
    let n = unpack_normal(guide.w);
    let apart = abs(dot(n, f.surface.position - bitcast<vec3<f32>>(guide.xyz)));
    return dot(n, f.surface.normal) < 0.95 || apart > 0.005 * f.hit.t;
}

// Whether all stored properties of a first hit are finite. If not, they become black.
fn is_sound(f: ptr<function, FirstHit>) -> bool {
    if is_finite((*f).emission) && is_finite((*f).albedo) && is_finite((*f).matte) {
        return true;
    }
    (*f).emission = vec3<f32>(0.0);
    (*f).albedo = vec3<f32>(0.0);
    (*f).matte = vec3<f32>(0.0);
    return false;
}
