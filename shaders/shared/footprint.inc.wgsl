// Samples all over a pixel, and the surface behind its centre that the G-buffer has: its images are bound by the shader.

override JITTER: bool = true;

// Offset of a sample in its pixel. Both eyes and all stages that shoot primary rays agree on it through the key.
fn sample_offset(rng: ptr<function, Rng>) -> vec2<f32> {
    if JITTER {
        return random2(rng);
    }
    return frame.camera.centre;
}

// The first hit through the pixel's centre, as the G-buffer has it.
fn stored_hit(pixel: u32) -> Hit {
    let h = hit_image[pixel];
    return Hit(0.0, h.x, bitcast<vec2<f32>>(h.yz));
}

// Whether a sample of a pixel found another surface than the ray through its centre: then neither its radiance nor
// its albedo stand for one surface, and reprojection leaves the pixel alone.
fn is_elsewhere(at: u32, f: FirstHit) -> bool {
    let centre = hit_image[at];
    if f.hit.prim == NO_PRIM || (f.hit.prim & SPHERE) != 0u {
        return f.hit.prim != centre.x;
    }
    let guide = guide_image[at];
    if guide.w == NO_NORMAL || (centre.w & MATERIAL_MASK) != f.surface.material {
        return true;
    }
    let n = unpack_normal(guide.w);
    let apart = abs(dot(n, f.surface.position - bitcast<vec3<f32>>(guide.xyz)));
    return dot(n, f.surface.normal) < 0.95 || apart > 0.005 * f.hit.t;
}

// Whether a first hit is finite in all that images hold of it; what is not becomes black.
fn is_sound(f: ptr<function, FirstHit>) -> bool {
    if is_finite((*f).emission) && is_finite((*f).albedo) && is_finite((*f).matte) {
        return true;
    }
    (*f).emission = vec3<f32>(0.0);
    (*f).albedo = vec3<f32>(0.0);
    (*f).matte = vec3<f32>(0.0);
    return false;
}
