// Primary visibility of one view: the surface at each pixel's centre. With several samples per pixel, it also computes
// the means of albedo and emission over a pixel, if later stages need them and path tracing does not write them. Direct
// light with hard shadows counts as emission if the denoiser leaves it out. Perfect mirrors and clear glass may be
// replaced by the surfaces that they show, and what polished surfaces reflect may be part of albedo and emission.

//!include frame grid projection rng math light_groups trace surface split pack samples foveation mirrored
//!include texture_filter footprint first_surface bindings

// Changes of the direction from pixel to pixel.
fn steps_at(pixel: vec2<u32>) -> Footprint {
    let at = vec2<f32>(pixel) + frame.camera.centre;
    let ahead = ray_of(pass_.view, at);
    return Footprint(ray_of(pass_.view, at + vec2<f32>(1.0, 0.0)) - ahead, ray_of(pass_.view, at + vec2<f32>(0.0, 1.0)) - ahead);
}

@compute @workgroup_size(8, 4)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    if !is_shown(pixel) {
        hit_image[at] = vec4<u32>(NO_PRIM, 0u, 0u, MATERIAL_NONE);
        guide_image[at] = vec4<u32>(0u, 0u, 0u, NO_NORMAL);
        albedo_image[at] = pack_albedo(Albedo(vec3<f32>(0.0), vec3<f32>(0.0), 1.0));
        emission_image[at] = vec4<f32>(0.0);
        tally_image[at] = 0u;
        return;
    }
    if JITTER {
        if pass_.args.end_sample > 0u {
            if SPARSE && pass_.args.unsampled_only != 0u && is_sampled(pixel, pass_.view) {
                return;
            }
            let launched = launched_samples(pixel);
            if launched.x < launched.y {
                average_footprint(pixel, at, launched.x, launched.y);
            }
            return;
        }
    }
    let ahead = ray_of(pass_.view, vec2<f32>(pixel) + frame.camera.centre);
    let rng = rng_for(pixel, pass_.view, 0u);
    var seen = surface_in_mirrors(pass_.view, primary_hit(pass_.view, ahead, rng), ahead, rng, 1u);
    if FILTERS_TEXTURES && !JITTER {
        let steps = steps_at(pixel);
        var first = seen.first;
        var footprint = Footprint(steps.across * first.hit.t, steps.down * first.hit.t);
        if HAS_MIRRORS && seen.links.count > 0u {
            footprint = turned(steps, seen.links.pencil.apart.y, seen.direction);
        }
        filter_texture(&first, seen.direction, footprint);
        seen.first = first;
    }
    add_polish(&seen, rng);
    let polish = seen.polish;
    if HAS_POLISH && FILTERS_TEXTURES && !JITTER {
        var reflected = polish.hit;
        filter_texture(&reflected, polish.direction, turned(steps_at(pixel), polish.spread, polish.direction));
        seen.first.albedo += (reflected.albedo - polish.hit.albedo) * polish.weight;
        seen.first.emission += (reflected.emission - polish.hit.emission) * polish.weight;
    }
    let links = seen.links;
    let first = seen.first;
    let hit = first.hit;
    let is_surface = (hit.prim & SPHERE) == 0u;
    // Reflections in clear glass are specular light, as narrow as possible.
    let reflects = HAS_MIRRORS && HAS_TRANSMISSION && max3(links.albedo) > 0.0;
    let roughness = select(1.0, select(first.surface.roughness, 0.0, reflects), is_surface);
    var tag = MATERIAL_NONE;
    if is_surface {
        tag = seen_material(first, links.count);
        tag |= select(0u, FLAG_VIEW_DEPENDENT, is_view_dependent_over(seen));
        if HAS_GLOSS {
            tag |= u32(round(roughness * ROUGHNESS_STEPS)) << ROUGHNESS_SHIFT;
        }
    }
    var place = bitcast<vec2<u32>>(hit.bary);
    if HAS_MIRRORS {
        let mirrored = vec2<u32>(bitcast<u32>(links.surface_distance), pack_mirrored(hit.bary, links.has_moved));
        place = select(place, mirrored, links.count > 0u);
    }
    hit_image[at] = vec4<u32>(hit.prim, place, tag);
    guide_image[at] = select(
        vec4<u32>(0u, 0u, 0u, NO_NORMAL),
        vec4<u32>(bitcast<vec3<u32>>(first.surface.position), pack_normal(first.surface.normal)),
        is_surface,
    );
    let depth = select(select(hit.t, 0.0, hit.prim == NO_PRIM), links.distance, HAS_MIRRORS);
    // These results are written before shadow rays, which need many registers, are traced.
    albedo_image[at] = pack_albedo(Albedo(first.albedo, first.matte, roughness));
    let has_albedo = is_finite(first.albedo) && is_finite(first.matte);
    if HAS_HARD_LIGHTS && !JITTER && (!VARIES_SAMPLES || samples_of(pixel) == 1u) {
        add_hard_light(&seen, rng);
    }
    var emission = seen.first.emission;
    let is_kept = has_albedo && is_finite(emission);
    if !is_kept {
        albedo_image[at] = pack_albedo(Albedo(vec3<f32>(0.0), vec3<f32>(0.0), roughness));
        emission = vec3<f32>(0.0);
    }
    emission_image[at] = vec4<f32>(emission, depth);
    tally_image[at] = add_tally(0u, seen.rays, select(1u, 0u, is_kept && !was_cut_short));
}

// Adds samples [begin, end) to the running means of albedo and emission.
fn average_footprint(pixel: vec2<u32>, at: u32, begin: u32, end: u32) {
    let centre = unpack_albedo(albedo_image[at]);
    var albedo = select(vec3<f32>(0.0), centre.all, begin > 0u);
    var matte = select(vec3<f32>(0.0), centre.matte, begin > 0u);
    var emission = select(vec3<f32>(0.0), emission_image[at].rgb, begin > 0u);
    var mixed = false;
    var rays = 0u;
    var dropped = 0u;
    for (var i = begin; i < end; i += 1u) {
        var rng = rng_for(pixel, pass_.view, i);
        let direction = ray_of(pass_.view, vec2<f32>(pixel) + sample_offset(&rng));
        var seen = first_surface(pass_.view, primary_hit(pass_.view, direction, rng), direction, rng, 1u);
        add_hard_light(&seen, rng);
        var first = seen.first;
        rays += seen.rays;
        dropped += select(1u, 0u, is_sound(&first));
        mixed = mixed || is_elsewhere(at, first, seen.links.count);
        let step = 1.0 / f32(i + 1u);
        albedo += (first.albedo - albedo) * step;
        matte += (first.matte - matte) * step;
        emission += (first.emission - emission) * step;
    }
    albedo_image[at] = pack_albedo(Albedo(albedo, matte, centre.roughness));
    emission_image[at] = vec4<f32>(emission, emission_image[at].a);
    tally_image[at] = add_tally(tally_image[at], rays, dropped + select(0u, 1u, was_cut_short));
    if mixed {
        hit_image[at].w |= FLAG_MIXED;
    }
}
